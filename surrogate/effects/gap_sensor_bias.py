"""A range sensor that reads all distances too long or too short by the same factor."""

import equinox as eqx
import numpy as np
from jaxtyping import Array

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Reading
from surrogate.road.drive_table import DriveTable, LogFormat, with_offsets
from surrogate.road.perception import PerceptionFrame


def _sense(dial: Dial, frame: PerceptionFrame, memory: Memory, seed: Array) -> tuple[PerceptionFrame, Memory]:
    del seed
    offset = frame.object_offset_m * (1.0 + dial.strength)
    return eqx.tree_at(lambda f: f.object_offset_m, frame, offset), memory


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    del random
    return with_offsets(table, table.offset_m * (1.0 + strength), log)


GAP_SENSOR_BIAS = Effect(
    name="gap_sensor_bias",
    title="distances read too long by a factor",
    unit="factor - 1 on the distance to each object",
    weak=0.02,
    medium=0.05,
    strong=0.12,
    acts_on=ActsOn.SENSOR,
    source="y = (1 + bias) x; range of scale errors of automotive radar and lidar, by judgement",
    is_signed=True,
    reading=Reading.DISTANCE_SCALE,
    alter=_alter,
    sense=_sense,
)
