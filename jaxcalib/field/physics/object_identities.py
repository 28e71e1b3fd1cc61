"""What detected vehicles must agree on with the subject vehicle: how distances change, by whose speeds, when."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.field.physics.contradiction import LENGTH_UNITS, SPEED_UNITS, Contradiction, merged
from jaxcalib.field.physics.motion import BLOCKS_PER_DRIVE, DriveMotion, ObjectWindows, object_windows
from jaxcalib.field.physics.object_scales import LARGEST_OFFSET_S, JudgedDrive, measure_scales, subject_m

OFFSET_STEP_S = 0.5
REFUSED_OFFSET_S = 2.0
CLEARLY_BETTER = 0.5  # of what is left unexplained, by which another reading must be better than the log's own
MOST_LEFT_M, MOST_LEFT = 0.8, 0.2  # in metres, and of what the log's own reading leaves: with more nothing is explained
LEAST_UNEXPLAINED_M = 1.0  # in a window: less is the noise of sensors
MOST_UNEXPLAINED = 0.5  # of how far distances change, that no reading explains
FEWEST_WINDOWS = 40


@dataclass(frozen=True)
class Reading:
    """A way in which the objects' columns may be meant."""

    kind: str  # what would be wrong
    speed_factor: float = 1.0  # on the objects' speeds
    is_relative: bool = False  # whether these are relative to the subject vehicle
    distance_factor: float = 1.0  # on distances; negative where the sign is exchanged

    def words(self) -> str:
        """What would be wrong, as a sentence."""
        unit = next((name for name, factor in SPEED_UNITS.items() if factor == self.speed_factor), None)
        length = next((name for name, factor in LENGTH_UNITS.items() if factor == abs(self.distance_factor)), None)
        parts = []
        if self.is_relative:
            parts.append("speeds are relative to the subject vehicle's; they are to be absolute")
        if unit:
            parts.append(f"speeds are {self.speed_factor:.2f} times too small: {unit}? They are to be in km/h")
        if self.distance_factor < 0.0:
            parts.append("relative_x_m has the opposite sign of how distances change; + is ahead")
        if length:
            parts.append(f"distances change as if they were in {length}; they are to be in metres")
        return "; ".join(parts) + "."

    def moved_m(self, windows: ObjectWindows, subject_m: Float[np.ndarray, " window"]) -> Float[np.ndarray, " window"]:
        """How far the logged distance should change in each window."""
        true_m = self.speed_factor * windows.driven_m - (0.0 if self.is_relative else subject_m)
        return true_m / self.distance_factor


COLUMNS: Mapping[str, str] = {
    "clock_offset": "time_s",
    "distance_scale": "relative_x_m",
    "distance_sign": "relative_x_m",
    "distance_unit": "relative_x_m",
    "foreign_objects": "",
    "object_speed_scale": "speed_kmh",
    "object_speed_unit": "speed_kmh",
    "relative_speeds": "speed_kmh",
}
AS_STATED = Reading("")
READINGS = (
    *(Reading("object_speed_unit", factor) for factor in SPEED_UNITS.values()),
    Reading("relative_speeds", is_relative=True),
    *(Reading("relative_speeds", factor, is_relative=True) for factor in SPEED_UNITS.values()),
    Reading("distance_sign", distance_factor=-1.0),
    *(Reading("distance_unit", distance_factor=factor) for factor in LENGTH_UNITS.values()),
)


def object_contradictions(motions: Sequence[DriveMotion], subject_speed_scale: Sequence[float]) -> list[Contradiction]:
    """Judge each drive's objects, and all of them together.

    Args:
        motions: the drives.
        subject_speed_scale: by how much the subject vehicle's speeds are too small, in each of them.
    """
    refused: list[Contradiction] = []
    others: list[JudgedDrive] = []
    for number, (motion, scale) in enumerate(zip(motions, subject_speed_scale, strict=True)):
        windows = object_windows(motion, BLOCKS_PER_DRIVE * number)
        if len(windows.moved_m) < FEWEST_WINDOWS:
            continue
        if verdict := _judge_reading(motion, windows, scale):
            kind, words = verdict
            refused.append(
                Contradiction(kind, motion.objects_file, COLUMNS[kind], words, (motion.id,), is_refused=True)
            )
        else:
            others.append(JudgedDrive(motion, windows, scale))
    return merged(refused) + _fine_contradictions(others)


