"""Picks the few entries of an array that need more work, so that the work costs as little as they are few."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


def first_true(mask: Bool[Array, " vehicle"], size: int) -> tuple[Int[Array, " chosen"], Bool[Array, " chosen"]]:
    """Return the indices of the first `size` true entries, and which of them there are.

    Args:
        mask: which entries are wanted.
        size: length of the answer; true entries beyond it are left out.
    """
    place = jnp.cumsum(mask.astype(jnp.int32)) - 1
    target = jnp.where(mask & (place < size), place, size)
    index = jnp.zeros((size + 1,), jnp.int32)
    index = index.at[target].max(jnp.arange(mask.shape[0], dtype=jnp.int32), mode="promise_in_bounds")[:size]
    return index, jnp.arange(size) < place[-1] + 1
