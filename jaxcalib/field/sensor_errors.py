"""What sensors got wrong, measured from the drives alone, and drives without it.

A calibration matches what sensors report. Distances that are a tenth too long, objects that come late and noisy speeds
bend its values far: drivers who change speed as noise does do not exist. What the sensors are off by shows without any
model of traffic, so it can be taken off before values are searched: distances are divided by their factor, objects are
put back to their time, and tracks are smoothed by as much as their noise asks for.

Source: the smoother, Whittaker (1922), Proc. Edinburgh Math. Soc. 41, 63-75; its strength is the ratio of both
variances, as for a vehicle whose jerk is white: Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to
Tracking and Navigation, sec. 6.2.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded

from jaxcalib.field.log_tables import ObjectLog
from jaxcalib.field.physics.contradiction import Contradiction
from jaxcalib.field.physics.motion import BLOCKS_PER_DRIVE, DriveMotion, object_windows, subject_windows
from jaxcalib.field.physics.object_scales import JudgedDrive, measure_scales
from jaxcalib.field.physics.subject_identities import speed_scales
from jaxcalib.field.physics.track_noise import runs_of, white_noise

LEAST_NOISE = 0.05  # in m, or m/s: less bends nothing, and rounding to tenths makes 0.03 of it
LEAST_STEPS_LATE = 1.5  # of the log: simulators write some quantities a step late
# Spectral density of jerk, m^2/s^5: an acceleration drifts by 0.7 m/s^2 in a second, about what motorway traffic does.
JERK_DENSITY = 0.5
POSITION_ORDER, SPEED_ORDER = 3, 2  # of the differences whose size the smoother weighs: jerk, in either case


@dataclass(frozen=True)
class SensorErrors:
    """What sensors got wrong, as far as it matters."""

    distance_factor: float = 1.0  # reported distances over true ones
    late_s: float = 0.0  # time by which objects are reported late
    distance_noise_m: float = 0.0  # standard deviation of white noise of distances
    speed_noise_mps: float = 0.0  # the same of speeds

    @property
    def most_factor(self) -> float:
        """The distances' factor where they are too long, 1 where they are not."""
        return max(self.distance_factor, 1.0)

    @property
    def noise(self) -> float:
        """Standard deviation of both noises, in m and m/s, as one number."""
        return float(np.hypot(self.distance_noise_m, self.speed_noise_mps) / np.sqrt(2.0))

    def warnings(self) -> list[str]:
        """Return one line for what is taken off of each column."""
        lines = []
        if self.distance_factor != 1.0:
            lines.append(f"relative_x_m: distances are divided by {self.distance_factor:.3f}, to agree with speeds.")
        if self.late_s != 0.0:
            lines.append(f"time_s: objects are put back by {self.late_s:.2f} s, to the subject vehicle's clock.")
        if self.distance_noise_m > 0.0:
            lines.append(f"relative_x_m: white noise of {self.distance_noise_m:.2f} m is smoothed.")
        if self.speed_noise_mps > 0.0:
            lines.append(f"speed_kmh: white noise of {self.speed_noise_mps:.2f} m/s is smoothed.")
        return [f"objects' tables, {line}" for line in lines]


HONEST = SensorErrors()


