"""Perception frames written down vehicle by vehicle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from surrogate.road.perception import NO_TRACK, PerceptionFrame

AHEAD_M, BEHIND_M = 100.0, 60.0
NUM_PLACES = 32
EGO = NO_TRACK


@dataclass(frozen=True)
class Car:
    """A vehicle at one instant, by the place of its front bumper along the route."""

    track: int
    row: int
    front_m: float
    speed_mps: float
    lateral_m: float = float("nan")


def instant(time_s: float, *cars: Car, valid: bool = True, acceleration_mps2: float = 0.0) -> PerceptionFrame:
    """Return a frame; one of the cars is the subject vehicle. They may come in any order."""
    (ego,) = (car for car in cars if car.track == EGO)
    cars = tuple(sorted(cars, key=lambda car: (car.row, -car.front_m)))

    def each(values: Sequence[Any], fill: float, dtype: type) -> Any:
        return np.asarray([*values, *[fill] * (NUM_PLACES - len(cars))], dtype)

    def one(value: float, dtype: type = np.float32) -> Any:
        return np.asarray(value, dtype)

    return PerceptionFrame(
        time_s=one(time_s),
        valid=one(valid, bool),
        subject_position_m=one(ego.front_m),
        subject_speed_mps=one(ego.speed_mps),
        subject_acceleration_mps2=one(acceleration_mps2),
        num_lanes=one(2.0),
        object_valid=each([True] * len(cars), False, bool),
        object_is_subject=each([car.track == EGO for car in cars], False, bool),
        object_track=each([car.track for car in cars], NO_TRACK, np.int32),
        object_row=each([car.row for car in cars], 0, np.int32),
        object_offset_m=each([car.front_m - ego.front_m for car in cars], 0.0, np.float32),
        object_speed_mps=each([car.speed_mps for car in cars], 0.0, np.float32),
        object_lateral_m=each([car.lateral_m for car in cars], 0.0, np.float32),
        ahead_m=one(AHEAD_M),
        behind_m=one(BEHIND_M),
    )


def drive(*frames: PerceptionFrame) -> PerceptionFrame:
    """Return frames stacked along a leading time axis."""
    return jax.tree.map(lambda *leaves: np.stack(leaves), *frames)


def random_drive(seed: int, num_frames: int = 6) -> PerceptionFrame:
    """Return a drive in which vehicles follow, change lane, overtake, come and go."""
    rng = np.random.default_rng(seed)
    front_m = np.append(300.0, rng.uniform(255.0, 390.0, 6)) + rng.uniform(0.0, 300.0)
    speed = rng.uniform(1.0, 25.0, 7)
    row, lateral = rng.integers(0, 3, 7), rng.uniform(-0.6, 0.6, 7)
    frames = []
    for number in range(num_frames):
        cars = [
            Car(k - 1, int(row[k]), float(front_m[k]), float(speed[k]), float(lateral[k]))
            for k in range(7)
            if k == 0 or rng.random() < 0.85
        ]
        near = [car for car in cars if -BEHIND_M <= car.front_m - front_m[0] <= AHEAD_M]
        frames.append(instant(40.0 + 0.5 * number, *near, acceleration_mps2=float(rng.normal())))
        speed = np.maximum(speed + rng.normal(0.0, 1.0, 7), 0.0)
        front_m, lateral = front_m + 0.5 * speed, np.clip(lateral + rng.normal(0.0, 0.3, 7), -1.8, 1.8)
        row = np.where(rng.random(7) < 0.3, rng.integers(0, 3, 7), row)
    return drive(*frames)