def _unexplained_m(expected_m: np.ndarray, windows: ObjectWindows) -> float:
    left = np.abs(windows.moved_m - expected_m)
    known = np.isfinite(left)
    return float(np.median(left[known])) if known.sum() >= FEWEST_WINDOWS / 2 else np.inf


def _judge_reading(motion: DriveMotion, windows: ObjectWindows, scale: float) -> tuple[str, str] | None:
    """Kind and words where the columns are not what they are said to be."""
    own_m = subject_m(motion, windows, scale)
    as_stated_m = _unexplained_m(AS_STATED.moved_m(windows, own_m), windows)
    if as_stated_m < LEAST_UNEXPLAINED_M:
        return None
    best = min(READINGS, key=lambda reading: _unexplained_m(reading.moved_m(windows, own_m), windows))
    best_m = _unexplained_m(best.moved_m(windows, own_m), windows)
    offset_s, offset_m = _best_offset(motion, windows, scale)
    typical_m = float(np.median(np.abs(windows.moved_m)))  # a reading under which nothing moves explains nothing
    most_m = max(MOST_LEFT_M, MOST_LEFT * as_stated_m)
    if min(best_m, offset_m) < min(CLEARLY_BETTER * min(as_stated_m, typical_m), most_m):
        if best_m <= offset_m:
            return best.kind, best.words()
        if abs(offset_s) >= REFUSED_OFFSET_S:  # lesser ones are estimated with all drives
            way = "late" if offset_s > 0 else "early"
            return "clock_offset", (
                f"the objects' times are {abs(offset_s):.1f} s {way} against the subject vehicle's; put both on one "
                "clock."
            )
        return None
    if as_stated_m > max(MOST_UNEXPLAINED * typical_m, 1.5 * LEAST_UNEXPLAINED_M):
        return "foreign_objects", (
            f"distances change by other amounts than both speeds say, {as_stated_m:.1f} m in "
            f"{np.median(windows.end_s - windows.begin_s):.0f} s in the median; are these the objects of this drive?"
        )
    return None


def _best_offset(motion: DriveMotion, windows: ObjectWindows, scale: float) -> tuple[float, float]:
    """The offset of the objects' clock that explains most, and what it leaves unexplained."""
    offsets_s = np.arange(-LARGEST_OFFSET_S, LARGEST_OFFSET_S + OFFSET_STEP_S / 2, OFFSET_STEP_S)
    left = [
        _unexplained_m(AS_STATED.moved_m(windows, subject_m(motion, windows, scale, late_s)), windows)
        for late_s in offsets_s
    ]
    best = int(np.argmin(left))
    return float(offsets_s[best]), left[best]


def _fine_contradictions(drives: Sequence[JudgedDrive]) -> list[Contradiction]:
    """Scales and offsets too small to be a unit: of each drive, or else of all together."""
    alone = merged([one for drive in drives for one in _judge_scales([drive])])
    return alone or _judge_scales(drives)


def _judge_scales(drives: Sequence[JudgedDrive]) -> list[Contradiction]:
    scales = measure_scales(drives)
    if scales is None:
        return []
    motion, ids = drives[0].motion, tuple(drive.motion.id for drive in drives)
    found = []

    def note(kind: str, words: str, is_refused: bool = False) -> None:
        found.append(Contradiction(kind, motion.objects_file, COLUMNS[kind], words, ids, is_refused))

    if scales.distances_are_off:
        size = f"{scales.distance_factor:.3f} +- {scales.distance_error:.3f}"
        note("distance_scale", f"distances change {size} times as fast as speeds say.")
    if scales.speeds_are_off:
        size = f"{scales.speed_factor:.3f} +- {scales.speed_error:.3f}"
        note("object_speed_scale", f"the objects drive {size} times as fast as speed_kmh says.")
    if scales.times_are_off:
        way = "late" if scales.late_s > 0 else "early"
        size = f"{abs(scales.late_s):.2f} +- {scales.late_error_s:.2f} s {way}"
        words = f"the objects' times are {size} against the subject vehicle's; put both on one clock."
        note("clock_offset", words, is_refused=abs(scales.late_s) > REFUSED_OFFSET_S)
    return found
