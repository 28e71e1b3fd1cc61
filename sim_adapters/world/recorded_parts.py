"""Which parts of the route the logs cover, for both simulators: simulated drives are observed there alone."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from sim_adapters.world.drive_choice import choose, chosen
from surrogate.loop.recorded_parts import is_recorded
from surrogate.road.perception import PerceptionFrame

WHOLE_M = ((-np.inf, np.inf),)
NO_PART_M = (np.inf, -np.inf)


@dataclass(frozen=True)
class RecordedParts:
    """What the log of one drive covers."""

    depart_s: float  # departure of the drive, by which runs choose it
    parts_m: tuple[tuple[float, float], ...] = WHOLE_M  # begin and end along the route; without an end it is infinite

    @property
    def is_whole(self) -> bool:
        """Whether the log covers all of the route."""
        return self.parts_m == WHOLE_M


def are_whole(recorded: Sequence[RecordedParts]) -> bool:
    """Whether every log covers all of the route, so that simulators need not know of parts."""
    return all(one.is_whole for one in recorded)


def parts_of(recorded: Sequence[RecordedParts], depart_s: float, seed: int) -> tuple[tuple[float, float], ...]:
    """Return the parts in which a run's subject vehicle is observed; all of the route if no drive departs then.

    Args:
        recorded: the drives.
        depart_s: when it departs.
        seed: seed of the run.
    """
    drive = choose([one.depart_s for one in recorded], depart_s, seed)
    return WHOLE_M if drive is None else recorded[drive].parts_m


def within_parts(frames: PerceptionFrame, parts_m: Sequence[tuple[float, float]]) -> PerceptionFrame:
    """Return stacked frames of which those within the parts alone are valid."""
    if tuple(parts_m) == WHOLE_M:
        return frames
    is_kept = is_recorded(jnp.asarray(parts_m), jnp.asarray(frames.subject_position_m))
    return dataclasses.replace(frames, valid=np.asarray(frames.valid & is_kept))


def parts_table(
    recorded: Sequence[RecordedParts], depart_s: Float[Array, "*subject"], seed: Int[Array, ""]
) -> Float[Array, "*subject part 2"] | None:
    """As `parts_of`, on traced values; None where every log covers all of the route.

    Args:
        recorded: the drives.
        depart_s: when the run's subject vehicle departs, or each of several.
        seed: seed of the run.
    """
    if are_whole(recorded):
        return None
    most = max(len(one.parts_m) for one in recorded)
    rows = [
        (*parts_m, *[NO_PART_M] * (most - len(parts_m))) for parts_m in (*(one.parts_m for one in recorded), WHOLE_M)
    ]
    departs_s = jnp.asarray([one.depart_s for one in recorded], jnp.float32)
    drive, is_there = chosen(departs_s, depart_s, seed)
    return jnp.asarray(rows, jnp.float32)[jnp.where(is_there, drive, len(recorded))]
