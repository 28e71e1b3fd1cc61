"""A hand-made platoon in one row, with IDM drivers and the subject vehicle at its end, under any mix of effects."""

import functools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from surrogate.car_following.idm import Idm
from surrogate.effects.apply import classes_with_effects, with_memories
from surrogate.effects.base import EffectSetting, Moment
from surrogate.effects.settings import Effects, settings_table
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.loop.kinematics import move
from surrogate.road.neighbours import own_leader, second_leader
from surrogate.road.perception import NO_TRACK, PerceptionFrame
from surrogate.road.traffic_state import HEAD, VehicleArrays, empty_vehicles, with_changes
from surrogate.vehicle.vehicle_class import VehicleClass
from tests.jit_marked import jit_marked

STEP_S = 0.1
S0, T, A, B, V0, LENGTH = 2.1, 1.3, 1.45, 1.9, 26.0, 4.8
SEED = 17
NUM_STEPS = 900
NUM_VEHICLES = 6  # behind the row's head; the last is the subject vehicle
Settings = Mapping[str, EffectSetting]


def idm_class() -> VehicleClass:
    lane_change = Lc2013(*(jnp.asarray(v, jnp.float32) for v in (1.0, 0.3, 0.25, 1.0, 0.1, 20.0, 0.1, 1.2, 2.0)))
    numbers = (S0, T, A, B, 9.0, 4.0)
    model = Idm(*(jnp.asarray(v, jnp.float32) for v in numbers))
    sizes = (LENGTH, 55.0, 1.0, 0.0)
    return VehicleClass(model, lane_change, *(jnp.asarray(v, jnp.float32) for v in sizes))


def effects_of(settings: Settings) -> Effects:
    return Effects(jnp.asarray(settings_table(settings)))


def classes_of(effects: Effects) -> tuple[VehicleClass, ...]:
    return classes_with_effects((idm_class(), idm_class()), effects)


def platoon(position_m: list[float], speed_mps: list[float], settings: Settings) -> VehicleArrays:
    """Return vehicles in one row, foremost first; the last is the subject vehicle."""
    assert len(position_m) == len(speed_mps) == NUM_VEHICLES
    effects = effects_of(settings)
    size = 1 + NUM_VEHICLES
    subject_class = len(classes_of(effects)) - 1
    changes = {
        "position_m": [np.inf, *position_m],
        "speed_mps": [0.0, *speed_mps],
        "row": [0] * size,
        "vehicle_class": [HEAD, *[0] * (NUM_VEHICLES - 1), subject_class],
        "identity": np.arange(size) + 40,
        "speed_factor": [1.0] * size,
        "speed_limit_mps": [V0] * size,
    }
    empty = empty_vehicles(1, size)
    typed = {name: jnp.asarray(value, getattr(empty, name).dtype) for name, value in changes.items()}
    return with_memories(effects, with_changes(empty, **typed), jnp.asarray(SEED))


@functools.partial(jit_marked, static_argnames="num_steps")
def _drive(vehicles: VehicleArrays, effects: Effects, num_steps: int) -> VehicleArrays:
    classes = classes_of(effects)
    one = jnp.ones(vehicles.row.shape)

    def step(vehicles: VehicleArrays, number: Array) -> tuple[VehicleArrays, VehicleArrays]:
        leader = own_leader(vehicles)
        second = second_leader(leader)
        moved, _ = move(vehicles, leader, classes, one, jnp.asarray(SEED), number, STEP_S, effects, second)
        return moved, moved

    return jax.lax.scan(step, vehicles, jnp.arange(num_steps))[1]


def drive(vehicles: VehicleArrays, settings: Settings) -> VehicleArrays:
    """Return the vehicles after each of 900 steps, along a leading axis; entry 0 is the row's head."""
    return jax.device_get(_drive(vehicles, effects_of(settings), NUM_STEPS))


def moment_of(vehicles: VehicleArrays, step: int = 0) -> Moment:
    return Moment(vehicles, classes_of(effects_of({})), jnp.asarray(SEED), jnp.asarray(step), STEP_S)


def frame_of(
    time_s: float, row: list[int], offset_m: list[float], speed_mps: list[float], track: list[int], subject: int
) -> PerceptionFrame:
    """Return a frame of these objects, of which number `subject` is the subject vehicle, and three empty places."""
    spare = 3
    one = np.asarray

    # annotated as JAX arrays, which lets NumPy's stand in for them
    def column(values: list[float] | list[int] | list[bool], fill: float, kind: type) -> Any:
        return np.asarray([*values, *[fill] * spare], kind)

    def number(value: float) -> Any:
        return one(value, np.float32)

    is_subject = [place == subject for place in range(len(row))]
    tracks = [NO_TRACK if own else of_other for of_other, own in zip(track, is_subject, strict=True)]
    return PerceptionFrame(
        time_s=number(time_s),
        valid=column([True], False, bool)[0],
        subject_position_m=number(500.0 + 20.0 * time_s),
        subject_speed_mps=number(speed_mps[subject]),
        subject_acceleration_mps2=number(0.1),
        num_lanes=number(3.0),
        object_valid=column([True] * len(row), False, bool),
        object_is_subject=column(is_subject, False, bool),
        object_track=column(tracks, NO_TRACK, np.int32),
        object_row=column(row, 0, np.int32),
        object_offset_m=column(offset_m, 0.0, np.float32),
        object_speed_mps=column(speed_mps, 0.0, np.float32),
        object_lateral_m=column([0.0] * len(row), 0.0, np.float32),
        ahead_m=number(140.0),
        behind_m=number(110.0),
    )
