"""Drives whose physics is right, made without any simulator, to be spoilt in one thing at a time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxcalib.field.physics.contradiction import Contradiction
from jaxcalib.field.physics.impossible_tracks import impossible_rows
from jaxcalib.field.physics.judgement import judge_drives
from jaxcalib.field.physics.motion import DriveMotion

SAMPLING_S = 0.1
LENGTH_S = 200.0
NUM_OBJECTS = 14
PLACE_NOISE_M, DISTANCE_NOISE_M, SPEED_NOISE_MPS = 0.6, 0.25, 0.15


def drive(seed: int, role: str = "fit", **changes: Any) -> DriveMotion:
    """A drive along a bending road, with vehicles that overtake and are overtaken; noise as sensors have it."""
    rng = np.random.default_rng(seed)
    time_s = 300.0 + np.arange(0.0, LENGTH_S, SAMPLING_S)
    phase = rng.uniform(0.0, 6.0, 3)
    speed_mps = 21.0 + 4.0 * np.sin(0.11 * time_s + phase[0]) + 2.0 * np.sin(0.31 * time_s + phase[1])
    position_m = 50.0 + np.concatenate([[0.0], np.cumsum(SAMPLING_S * (speed_mps[1:] + speed_mps[:-1]) / 2.0)])
    heading_rad = 0.3 * np.sin(position_m / 400.0 + phase[2])
    objects = [_track(rng, number, time_s, speed_mps, position_m) for number in range(NUM_OBJECTS)]
    columns = [np.concatenate(parts) for parts in zip(*objects, strict=True)]
    motion = DriveMotion(
        id=f"d{seed:02d}",
        role=role,
        subject_file=Path(f"d{seed:02d}_subject.csv"),
        objects_file=Path(f"d{seed:02d}_objects.csv"),
        time_s=time_s,
        position_m=position_m + PLACE_NOISE_M * rng.standard_normal(len(time_s)),
        speed_mps=speed_mps + 0.3 * SPEED_NOISE_MPS * rng.standard_normal(len(time_s)),
        acceleration_mps2=np.gradient(speed_mps, time_s) + 0.1 * rng.standard_normal(len(time_s)),
        yaw_rate_radps=np.gradient(heading_rad, time_s) + 0.002 * rng.standard_normal(len(time_s)),
        heading_rad=heading_rad,
        lateral_m=0.2 * rng.standard_normal(len(time_s)),
        across_m=np.zeros(len(time_s)),
        object_time_s=columns[1],
        vehicle=columns[0].astype(int),
        relative_x_m=columns[2],
        relative_y_m=columns[3],
        object_speed_mps=columns[4],
    )
    return replace(motion, **changes)


def _track(
    rng: np.random.Generator, number: int, time_s: np.ndarray, speed_mps: np.ndarray, position_m: np.ndarray
) -> tuple[np.ndarray, ...]:
    """One vehicle for a part of the drive, in the lane to the left or right of the subject vehicle's."""
    first = int(rng.uniform(0, len(time_s) - 700))
    part = slice(first, first + int(rng.uniform(250, 650)))
    own_mps = speed_mps[part] + rng.normal(0.0, 3.0) + np.sin(0.4 * time_s[part] + rng.uniform(0.0, 6.0))
    way_m = np.concatenate([[0.0], np.cumsum(SAMPLING_S * (own_mps[1:] + own_mps[:-1]) / 2.0)])
    relative_x_m = rng.uniform(-90.0, 90.0) + way_m - (position_m[part] - position_m[first])
    seen = np.abs(relative_x_m) < 150.0
    count = int(seen.sum())
    return (
        np.full(count, number),
        time_s[part][seen],
        relative_x_m[seen] + DISTANCE_NOISE_M * rng.standard_normal(count),
        np.full(count, 3.5 if number % 2 else -3.5) + 0.1 * rng.standard_normal(count),
        own_mps[seen] + SPEED_NOISE_MPS * rng.standard_normal(count),
    )


def thinned(motion: DriveMotion, every: int) -> DriveMotion:
    """The drive logged at every so many steps alone."""
    columns = (
        "time_s",
        "position_m",
        "speed_mps",
        "acceleration_mps2",
        "yaw_rate_radps",
        "heading_rad",
        "lateral_m",
        "across_m",
    )
    tick = np.round((motion.object_time_s - motion.time_s[0]) / SAMPLING_S).astype(int)
    return replace(motion, **{name: getattr(motion, name)[::every] for name in columns}).without(tick % every != 0)


def judged(motions: list[DriveMotion]) -> list[Contradiction]:
    """What drives contradict themselves in, impossible rows left out first, as where logs are read."""
    impossible = [impossible_rows(motion) for motion in motions]
    left = [motion.without(rows.any) for motion, rows in zip(motions, impossible, strict=True)]
    return judge_drives(left, impossible)


def with_relative_speeds(motion: DriveMotion) -> DriveMotion:
    """A drive whose objects' speeds are relative to the subject vehicle's."""
    own_mps = np.interp(motion.object_time_s, motion.time_s, motion.speed_mps)
    return replace(motion, object_speed_mps=motion.object_speed_mps - own_mps)


def with_track(
    motion: DriveMotion, rows: np.ndarray, relative_x_m: Any, relative_y_m: float, speed_mps: Any
) -> DriveMotion:
    """A drive with one more track, at some of the subject vehicle's instants."""
    count = len(motion.time_s[rows])

    def more(values: np.ndarray, own: Any) -> np.ndarray:
        return np.concatenate([values, np.broadcast_to(own, count)])

    return replace(
        motion,
        object_time_s=more(motion.object_time_s, motion.time_s[rows]),
        vehicle=more(motion.vehicle, motion.vehicle.max() + 1),
        relative_x_m=more(motion.relative_x_m, relative_x_m),
        relative_y_m=more(motion.relative_y_m, relative_y_m),
        object_speed_mps=more(motion.object_speed_mps, speed_mps),
    )
