"""Distances and speeds of objects are measured with white noise."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtri
from jaxtyping import Array

from surrogate.effects.base import ActsOn, Dial, Effect, Memory
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.drive_table import DriveTable, LogFormat, with_offsets
from surrogate.road.perception import PerceptionFrame, frame_number, is_other


def _sense(dial: Dial, frame: PerceptionFrame, memory: Memory, seed: Array) -> tuple[PerceptionFrame, Memory]:
    key = frame.object_track, frame_number(frame)
    of_distance = ndtri(uniform(seed, *key, Purpose.DISTANCE_NOISE))
    of_speed = ndtri(uniform(seed, *key, Purpose.SPEED_NOISE))
    is_noisy = is_other(frame) & dial.is_on
    offset = jnp.where(is_noisy, frame.object_offset_m + dial.strength * of_distance, frame.object_offset_m)
    speed = jnp.maximum(frame.object_speed_mps + dial.strength * of_speed, 0.0)
    speed = jnp.where(is_noisy, speed, frame.object_speed_mps)
    return eqx.tree_at(lambda f: (f.object_offset_m, f.object_speed_mps), frame, (offset, speed)), memory


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    objects = ~table.is_subject
    offset_m = table.offset_m + strength * objects * random.standard_normal(len(table.offset_m))
    speed_mps = np.maximum(table.speed_mps + strength * objects * random.standard_normal(len(table.speed_mps)), 0.0)
    return with_offsets(dataclasses.replace(table, speed_mps=speed_mps), offset_m, log)


SENSOR_NOISE = Effect(
    name="sensor_noise",
    title="noisy distances and speeds",
    unit="standard deviation in m (distance) and in m/s (speed), white",
    weak=0.1,
    medium=0.3,
    strong=0.8,
    acts_on=ActsOn.SENSOR,
    source="perception error models, 2302.11919; range of automotive radar and lidar trackers by judgement",
    alter=_alter,
    sense=_sense,
)
