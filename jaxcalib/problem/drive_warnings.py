"""How much of the road drives cover, what that makes of counts per drive, and whether clock and places agree."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from jaxcalib.case.case import Case
from jaxcalib.errors import shorten
from jaxcalib.field.field_log import DriveLog
from jaxcalib.field.log_cleaning import GAP_TOLERANCE
from sim_adapters.scenario.scenario import Scenario

LEAST_COVERED = 0.8  # of the route, by a drive that counts as a whole one without a warning
# Between clock and way, in seconds and of the time that the way takes: who departs may wait before a full entrance.
LEAST_OFF_S, LEAST_OFF = 120.0, 0.5
FEWEST_ROWS, LEAST_SIDE = 500, 0.01  # of objects, and share of them on either side, where both can be seen
LENGTH_TOLERANCE_M = 2.0
SLOWEST_MPS = 3.0  # a log that begins in a jam says little of how long the way to there took


def covered_share(drive: DriveLog, length_m: float) -> float:
    """Share of the route that a log covers; 1 where that is nearly all of it.

    Args:
        drive: the log.
        length_m: length of the route.
    """
    return _share(float(np.ptp(drive.subject.position_m)), length_m)


def seen_share(drive: DriveLog, length_m: float) -> float:
    """The same, less what lies in gaps of the log."""
    return _share(float(np.ptp(drive.subject.position_m)) - _gaps_m(drive), length_m)


def counted_in_parts(
    field_tally: Float[np.ndarray, "drive tally"],
    drives: Sequence[DriveLog],
    length_m: float,
    tally_index: Mapping[str, int],
) -> Float[np.ndarray, "drive tally"]:
    """Tallies in which a drive along a part of the route counts as that part of a drive, and of a trip.

    Simulated drives are whole ones: what is counted per drive would else be compared with ten times the way. In a gap
    of a log nothing is counted, though the trip goes on.

    Args:
        field_tally: tallies of each drive.
        drives: the drives.
        length_m: length of the route.
        tally_index: place of each tally.
    """
    tally = field_tally.copy()
    tally[:, tally_index["drives"]] *= [seen_share(drive, length_m) for drive in drives]
    tally[:, tally_index["trips"]] *= [covered_share(drive, length_m) for drive in drives]
    return tally


def coverage_warnings(drives: Sequence[DriveLog], length_m: float) -> list[str]:
    """Return one line for each log that covers only a part of the route."""
    lines = []
    for drive in drives:
        if seen_share(drive, length_m) < 1.0:
            gaps_m = _gaps_m(drive)
            covered_m = float(np.ptp(drive.subject.position_m)) - gaps_m
            gaps = f", and {gaps_m:.0f} m lie in its gaps" if gaps_m > 0.0 else ""
            lines.append(
                f"drive {drive.id}: the log covers {covered_m:.0f} of {length_m:.0f} m of the route{gaps}; it counts "
                "as that part of a drive."
            )
    return lines


def _gaps_m(drive: DriveLog) -> float:
    """How far the subject vehicle drove in gaps of the log that are too long to bridge."""
    is_gap = np.diff(drive.subject.time_s) > drive.rules.longest_gap_s * (1.0 + GAP_TOLERANCE)
    return float(np.diff(drive.subject.position_m)[is_gap].sum())


def _share(covered_m: float, length_m: float) -> float:
    share = covered_m / length_m
    return share if share < LEAST_COVERED else 1.0


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


def length_warnings(case: Case, scenario: Scenario, drives: Sequence[DriveLog]) -> list[str]:
    """Return a line where distances to a bumper or centre need lengths of long vehicles that the logs do not hold.

    Args:
        case: says which points distances mean.
        scenario: says how long vehicles are.
        drives: the logs.
    """
    nominal_m = case.perception.nominal_length_m
    lengths_m = {flow.vtype: scenario.values_of(flow.vtype)["length"] for flow in scenario.flows}
    vtype = max(lengths_m, key=lambda name: lengths_m[name], default="")
    lacking = [drive.id for drive in drives if drive.counts.rows_without_length]
    if not (vtype and lacking and lengths_m[vtype] > nominal_m + LENGTH_TOLERANCE_M):
        return []
    return [
        f"logs of {shorten(', '.join(lacking))}: rows without length_m, which distances to reference = "
        f'"{case.log_form.reference}" need; such vehicles count as {nominal_m:g} m long, so that headways behind a '
        f"{shorten(vtype)!r} of {lengths_m[vtype]:g} m are shorter than the simulation's."
    ]


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
