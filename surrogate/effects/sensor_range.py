"""The sensors see less far than they should, and lose objects for single frames."""

import numpy as np
from jaxtyping import Array

from surrogate.effects.base import ActsOn, Dial, Effect, Memory
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.drive_table import DriveTable, LogFormat
from surrogate.road.perception import PerceptionFrame, frame_number, is_other, with_objects

DROPOUTS_PER_STRENGTH = 0.1


def _sense(dial: Dial, frame: PerceptionFrame, memory: Memory, seed: Array) -> tuple[PerceptionFrame, Memory]:
    share = 1.0 - dial.strength
    offset = frame.object_offset_m
    is_far = (offset > share * frame.ahead_m) | (offset < -share * frame.behind_m)
    chance = uniform(seed, frame.object_track, frame_number(frame), Purpose.DROPOUT)
    is_lost = chance < DROPOUTS_PER_STRENGTH * dial.strength
    gone = is_other(frame) & (is_far | is_lost) & dial.is_on
    return with_objects(frame, frame.object_valid & ~gone), memory


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    """The drive without what is far; objects lost in single frames are bridged when logs are read."""
    del random
    reach_m = np.where(table.offset_m > 0, log.ahead_m, log.behind_m) * (1.0 - strength)
    return table.select(np.abs(table.offset_m) <= reach_m)


SENSOR_RANGE = Effect(
    name="sensor_range",
    title="shorter range and lost objects",
    unit="share of the range lost; a tenth of it is the chance to lose an object in a frame",
    weak=0.2,
    medium=0.4,
    strong=0.6,
    acts_on=ActsOn.SENSOR,
    source="perception error models, 2302.11919: detection falls with distance; range by judgement",
    alter=_alter,
    sense=_sense,
)
