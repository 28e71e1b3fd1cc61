"""On which parts of its way a subject vehicle's observations count: a log may cover less than the route."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def is_recorded(parts_m: Float[Array, "*drive part 2"], position_m: Float[Array, "*drive"]) -> Bool[Array, "*drive"]:
    """Return whether a vehicle is within one of the parts.

    Args:
        parts_m: begin and end of each part along the route, both within; a part that ends before it begins is none.
        position_m: where the vehicle is.
    """
    here_m = position_m[..., None]
    return jnp.any((here_m >= parts_m[..., 0]) & (here_m <= parts_m[..., 1]), axis=-1)
