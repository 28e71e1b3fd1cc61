"""Reads entries of arrays, for a batch of runs as fast as for one."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int


@jax.custom_batching.custom_vmap
def take(values: Array, index: Int[Array, "..."]) -> Array:
    """Return `values[index]`; the caller vouches that every index is within bounds.

    A batch of runs reads from one flat array: XLA reads from a batch of arrays 1.5 times slower.
    """
    return values.at[index].get(mode="promise_in_bounds")


@take.def_vmap
def _take_of_many(
    axis_size: int, in_batched: list[bool], values: Array, index: Int[Array, "..."]
) -> tuple[Array, bool]:
    values_differ, index_differs = in_batched
    if not values_differ:
        return take(values, index), True
    if not index_differs:
        index = jnp.broadcast_to(index, (axis_size, *index.shape))
    run = jnp.arange(axis_size, dtype=index.dtype).reshape(-1, *[1] * (index.ndim - 1))
    return take(values.reshape(-1, *values.shape[2:]), index + run * values.shape[1]), True
