"""Which of the recorded drives a run stands for: one of those that depart when it does."""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

SAME_S = 1e-3  # departures that differ by less are equal
MIXING = 2654435761  # Knuth's multiplicative hash: seeds that differ by a fixed number do not choose alike
KEPT_BITS = 16


def choose(departs_s: Sequence[float], depart_s: float, seed: int) -> int | None:
    """Return the number of the drive; None where none departs then.

    Of several the seed tells, as if by chance: runs whose seeds go in steps must not all choose the same.

    Args:
        departs_s: when each drive departs.
        depart_s: when the run's subject vehicle does.
        seed: seed of the run.
    """
    same = [index for index, one_s in enumerate(departs_s) if abs(one_s - depart_s) < SAME_S]
    return same[int(_mixed(np, seed)) % len(same)] if same else None


def chosen(
    departs_s: Float[Array, " drive"], depart_s: Float[Array, "*subject"], seed: Int[Array, ""]
) -> tuple[Int[Array, "*subject"], Bool[Array, "*subject"]]:
    """As `choose`, on traced values: return the number of the drive, 0 where none departs then, and whether one does.

    Args:
        departs_s: when each drive departs.
        depart_s: when the run's subject vehicle does, or each of several.
        seed: seed of the run.
    """
    same = jnp.abs(departs_s - depart_s[..., None]) < SAME_S
    num_same = jnp.sum(same, axis=-1)
    wanted = (_mixed(jnp, seed) % jnp.maximum(num_same, 1).astype(jnp.uint32)).astype(jnp.int32)
    is_wanted = same & (jnp.cumsum(same, axis=-1) - 1 == wanted[..., None])
    return jnp.argmax(is_wanted, axis=-1).astype(jnp.int32), num_same > 0


def _mixed(array_module: Any, seed: Any) -> Any:
    """Return the seed's bits mixed, by NumPy or JAX; both wrap around at 32 bits."""
    bits = array_module.asarray([seed]).astype(array_module.uint32) * array_module.uint32(MIXING)
    return (bits >> array_module.uint32(KEPT_BITS))[0]
