"""What of a road the surrogate does otherwise than SUMO, or cannot follow at all."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.route_lane import LaneKey, RouteLane, lane_id

RIGHT_OF_WAY = ("M", "=")


def right_of_way(file: Path, connection: Any, edge: str, following: str) -> Finding | None:
    """What a connection demands besides going on; None where it has right of way."""
    name, state = f"connection from edge '{edge}' to '{following}'", connection.getState()
    if connection.getTLSID():
        words = "a traffic light on a route; the surrogate has none"
        return Finding(Level.SUMO_ALONE, file.name, name, words)
    if state in RIGHT_OF_WAY:
        return None
    words = (
        "a zipper: in the surrogate whoever leaves the shorter lane gives way"
        if state == "Z"
        else ("gives way: in the surrogate vehicles change into the lane that they meet")
    )
    return Finding(Level.APPROXIMATED, file.name, name, words)


def closed_lane(file: Path, lane: str, closed_to: Sequence[str], vclasses: Sequence[str]) -> Finding:
    """A lane that some vehicle classes may not use, or none of those that drive."""
    if len(closed_to) == len(vclasses):
        return Finding(Level.FOLLOWED, file.name, f"lane '{lane}'", "closed to everybody")
    words = f"closed to {', '.join(closed_to)}; in the surrogate nobody uses it"
    return Finding(Level.APPROXIMATED, file.name, f"lane '{lane}'", words)


def forking_lanes(file: Path, lanes: Mapping[LaneKey, RouteLane], main_edges: Sequence[str]) -> list[Finding]:
    """Lanes that lead into several; in the surrogate a vehicle that changes nothing goes on in one of them.

    Of a lane that leads on and into one exit, `change_zones` makes one beside which the exit begins.
    """
    findings = []
    for lane in lanes.values():
        edges = {edge for edge, _ in lane.successors}
        if len(edges) == 2 and any(edge in main_edges for edge in edges):
            continue
        targets = " and ".join(f"'{lane_id(successor)}'" for successor in lane.successors)
        if len(edges) > 1:  # a vehicle bound for one edge would go on along the other
            words = f"leads into {targets}; the surrogate knows no lane that forks between two edges"
            findings.append(Finding(Level.SUMO_ALONE, file.name, f"lane '{lane.id}'", words))
        elif len(lane.successors) > 1:
            words = f"widens into {targets}; in the surrogate vehicles go on in one of them, and change into the other"
            findings.append(Finding(Level.APPROXIMATED, file.name, f"lane '{lane.id}'", words))
    return findings


def counted(findings: Sequence[Finding]) -> list[Finding]:
    """Findings that say the same once each, with their number."""
    first: dict[tuple[Level, str], Finding] = {}
    counts: dict[tuple[Level, str], int] = {}
    for finding in findings:
        key = (finding.level, finding.words)
        first.setdefault(key, finding)
        counts[key] = counts.get(key, 0) + 1
    return [replace(finding, count=counts[key]) for key, finding in first.items()]
