"""What a user should know of drives: whether clock and places agree, and what sensors did not tell."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.case.case import Case
from jaxcalib.errors import shorten
from jaxcalib.field.field_log import DriveLog
from sim_adapters.scenario.scenario import Scenario

# Between clock and way, in seconds and of the time that the way takes: who departs may wait before a full entrance.
LEAST_OFF_S, LEAST_OFF = 120.0, 0.5
FEWEST_ROWS, LEAST_SIDE = 500, 0.01  # of objects, and share of them on either side, where both can be seen
LENGTH_TOLERANCE_M = 2.0
SLOWEST_MPS = 3.0  # a log that begins in a jam says little of how long the way to there took


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
