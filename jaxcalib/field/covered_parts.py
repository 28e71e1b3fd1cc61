"""Which parts of the route a log covers: simulated drives are observed on these parts alone.

Compared with whole drives, a log of the free first kilometre would say that there is no jam after it, and per drive it
would hold too few of all events.
"""

from collections.abc import Sequence

import numpy as np

from jaxcalib.case.case import Drive
from jaxcalib.field.field_log import DriveLog
from jaxcalib.field.log_cleaning import GAP_TOLERANCE
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.world.departures import departure_of
from sim_adapters.world.recorded_parts import RecordedParts, are_whole
from surrogate.inflow.departure import Position

# Vehicles enter and leave between two samples: a log that begins or ends as near as this to the route's ends is whole.
NEAR_END_M, NEAR_END = 50.0, 0.02  # the greater one counts; the second is a share of the route
FASTEST_MPS = 60.0  # who is farther from the route's begin than this allows has entered there
WORTH_TELLING = 0.95  # of the route: what covers less is told, what lacks some samples is not
LEAST_GAP_M = 1.0  # a place can stand for the time that goes by only where the vehicle moves


def recorded_parts(drives: Sequence[Drive], logs: Sequence[DriveLog], scenario: Scenario) -> tuple[RecordedParts, ...]:
    """Return what the logs of drives cover, for simulators; nothing where each covers all of the route.

    Args:
        drives: the drives, which say when they depart.
        logs: their logs.
        scenario: says how long the route is, and whether its subject vehicle enters at a fixed place.
    """
    length_m, entry = scenario.network.length_m, departure_of(scenario.demand.subject_departure)
    is_given = entry.position is Position.GIVEN and entry.position_m >= 0.0
    enters_anywhere, entry_m = (
        not is_given and entry.position is not Position.BASE,
        entry.position_m if is_given else 0.0,
    )
    recorded = tuple(
        RecordedParts(covered_parts_m(log, length_m, entry_m, drive.depart_s if enters_anywhere else None))
        for drive, log in zip(drives, logs, strict=True)
    )
    return () if are_whole(recorded) else recorded


def covered_parts_m(
    log: DriveLog, length_m: float, entry_m: float = 0.0, depart_s: float | None = None
) -> tuple[tuple[float, float], ...]:
    """Return begin and end of each part of the route that a log covers, in order; infinite where it has no end.

    A gap that is too long to bridge ends a part, as far as the vehicle moves in it.

    Args:
        log: the log.
        length_m: length of the route.
        entry_m: where the vehicle enters.
        depart_s: when the vehicle departs, where it may enter at any place, not at the route's begin alone.
    """
    time_s, position_m = log.subject.time_s, log.subject.position_m
    near_m = max(NEAR_END_M, NEAR_END * length_m)
    from_m = entry_m + near_m
    if depart_s is not None and position_m[0] > FASTEST_MPS * (time_s[0] - depart_s):
        from_m = np.inf
    before_gap = _before_gaps(log)
    begins_m = [-np.inf if position_m[0] <= from_m else float(position_m[0]), *map(float, position_m[before_gap + 1])]
    ends_m = [*map(float, position_m[before_gap]), np.inf if position_m[-1] >= length_m - near_m else position_m[-1]]
    return tuple((float(begin_m), float(end_m)) for begin_m, end_m in zip(begins_m, ends_m, strict=True))


def covered_m(parts_m: Sequence[tuple[float, float]], length_m: float) -> float:
    """Return how long parts of the route are together."""
    return float(np.diff(np.clip(parts_m, 0.0, length_m), axis=1).sum())


def coverage_warnings(recorded: Sequence[RecordedParts], logs: Sequence[DriveLog], length_m: float) -> list[str]:
    """Return one line for each log that covers much less than the route.

    Args:
        recorded: what the logs cover, from `recorded_parts`.
        logs: the logs.
        length_m: length of the route.
    """
    lines = []
    for one, log in zip(recorded, logs, strict=True) if recorded else ():
        if covered_m(one.parts_m, length_m) >= WORTH_TELLING * length_m:
            continue
        gaps_m = float(np.diff(log.subject.position_m)[_before_gaps(log)].sum())
        gaps = f", and {gaps_m:.0f} m lie in its gaps" if gaps_m > 0.0 else ""
        lines.append(
            f"drive {log.id}: the log covers {covered_m(one.parts_m, length_m):.0f} of {length_m:.0f} m of the route"
            f"{gaps}; it is compared with the same part of simulated drives."
        )
    return lines


def _before_gaps(log: DriveLog) -> np.ndarray:
    """Return the numbers of the samples before gaps that are too long to bridge and in which the vehicle moves on."""
    is_gap = np.diff(log.subject.time_s) > log.rules.longest_gap_s * (1.0 + GAP_TOLERANCE)
    return np.flatnonzero(is_gap & (np.diff(log.subject.position_m) >= LEAST_GAP_M))
