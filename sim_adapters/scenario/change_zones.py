"""Where lanes meet or part within a junction: the surrogate lets vehicles change lane beside it instead.

A row of the surrogate's road is left by changing lane only. So where two lanes lead into one, the one that does not go
on ends there, and its vehicles change into the other before its end, as from an acceleration lane; where a lane leads
both on and off the carriageway, vehicles change onto the exit in its first metres, as from a deceleration lane.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.route_lane import LaneKey, RouteLane, lane_id

ZONE_M = 100.0  # about an acceleration lane; SUMO's vehicles look as far when they yield
SIDE_AT_M = 20.0  # from the junction: nearer, lanes that meet hardly lie apart
LEFT, RIGHT = 1, -1


@dataclass(frozen=True)
class ChangeZone:
    """A stretch on which vehicles may change between lanes of different edges."""

    lane: LaneKey  # lane that they leave
    beside: LaneKey  # lane that they change into
    side: int  # where that lies, left 1, right -1
    begin_m: float  # where the stretch begins on the route's axis
    end_m: float  # where it ends; whoever has to change and has not stands there
    is_merge: bool  # whether the lane ends there for everybody; otherwise only those leave it whose route does


@dataclass(frozen=True)
class Joints:
    """Lanes as the surrogate drives on them."""

    lanes: dict[LaneKey, RouteLane]  # all lanes; those that end in a merge have no successor
    zones: tuple[ChangeZone, ...]  # stretches on which vehicles change between lanes of different edges
    findings: tuple[Finding, ...]  # what is said of them


def join_lanes(
    file_name: str,
    lanes: Mapping[LaneKey, RouteLane],
    main_edges: tuple[str, ...],
    net: Any,
    is_left_hand: bool = False,
) -> Joints:
    """Turn merges and forks within junctions into changes of lane beside them.

    Args:
        file_name: of the network, for findings.
        lanes: as the network connects them.
        main_edges: edges of the subject vehicle's route.
        net: the sumolib network, for shapes.
        is_left_hand: whether traffic drives on the left; lanes are counted from there, then.
    """
    changed, zones, findings = dict(lanes), [], []
    goes_on: dict[LaneKey, LaneKey] = {}
    # where lanes meet, one with nowhere else to go goes on, then the carriageway, of its lanes the one furthest left
    order = sorted(lanes.values(), key=lambda lane: (len(lane.successors), lane.edge not in main_edges, -lane.index))
    for lane in order:
        met = [successor for successor in lane.successors if successor in goes_on]
        for successor in lane.successors:
            goes_on.setdefault(successor, lane.key)
        if not met or len(met) < len(lane.successors):
            continue  # it has a lane of its own to go on in
        other, zone = _meet(lane, [lanes[goes_on[successor]] for successor in met], net, is_left_hand)
        into = next(successor for successor in met if goes_on[successor] == other.key)
        zones += [zone] if zone else []
        changed[lane.key] = replace(lane, successors=(), merges_into=into if zone else None)
        words = (
            f"both lead into '{lane_id(into)}': in the surrogate vehicles leave '{lane_id(lane.key)}' before its end"
        )
        name = f"lanes '{lane_id(other.key)}' and '{lane_id(lane.key)}'"
        findings.append(Finding(Level.APPROXIMATED, file_name, name, words))
    for lane in lanes.values():
        on_main = [successor for successor in lane.successors if successor[0] in main_edges]
        exits = [successor for successor in lane.successors if successor[0] not in main_edges]
        if not (on_main and exits):
            continue
        zones.append(_fork_zone(lanes[on_main[0]], lanes[exits[0]], net))
        name = f"lane '{lane_id(lane.key)}'"
        words = (
            f"leads on and into '{lane_id(exits[0])}': in the surrogate vehicles change onto the exit in its first "
            f"{ZONE_M:.0f} m"
        )
        findings.append(Finding(Level.APPROXIMATED, file_name, name, words))
    if is_left_hand:
        zones = [replace(zone, side=-zone.side) for zone in zones]
    return Joints(changed, tuple(zones), tuple(findings))


def _meet(
    lane: RouteLane, others: list[RouteLane], net: Any, is_left_hand: bool
) -> tuple[RouteLane, ChangeZone | None]:
    """Return the nearest of the lanes that one meets, and where vehicles change into it.

    There is no such stretch where both are lanes of one edge: they lie beside one another all along.
    """
    of_edge = [other for other in others if other.edge == lane.edge]
    if of_edge:
        return min(of_edge, key=lambda other: abs(other.index - lane.index)), None
    zones = {other.index: _merge_zone(lane, other, net) for other in others}
    lies_left = next(iter(zones.values())).side == LEFT
    nearest = min(zones) if lies_left != is_left_hand else max(zones)  # lanes are counted from the other side there
    return next(other for other in others if other.index == nearest), zones[nearest]


def _merge_zone(lane: RouteLane, other: RouteLane, net: Any) -> ChangeZone:
    length_m = min(ZONE_M, lane.end_m - lane.start_m, other.end_m - other.start_m)
    side = -_side_of(_shape(net, other)[::-1], _shape(net, lane)[::-1])  # both seen from the junction, backwards
    return ChangeZone(lane.key, other.key, side, lane.end_m - length_m, lane.end_m, is_merge=True)


def _fork_zone(lane: RouteLane, exit_lane: RouteLane, net: Any) -> ChangeZone:
    length_m = min(ZONE_M, lane.end_m - lane.start_m, exit_lane.end_m - exit_lane.start_m)
    side = _side_of(_shape(net, exit_lane), _shape(net, lane))
    return ChangeZone(lane.key, exit_lane.key, side, exit_lane.start_m, exit_lane.start_m + length_m, is_merge=False)


def _shape(net: Any, lane: RouteLane) -> np.ndarray:
    return np.asarray(net.getLane(lane_id(lane.key)).getShape(), float)[:, :2]


def _side_of(shape: np.ndarray, axis: np.ndarray) -> int:
    """Return on which side of an axis a lane lies a little away from where both begin; left is 1.

    Args:
        shape: points of the lane, x and y, from the junction on.
        axis: points of the other one, from the junction on.
    """
    along = _point_at(axis, SIDE_AT_M) - axis[0]
    across = _point_at(shape, SIDE_AT_M) - _point_at(axis, SIDE_AT_M)
    return LEFT if along[0] * across[1] - along[1] * across[0] > 0.0 else RIGHT


def _point_at(shape: np.ndarray, distance_m: float) -> np.ndarray:
    steps_m = np.linalg.norm(np.diff(shape, axis=0), axis=1)
    at_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    return np.asarray([np.interp(distance_m, at_m, shape[:, column]) for column in range(2)])
