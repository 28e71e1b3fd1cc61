"""By how much the objects' distances, speeds and times are off, where they mean what they should."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.field.physics.contradiction import SIGNIFICANT
from jaxcalib.field.physics.linear_fit import LinearFit, fit_linear
from jaxcalib.field.physics.motion import DriveMotion, ObjectWindows, integral_of

LARGEST_OFFSET_S = 30.0  # between the clocks of both tables that is looked for
LEAST_OFFSET_S = 0.25  # steps of simulators make up to 0.2 s
LEAST_SPEED_CHANGE_MPS = 0.2  # of the subject vehicle in a window, typically, without which no offset shows
LEAST_OFF = 0.02  # relative, of distances and of the objects' speeds
NUM_ROUNDS = 2  # of the estimate of an offset, for speeds are not straight lines


@dataclass(frozen=True)
class ObjectScales:
    """What the objects' columns are off by; errors are standard errors."""

    fit: LinearFit  # of distances' changes on speeds
    late_s: float  # time by which the objects' clock is late against the subject vehicle's
    speed_change_mps: float  # of the subject vehicle in a window, typically

    @property
    def distance_factor(self) -> float:
        """How many times as fast as speeds say distances change."""
        return float(self.fit.value[0])

    @property
    def distance_error(self) -> float:
        """Standard error of that factor."""
        return float(self.fit.error[0])

    @property
    def speed_factor(self) -> float:
        """How many times as fast as their column says the objects drive."""
        return float(1.0 + self.fit.value[1] / self.fit.value[0])

    @property
    def speed_error(self) -> float:
        """Standard error of that factor."""
        return float(self.fit.error[1])

    @property
    def late_error_s(self) -> float:
        """Standard error of the time by which the clock is late."""
        return float(np.hypot(self.fit.error[2], self.fit.error[3]))

    @property
    def distances_are_off(self) -> bool:
        """Whether chance does not explain the distances' factor."""
        return self.fit.is_off(0, 1.0, LEAST_OFF, SIGNIFICANT)

    @property
    def speeds_are_off(self) -> bool:
        """Whether chance does not explain the speeds' factor."""
        return self.fit.is_off(1, 0.0, LEAST_OFF, SIGNIFICANT)

    @property
    def times_are_off(self) -> bool:
        """Whether neither chance nor a simulator's steps explain that the clock is late, or early."""
        shows = self.speed_change_mps >= LEAST_SPEED_CHANGE_MPS
        return shows and abs(self.late_s) > max(LEAST_OFFSET_S, SIGNIFICANT * self.late_error_s)

    def is_late(self, least_s: float) -> bool:
        """Whether objects are reported late by more than some time, and than chance or a simulator's steps explain."""
        return self.late_s > max(LEAST_OFFSET_S, least_s, SIGNIFICANT * self.late_error_s)


@dataclass(frozen=True)
class JudgedDrive:
    """A drive whose columns are what they are said to be, nearly."""

    motion: DriveMotion
    windows: ObjectWindows
    subject_speed_scale: float  # by how much the subject vehicle's speeds are too small

    def design(self, late_s: float) -> Float[np.ndarray, "window coefficient"]:
        """What scales and delays multiply, if the objects' clock is late by so much."""
        own_m = subject_m(self.motion, self.windows, self.subject_speed_scale, late_s)
        speed_mps = self.subject_speed_scale * self.motion.speed_mps
        begin, end = (np.interp(at_s - late_s, self.motion.time_s, speed_mps)
                      for at_s in (self.windows.begin_s, self.windows.end_s))  # fmt: skip
        driven_m = self.windows.driven_m
        return np.stack([driven_m - own_m, driven_m, end - begin, self.windows.faster_mps], axis=1)


def subject_m(
    motion: DriveMotion, windows: ObjectWindows, scale: float, late_s: float = 0.0
) -> Float[np.ndarray, " window"]:
    """How far the subject vehicle drove in each window if the objects' clock is late; nan beyond its log."""
    driven_m = scale * integral_of(motion.time_s, motion.speed_mps)
    begin, end = (
        np.interp(at_s - late_s, motion.time_s, driven_m, left=np.nan, right=np.nan)
        for at_s in (windows.begin_s, windows.end_s)
    )
    return end - begin


def measure_scales(drives: Sequence[JudgedDrive]) -> ObjectScales | None:
    """Return what the drives together are off by; None where they are too few."""
    late_s, fit = 0.0, None
    for _ in range(NUM_ROUNDS):
        fit = fit_linear(
            np.concatenate([drive.design(late_s) for drive in drives] or [np.zeros((0, 4))]),
            np.concatenate([drive.windows.moved_m for drive in drives] or [np.zeros(0)]),
            np.concatenate([drive.windows.block for drive in drives] or [np.zeros(0, int)]),
        )
        if fit is None or not fit.value[0] > 0.0:
            return None
        # speeds of both that are late by the same time change nothing between the tables
        late_s += float(np.clip((fit.value[2] + fit.value[3]) / fit.value[0], -LARGEST_OFFSET_S, LARGEST_OFFSET_S))
    assert fit is not None
    changes_mps = np.concatenate([drive.design(0.0)[:, 2] for drive in drives])
    return ObjectScales(fit, late_s, float(np.nanstd(changes_mps)))
