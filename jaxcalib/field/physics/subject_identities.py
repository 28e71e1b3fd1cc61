"""What the subject vehicle's own quantities must agree on: places, speeds, accelerations, yaw rates, lanes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxcalib.field.physics.contradiction import (
    ACCELERATION_UNITS,
    ANGLE_UNITS,
    SIGNIFICANT,
    SPEED_UNITS,
    Contradiction,
    merged,
    unit_of,
)
from jaxcalib.field.physics.linear_fit import LinearFit, fit_linear
from jaxcalib.field.physics.motion import DriveMotion, SubjectWindows

LEAST_OFF = 0.02  # relative, of speed against the change of place; honest sensors agree to a hundredth
REFUSED_OFF = 0.25  # relative: no sensor is that bad, so the column is not what it is said to be
LEAST_LATE_S, REFUSED_LATE_S = 0.2, 2.0  # of speeds against places
# Accelerations are filtered, and sampled where they change: half of the size is still a sensor.
ACCELERATION_OFF, ACCELERATION_REFUSED = 0.3, 0.75
YAW_OFF = 0.3
LEAST_EXPLAINED = 0.6  # of the turns of the road, by yaw rates that are one by the other
LEAST_DRIVEN_M = 200.0  # in all windows; who stands still contradicts nothing
LEAST_SPEED_CHANGE_MPS = 0.3  # typical change in a window that accelerations can be judged by
LEAST_TURN_RAD = 0.005  # the same of the route's turn
FAST, MOST_FAST = 1.5, 0.5  # times the limit, and share of the rows: nobody drives so for long
TO_BE_ABSENT = "; leave the column empty, or name it in absent under [log], and they are taken from the speeds."
LEAST_LATERAL_M = 0.7  # from where the lanes are, of all places
WIDEST_M = 1.6  # beyond it places lie in another lane


def subject_contradictions(motions: Sequence[DriveMotion], windows: Sequence[SubjectWindows]) -> list[Contradiction]:
    """Judge each drive, and all of them together; what a drive shows by itself is not told again of all.

    Args:
        motions: the drives.
        windows: of each of them.
    """
    found = []
    for judge in (_judge_displacement, _judge_acceleration, _judge_yaw_rate):
        alone = [one for motion, own in zip(motions, windows, strict=True) for one in judge(own, motion)]
        found += merged(alone) or _of_all(judge(_together(windows), motions[0]) if motions else [], motions)
    found += _judge_lateral(motions)
    return found + merged([one for motion in motions for one in _judge_limit(motion)])


def _of_all(contradictions: Sequence[Contradiction], motions: Sequence[DriveMotion]) -> list[Contradiction]:
    return [replace(one, drives=tuple(motion.id for motion in motions)) for one in contradictions]


def _together(windows: Sequence[SubjectWindows]) -> SubjectWindows:
    names = SubjectWindows.__dataclass_fields__
    return SubjectWindows(**{name: np.concatenate([getattr(own, name) for own in windows]) for name in names})


def _displacement_fit(windows: SubjectWindows) -> LinearFit | None:
    """Scale of speeds, and that times how late they are."""
    if np.nansum(np.abs(windows.moved_m)) < LEAST_DRIVEN_M or np.nansum(windows.driven_m) < LEAST_DRIVEN_M / 10.0:
        return None
    return fit_linear(np.stack([windows.driven_m, windows.faster_mps], axis=1), windows.moved_m, windows.block)


def speed_scales(windows: Sequence[SubjectWindows]) -> list[float]:
    """By how much the speeds of each drive are too small; a drive too short to show it is taken for one of all."""
    together = speed_scale(_together(windows)) if windows else 1.0
    fits = [_displacement_fit(own) for own in windows]
    is_silent = [fit is None or not np.isfinite(fit.error[0]) for fit in fits]
    return [together if silent else speed_scale(own) for silent, own in zip(is_silent, windows, strict=True)]


def speed_scale(windows: SubjectWindows) -> float:
    """By how much a subject vehicle's speeds are too small; 1 where they may be right, or nothing can be said."""
    fit = _displacement_fit(windows)
    if fit is None or not fit.value[0] > 0.0 or not fit.is_off(0, 1.0, LEAST_OFF, SIGNIFICANT):
        return 1.0
    return float(fit.value[0])


def _judge_displacement(windows: SubjectWindows, motion: DriveMotion) -> list[Contradiction]:
    """Place along the route against the integral of speed: scale, direction, delay."""
    fit = _displacement_fit(windows)
    if fit is None:
        return []
    scale, found = float(fit.value[0]), []

    def note(kind: str, words: str, is_refused: bool, column: str = "speed_kmh") -> None:
        found.append(Contradiction(kind, motion.subject_file, column, words, (motion.id,), is_refused))

    if scale < -0.5:
        words = "the vehicle drives against the direction of the route; are rows in the order of time, is it this road?"
        note("backwards", words, is_refused=True, column="places and time_s")
    elif fit.is_off(0, 1.0, LEAST_OFF, SIGNIFICANT):
        unit = unit_of(scale, SPEED_UNITS)
        is_refused = abs(scale - 1.0) > REFUSED_OFF
        if is_refused and unit:
            words = (
                f"speeds are {scale:.2f} times too small for the way that the places show: {unit}? They are to be in "
                "km/h."
            )
        else:
            size = f"{scale:.3f} +- {fit.error[0]:.3f}" if np.isfinite(fit.error[0]) else f"{scale:.3f}"
            words = f"the places move {size} times as fast as the speeds say; one of them is wrong."
        note("speed_scale", words, is_refused)
    late_s = float(fit.value[1] / scale) if scale > 0.0 else 0.0
    usual_s = motion.sampling_s / 2.0  # a simulator's speed is that of the step that has been made
    error_s = fit.error[1] / max(scale, 1e-9)
    if abs(late_s) - usual_s > max(LEAST_LATE_S, SIGNIFICANT * error_s):
        way = "after" if late_s > 0 else "before"
        words = f"speeds come {abs(late_s):.2f} s {way} the places to which they belong; are both on one clock?"
        note("speed_delay", words, is_refused=abs(late_s) > REFUSED_LATE_S, column="speed_kmh and places")
    return found


