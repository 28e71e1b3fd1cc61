"""Drives that are one and the same recording: a held-out drive that the calibration has seen tests nothing."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from jaxcalib.field.physics.contradiction import Contradiction
from jaxcalib.field.physics.motion import DriveMotion

TIME_STEP_S, PLACE_STEP_M = 0.1, 0.1  # to which rows are rounded before they are compared
SAME_SHARE = 0.5  # of the rows of the shorter one that the other has as well
FEWEST_ROWS = 50  # fewer may agree by chance


def same_motions(motions: Sequence[DriveMotion]) -> list[Contradiction]:
    """Find drives whose detected vehicles move alike, from their first rows on."""
    rows = [_rows_of(motion) for motion in motions]
    found = []
    for first, second in combinations(range(len(motions)), 2):
        shorter = min(len(rows[first]), len(rows[second]))
        if shorter < FEWEST_ROWS or len(rows[first] & rows[second]) < SAME_SHARE * shorter:
            continue
        one, other = motions[first], motions[second]
        is_refused = one.role != other.role
        words = f"the same recording as drive {one.id}"
        if is_refused:
            words += ", which has the other role; a held-out drive is to be one that the calibration does not see."
        else:
            words += "; it counts twice."
        found.append(Contradiction("same_recording", other.objects_file, "", words, (other.id,), is_refused))
    return found


def _rows_of(motion: DriveMotion) -> set[tuple[int, int, int]]:
    known = np.isfinite(motion.relative_x_m) & np.isfinite(motion.object_speed_mps)
    if not known.any():
        return set()
    since_s = motion.object_time_s[known] - motion.time_s[0]
    columns = (since_s / TIME_STEP_S, motion.relative_x_m[known] / PLACE_STEP_M, motion.object_speed_mps[known] / 0.1)
    return set(zip(*(np.round(column).astype(int).tolist() for column in columns), strict=True))
