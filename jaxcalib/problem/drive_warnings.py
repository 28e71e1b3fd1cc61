"""How much of the road drives cover, what that makes of counts per drive, and whether clock and places agree."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from jaxcalib.case.case import Case
from jaxcalib.field.field_log import DriveLog

LEAST_COVERED = 0.8  # of the route, by a drive that counts as a whole one without a warning
# Between clock and way, in seconds and of the time that the way takes: who departs may wait before a full entrance.
LEAST_OFF_S, LEAST_OFF = 120.0, 0.5
FEWEST_ROWS, LEAST_SIDE = 500, 0.01  # of objects, and share of them on either side, where both can be seen
SLOWEST_MPS = 3.0  # a log that begins in a jam says little of how long the way to there took


def covered_share(drive: DriveLog, length_m: float) -> float:
    """Share of the route that a log covers; 1 where that is nearly all of it.

    Args:
        drive: the log.
        length_m: length of the route.
    """
    share = float(np.ptp(drive.subject.position_m)) / length_m
    return share if share < LEAST_COVERED else 1.0


def counted_in_parts(
    field_tally: Float[np.ndarray, "drive tally"], drives: Sequence[DriveLog], length_m: float, column: int
) -> Float[np.ndarray, "drive tally"]:
    """Tallies in which a drive along a part of the route counts as that part of a drive.

    Simulated drives are whole ones: what is counted per drive would else be compared with ten times the way.

    Args:
        field_tally: tallies of each drive.
        drives: the drives.
        length_m: length of the route.
        column: the tally that counts drives.
    """
    tally = field_tally.copy()
    tally[:, column] *= [covered_share(drive, length_m) for drive in drives]
    return tally


def coverage_warnings(drives: Sequence[DriveLog], length_m: float) -> list[str]:
    """Return one line for each log that covers only a part of the route."""
    lines = []
    for drive in drives:
        if covered_share(drive, length_m) < 1.0:
            covered_m = float(np.ptp(drive.subject.position_m))
            lines.append(
                f"drive {drive.id}: the log covers {covered_m:.0f} of {length_m:.0f} m of the route; it counts as that "
                "part of a drive."
            )
    return lines


def departure_warnings(case: Case, drives: Sequence[DriveLog]) -> list[str]:
    """Return one line for each drive whose log begins where the vehicle cannot be at that time after its departure.

    Args:
        case: says when it departs.
        drives: its drives.
    """
    depart_s = {drive.id: drive.depart_s for drive in case.drives}
    lines = []
    for drive in drives:
        begin_s, begin_m = float(drive.subject.time_s[0]), float(drive.subject.position_m[0])
        speed_mps = float(np.nanmedian(drive.subject.speed_mps))
        if speed_mps < SLOWEST_MPS:
            continue
        took_s, takes_s = begin_s - depart_s[drive.id], begin_m / speed_mps
        if abs(took_s - takes_s) > max(LEAST_OFF_S, LEAST_OFF * takes_s):
            lines.append(
                f"drive {drive.id}: the log begins {took_s:.0f} s after depart_s at {begin_m:.0f} m of the route, to "
                f"where it takes about {takes_s:.0f} s; is depart_s right, and is the log on the scenario's clock?"
            )
    return lines


def one_sided_warnings(case: Case, drives: Sequence[DriveLog]) -> list[str]:
    """Return one line for each drive that saw hardly anybody ahead, or behind, though its sensors reach there.

    Args:
        case: says how far they reach.
        drives: its drives.
    """
    reach_m = {"ahead": case.perception.ahead_m, "behind": case.perception.behind_m}
    lines = []
    for drive in drives:
        offset_m = drive.objects.offset_m
        if len(offset_m) < FEWEST_ROWS:
            continue
        for side, share in (("ahead", np.mean(offset_m > 0.0)), ("behind", np.mean(offset_m < 0.0))):
            if share < LEAST_SIDE and reach_m[side] > 0.0:
                lines.append(
                    f"drive {drive.id}: {share:.1%} of the objects are {side} of the subject vehicle; do its sensors "
                    f"look there? Write a small perception.{side}_m if not."
                )
    return lines