def _judge_limit(motion: DriveMotion) -> list[Contradiction]:
    """Speeds against the legal limit that the log names: a limit that all exceed by half is of another unit."""
    if motion.speed_limit_mps is None:
        return []
    known = np.isfinite(motion.speed_limit_mps) & (motion.speed_limit_mps > 0.0)
    if known.mean() < 0.5:
        return []
    ratio = motion.speed_mps[known] / motion.speed_limit_mps[known]
    if float(np.mean(ratio > FAST)) < MOST_FAST:
        return []
    words = f"speeds are {np.median(ratio):.1f} times the log's speed_limit_kmh; one of the two is in another unit."
    return [Contradiction("speed_limit", motion.subject_file, "speed_limit_kmh", words, (motion.id,), is_refused=False)]


def _judge_acceleration(windows: SubjectWindows, motion: DriveMotion) -> list[Contradiction]:
    """Acceleration against the change of speed."""
    known = np.isfinite(windows.accelerated_mps)
    faster_mps = speed_scale(windows) * windows.faster_mps  # speeds of another unit are told already
    if not known.any() or np.nanstd(faster_mps[known]) < LEAST_SPEED_CHANGE_MPS:
        return []
    if not windows.accelerated_mps[known].any():
        words = f"accelerations are all 0 while the speed changes{TO_BE_ABSENT}"
        return [Contradiction("acceleration", motion.subject_file, "acceleration_mps2", words, (motion.id,), False)]
    fit = fit_linear(windows.accelerated_mps[:, None], faster_mps, windows.block)
    if fit is None or not fit.is_off(0, 1.0, ACCELERATION_OFF, SIGNIFICANT):
        return []
    scale = float(fit.value[0])
    explained = 1.0 - fit.scatter / max(float(np.median(np.abs(faster_mps[known]))), 1e-9)
    unit = unit_of(scale, ACCELERATION_UNITS)
    if explained < 0.3:
        words, is_refused = f"accelerations have nothing to do with how the speed changes{TO_BE_ABSENT}", False
    elif scale < -0.5:
        words, is_refused = "accelerations have the opposite sign of the change of speed; + is speeding up.", True
    elif unit:
        by = f"{scale:.2f} times too small" if scale >= 1.0 else f"{1.0 / scale:.2f} times too large"
        words, is_refused = f"accelerations are {by}: {unit}? They are to be in m/s^2.", True
    else:
        words = f"the speed changes {scale:.2f} times as fast as accelerations say."
        is_refused = abs(scale - 1.0) > ACCELERATION_REFUSED
    return [Contradiction("acceleration", motion.subject_file, "acceleration_mps2", words, (motion.id,), is_refused)]


def _judge_yaw_rate(windows: SubjectWindows, motion: DriveMotion) -> list[Contradiction]:
    """Yaw rate against the route's bends."""
    known = np.isfinite(windows.turned_rad)
    if not known.any() or np.nanstd(windows.bent_rad[known]) < LEAST_TURN_RAD:
        return []
    fit = fit_linear(windows.turned_rad[:, None], windows.bent_rad, windows.block)
    if fit is None or not fit.is_off(0, 1.0, YAW_OFF, SIGNIFICANT):
        return []
    scale = float(fit.value[0])
    unit = unit_of(scale, ANGLE_UNITS)
    left_rad = (windows.bent_rad - scale * windows.turned_rad)[known]  # most windows of a straight road do not turn
    explained = 1.0 - float(np.nansum(np.abs(left_rad)) / np.nansum(np.abs(windows.bent_rad[known])))
    if explained < LEAST_EXPLAINED:
        return []  # noise of a gyroscope, or lane changes on a straight road
    if scale < -0.5:
        words, is_refused = "yaw rates have the opposite sign of the route's bends; + is to the left.", True
    elif unit:
        words, is_refused = f"yaw rates are {1.0 / scale:.1f} times too large: {unit}? They are to be in rad/s.", True
    else:
        words, is_refused = f"the route bends {scale:.2f} times as fast as yaw rates say.", False
    return [Contradiction("yaw_rate", motion.subject_file, "yaw_rate_radps", words, (motion.id,), is_refused)]


def _median(values: np.ndarray) -> float:
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def _judge_lateral(motions: Sequence[DriveMotion]) -> list[Contradiction]:
    """Places against the lanes that the log names: to the side by how much."""
    median = np.asarray([_median(motion.lateral_m) for motion in motions])
    known = np.flatnonzero(np.isfinite(median)).tolist()
    if not len(known):
        return []
    center = float(np.median(median[known]))
    chosen = [motions[k] for k in known if abs(median[k]) > LEAST_LATERAL_M]
    if not chosen:
        return []
    size = center if abs(center) > LEAST_LATERAL_M else float(np.nanmedian(chosen[0].lateral_m))
    side = "left" if size > 0 else "right"
    words = f"places lie {abs(size):.1f} m to the {side} of the lanes that the log names; is the map of this datum?"
    drives = tuple(motion.id for motion in chosen)
    is_refused = abs(size) > WIDEST_M
    return [Contradiction("lateral_offset", chosen[0].subject_file, "places and lane", words, drives, is_refused)]
