"""Picks the few entries of an array that need more work, so that the work costs as little as they are few."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from surrogate.xla.counting import running_count
from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise


def first_true(mask: Bool[Array, " vehicle"], size: int) -> tuple[Int[Array, " chosen"], Bool[Array, " chosen"]]:
    """Return the indices of the first `size` true entries, and which of them there are.

    Args:
        mask: which entries are wanted.
        size: length of the answer; true entries beyond it are left out.
    """
    count = running_count(mask.astype(jnp.int32))
    number = jnp.arange(size, dtype=jnp.int32)
    # the first entry by which more than `number` have been counted; a few halvings cost less than writing each entry
    index = jnp.zeros((size,), jnp.int32)
    last = mask.shape[0] - 1
    for halving in range(last.bit_length() - 1, -1, -1):
        further = index + (1 << halving)
        is_short = take(count, jnp.minimum(further - 1, last)) <= number
        index = materialise(jnp.where(is_short, jnp.minimum(further, last), index))
    return index, number < count[-1]