def measure_sensors(motions: Sequence[DriveMotion], found: Sequence[Contradiction] = ()) -> SensorErrors:
    """Return what the sensors of some drives got wrong; what chance explains, or hardly matters, counts as nothing.

    Args:
        motions: the drives.
        found: what they contradict themselves in. Where the subject vehicle's own speeds are late, its objects seem to
            be, too.
    """
    windows = [subject_windows(motion, BLOCKS_PER_DRIVE * number) for number, motion in enumerate(motions)]
    judged = [
        JudgedDrive(motion, object_windows(motion, BLOCKS_PER_DRIVE * number), scale)
        for number, (motion, scale) in enumerate(zip(motions, speed_scales(windows), strict=True))
    ]
    scales = measure_scales(judged)
    sampling_s = max((motion.sampling_s for motion in motions), default=0.0)
    is_late = scales is not None and scales.is_late(LEAST_STEPS_LATE * sampling_s)
    is_late &= all(one.kind != "speed_delay" for one in found)
    distance_m, speed_mps = white_noise(motions)
    return SensorErrors(
        distance_factor=scales.distance_factor if scales is not None and scales.distances_are_off else 1.0,
        late_s=scales.late_s if scales is not None and is_late else 0.0,
        distance_noise_m=distance_m if distance_m >= LEAST_NOISE else 0.0,
        speed_noise_mps=speed_mps if speed_mps >= LEAST_NOISE else 0.0,
    )


def without_errors(log: ObjectLog, motion: DriveMotion, errors: SensorErrors) -> ObjectLog:
    """Return a drive's objects without what the sensors got wrong; objects from before the drive's begin are gone.

    Args:
        log: the objects' table, with distances.
        motion: of the same drive, with the same rows.
        errors: what is to be taken off.
    """
    rows, run = runs_of(motion)
    relative_x_m, speed_mps = log.relative_x_m.copy(), log.speed_mps.copy()
    jerk_m = JERK_DENSITY * motion.sampling_s ** (2 * POSITION_ORDER - 1)
    jerk_mps = JERK_DENSITY * motion.sampling_s ** (2 * SPEED_ORDER - 1)
    if errors.distance_noise_m > 0.0:
        strength = errors.distance_noise_m**2 / jerk_m
        relative_x_m[rows] = smoothed(relative_x_m[rows], run, POSITION_ORDER, strength)
    if errors.speed_noise_mps > 0.0:
        strength = errors.speed_noise_mps**2 / jerk_mps
        speed_mps[rows] = np.maximum(smoothed(speed_mps[rows], run, SPEED_ORDER, strength), 0.0)
    steps = round(errors.late_s / motion.sampling_s)
    if steps == 0:
        return replace(log, relative_x_m=relative_x_m / errors.distance_factor, speed_mps=speed_mps)
    # whole steps, for rows belong to the subject vehicle's; those that belong to none stay, to be counted as such
    last = len(motion.time_s) - 1
    number = np.clip(np.searchsorted(motion.time_s, log.time_s - 0.5 * motion.sampling_s), 0, last)
    belongs = np.abs(motion.time_s[number] - log.time_s) <= 0.5 * motion.sampling_s
    is_gone = belongs & ((number - steps < 0) | (number - steps > last))
    time_s = np.where(belongs, motion.time_s[np.clip(number - steps, 0, last)], log.time_s)
    moved = replace(log, time_s=time_s, relative_x_m=relative_x_m / errors.distance_factor, speed_mps=speed_mps)
    return moved.without(is_gone)


def smoothed(
    values: Float[np.ndarray, " row"], run: Int[np.ndarray, " row"], order: int, strength: float
) -> Float[np.ndarray, " row"]:
    """Return values, each run of which is smoothed by the same strength; runs too short for a difference stay.

    Args:
        values: to be smoothed, at even times, run after run.
        run: number of each value's run.
        order: of the differences that are held small.
        strength: weight of their squares beside the squared departures from the values.
    """
    kernel = np.asarray([(-1.0) ** (order - k) * comb(order, k) for k in range(order + 1)])
    normal = np.zeros((order + 1, len(values)))  # lower diagonals of the normal equations of all runs at once
    normal[0] = 1.0
    begins = np.flatnonzero(run[order:] == run[:-order]) if len(values) > order else np.zeros(0, int)
    for one in range(order + 1):
        for other in range(one, order + 1):
            np.add.at(normal[other - one], begins + one, strength * kernel[one] * kernel[other])
    return solveh_banded(normal, values, lower=True, check_finite=False) if len(values) else values
