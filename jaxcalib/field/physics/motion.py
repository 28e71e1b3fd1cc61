"""A drive cut into windows: what moved, what should have moved by the logged speeds, and how speeds changed."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

SUBJECT_WINDOW_S = 4.0  # positions are off by a metre or two, which such a way outweighs
OBJECT_WINDOW_S = 2.0  # tracks are short
LONGEST_STEP_S = 1.5  # between two rows of one window; slow logs have longer ones, up to 1.6 sampling intervals
BLOCKS_PER_DRIVE = 6  # parts of a drive that are taken for independent


@dataclass(frozen=True)
class DriveMotion:
    """What the physics of a drive is judged by; values as the log has them, in SI units, nan where it has none."""

    id: str
    role: str
    subject_file: Path
    objects_file: Path
    time_s: Float[np.ndarray, " instant"]  # of the subject vehicle's rows that have a place
    position_m: Float[np.ndarray, " instant"]  # along the route
    speed_mps: Float[np.ndarray, " instant"]
    acceleration_mps2: Float[np.ndarray, " instant"]  # as logged
    yaw_rate_radps: Float[np.ndarray, " instant"]
    heading_rad: Float[np.ndarray, " instant"]  # of the route there, unwrapped
    lateral_m: Float[np.ndarray, " instant"]  # from the centre of the lane that the log names to where places lie
    across_m: Float[np.ndarray, " instant"]  # of the places across the road, + left, in one coordinate for the route
    object_time_s: Float[np.ndarray, " row"]
    vehicle: Int[np.ndarray, " row"]  # number of each object's id
    relative_x_m: Float[np.ndarray, " row"]
    relative_y_m: Float[np.ndarray, " row"]
    object_speed_mps: Float[np.ndarray, " row"]
    speed_limit_mps: Float[np.ndarray, " instant"] | None = None  # legal limit as logged; None where nobody asked

    def without(self, rows: np.ndarray) -> "DriveMotion":
        """The drive less some of its objects' rows."""
        columns = ("object_time_s", "vehicle", "relative_x_m", "relative_y_m", "object_speed_mps")
        return replace(self, **{name: getattr(self, name)[~rows] for name in columns})

    @property
    def sampling_s(self) -> float:
        """Median time between two rows of the subject vehicle."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 1.0


@dataclass(frozen=True)
class SubjectWindows:
    """Windows of the subject vehicle's motion."""

    moved_m: Float[np.ndarray, " window"]  # by its places
    driven_m: Float[np.ndarray, " window"]  # by its speeds
    faster_mps: Float[np.ndarray, " window"]  # change of its speed
    accelerated_mps: Float[np.ndarray, " window"]  # by its accelerations
    bent_rad: Float[np.ndarray, " window"]  # how far the route turns
    turned_rad: Float[np.ndarray, " window"]  # by its yaw rates
    block: Int[np.ndarray, " window"]


@dataclass(frozen=True)
class ObjectWindows:
    """Windows of the tracks of detected vehicles."""

    begin_s: Float[np.ndarray, " window"]
    end_s: Float[np.ndarray, " window"]
    moved_m: Float[np.ndarray, " window"]  # change of the distance from the subject vehicle
    driven_m: Float[np.ndarray, " window"]  # by the object's speeds
    faster_mps: Float[np.ndarray, " window"]  # change of the object's speed
    block: Int[np.ndarray, " window"]


