"""Which parts of the route the logs cover, for both simulators: simulated drives are observed there alone."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sim_adapters.interface import NO_DRIVE
from surrogate.loop.recorded_parts import is_recorded
from surrogate.road.perception import PerceptionFrame

WHOLE_M = ((-np.inf, np.inf),)
NO_PART_M = (np.inf, -np.inf)


@dataclass(frozen=True)
class RecordedParts:
    """What the log of one drive covers."""

    parts_m: tuple[tuple[float, float], ...] = WHOLE_M  # begin and end along the route; without an end it is infinite

    @property
    def is_whole(self) -> bool:
        """Whether the log covers all of the route."""
        return self.parts_m == WHOLE_M


def are_whole(recorded: Sequence[RecordedParts]) -> bool:
    """Whether every log covers all of the route, so that simulators need not know of parts."""
    return all(one.is_whole for one in recorded)


def parts_of(recorded: Sequence[RecordedParts], drive: int) -> tuple[tuple[float, float], ...]:
    """Return the parts in which a run's subject vehicle is observed.

    Args:
        recorded: the drives; none where each log covers all of the route.
        drive: number of the one that the run stands for; NO_DRIVE is observed on all of the route.
    """
    return recorded[drive].parts_m if recorded and drive != NO_DRIVE else WHOLE_M


def within_parts(frames: PerceptionFrame, parts_m: Sequence[tuple[float, float]]) -> PerceptionFrame:
    """Return stacked frames of which those within the parts alone are valid."""
    if tuple(parts_m) == WHOLE_M:
        return frames
    is_kept = is_recorded(jnp.asarray(parts_m), jnp.asarray(frames.subject_position_m))
    return dataclasses.replace(frames, valid=np.asarray(frames.valid & is_kept))


def parts_table(
    recorded: Sequence[RecordedParts], drive: Int[Array, "*subject"]
) -> Float[Array, "*subject part 2"] | None:
    """As `parts_of`, on traced values; None where every log covers all of the route.

    Args:
        recorded: the drives.
        drive: number of the one that the run's subject vehicle stands for, or each of several.
    """
    if are_whole(recorded):
        return None
    most = max(len(one.parts_m) for one in recorded)
    rows = [
        (*parts_m, *[NO_PART_M] * (most - len(parts_m))) for parts_m in (*(one.parts_m for one in recorded), WHOLE_M)
    ]
    return jnp.asarray(rows, jnp.float32)[jnp.where(drive == NO_DRIVE, len(recorded), drive)]