def integral_of(time_s: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Trapezoidal integral from the first row to each; nan from the first missing value of a step on is bridged."""
    step = np.diff(time_s) * (rate[1:] + rate[:-1]) / 2.0
    return np.concatenate([[0.0], np.cumsum(np.nan_to_num(step))])


def subject_windows(motion: DriveMotion, first_block: int = 0) -> SubjectWindows:
    """Cut the subject vehicle's motion into windows; those with a gap are left out."""
    time_s = motion.time_s
    longest_s = max(LONGEST_STEP_S, 1.6 * motion.sampling_s)
    length_s = max(SUBJECT_WINDOW_S, 4.0 * motion.sampling_s)
    picked = _first_of_bins(time_s, np.zeros(len(time_s), int), length_s)
    begin, end = picked[:-1], picked[1:]
    gaps = np.concatenate([[0], np.cumsum(np.diff(time_s) > longest_s)])
    whole = (gaps[begin] == gaps[end]) & (np.abs(time_s[end] - time_s[begin] - length_s) <= 0.5 * length_s)
    begin, end = begin[whole], end[whole]

    def change(values: np.ndarray) -> np.ndarray:
        return values[end] - values[begin]

    return SubjectWindows(
        moved_m=change(motion.position_m),
        driven_m=change(integral_of(time_s, motion.speed_mps)),
        faster_mps=change(motion.speed_mps),
        accelerated_mps=_known(change(integral_of(time_s, motion.acceleration_mps2)), motion.acceleration_mps2),
        bent_rad=change(motion.heading_rad),
        turned_rad=_known(change(integral_of(time_s, motion.yaw_rate_radps)), motion.yaw_rate_radps),
        block=first_block + _blocks(time_s[begin], time_s),
    )


def object_windows(motion: DriveMotion, first_block: int = 0) -> ObjectWindows:
    """Cut the tracks of the detected vehicles into windows; those with a gap, or of two vehicles, are left out."""
    has_motion = np.isfinite(motion.relative_x_m) & np.isfinite(motion.object_speed_mps)
    rows = np.flatnonzero(has_motion)
    rows = rows[np.lexsort((motion.object_time_s[rows], motion.vehicle[rows]))]
    time_s, vehicle = motion.object_time_s[rows], motion.vehicle[rows]
    if len(rows) < 2:
        nothing = np.zeros(0)
        return ObjectWindows(nothing, nothing, nothing, nothing, nothing, np.zeros(0, int))
    longest_s = max(LONGEST_STEP_S, 1.6 * motion.sampling_s)
    begins_anew = (np.diff(vehicle) != 0) | (np.diff(time_s) > longest_s)
    track = np.concatenate([[0], np.cumsum(begins_anew)])
    driven_m = integral_of(time_s, motion.object_speed_mps[rows])
    length_s = max(OBJECT_WINDOW_S, 2.0 * motion.sampling_s)
    picked = _first_of_bins(time_s, track, length_s)
    begin, end = picked[:-1], picked[1:]
    whole = (track[begin] == track[end]) & (np.abs(time_s[end] - time_s[begin] - length_s) <= 0.6 * length_s)
    begin, end = begin[whole], end[whole]
    relative_x_m, speed_mps = motion.relative_x_m[rows], motion.object_speed_mps[rows]
    return ObjectWindows(
        begin_s=time_s[begin],
        end_s=time_s[end],
        moved_m=relative_x_m[end] - relative_x_m[begin],
        driven_m=driven_m[end] - driven_m[begin],
        faster_mps=speed_mps[end] - speed_mps[begin],
        block=first_block + _blocks(time_s[begin], motion.time_s),
    )


def _known(values: np.ndarray, logged: np.ndarray) -> np.ndarray:
    """Values, or nan where the log has hardly any."""
    return values if np.isfinite(logged).mean() > 0.9 else np.full(len(values), np.nan)


def _blocks(at_s: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    share = (at_s - time_s[0]) / max(float(time_s[-1] - time_s[0]), 1e-9)
    return np.clip((BLOCKS_PER_DRIVE * share).astype(int), 0, BLOCKS_PER_DRIVE - 1)


def _first_of_bins(time_s: np.ndarray, track: np.ndarray, length_s: float) -> np.ndarray:
    """Rows at which a bin of time begins, track by track; rows are sorted by track and time."""
    starts = np.flatnonzero(np.diff(track, prepend=track[0] - 1))
    since_s = time_s - time_s[starts][np.cumsum(np.diff(track, prepend=track[0] - 1) != 0) - 1]
    number = np.floor(since_s / length_s + 1e-6).astype(int)
    is_first = (np.diff(number, prepend=-1) != 0) | (np.diff(track, prepend=track[0] - 1) != 0)
    return np.flatnonzero(is_first)
