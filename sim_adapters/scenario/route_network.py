"""The lanes along the subject vehicle's route, read from a SUMO network, with their place on the route's axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.sax import SAXException

import sumolib

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.change_zones import ChangeZone, join_lanes
from sim_adapters.scenario.demand_definitions import Route
from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.road_findings import closed_lane, counted, forking_lanes, right_of_way
from sim_adapters.scenario.route_check import RouteUser, refuse_broken, route_ends
from sim_adapters.scenario.route_lane import LaneKey, RouteLane


@dataclass(frozen=True)
class RouteNetwork:
    """All lanes that matter to the subject vehicle's route."""

    file: Path  # network file, for messages
    main_edges: tuple[str, ...]  # edges of the route in order
    lanes: dict[LaneKey, RouteLane]  # every lane of the route and of its ramps
    lane_count: dict[str, int]  # number of lanes of each edge
    ramp_edges: tuple[str, ...]  # edges of on- and off-ramps
    # internal lanes on the route: id -> (lane before it, where it begins on the axis)
    junction_lanes: dict[str, tuple[LaneKey, float]]
    net: Any = field(repr=False, compare=False)  # the sumolib network, for projections and shapes
    findings: tuple[Finding, ...] = ()  # what of it the surrogate cannot follow
    # stretches on which the surrogate's vehicles change between lanes of different edges
    zones: tuple[ChangeZone, ...] = ()
    is_left_hand: bool = False  # whether traffic drives on the left and lanes are drawn so: lane 0 is the leftmost

    def edge_lanes(self, edge: str) -> list[RouteLane]:
        """Return the lanes of an edge from right to left."""
        return [self.lanes[(edge, index)] for index in range(self.lane_count[edge])]

    def edge_start_m(self, edge: str) -> float:
        """Return where an edge begins on the route's axis."""
        return self.lanes[(edge, 0)].start_m

    def edge_end_m(self, edge: str) -> float:
        """Return where an edge ends on the route's axis."""
        return self.lanes[(edge, 0)].end_m

    @property
    def length_m(self) -> float:
        """Length of the route."""
        return self.edge_end_m(self.main_edges[-1])


def read_route_network(
    file: Path,
    main_edges: Sequence[str],
    routes: Sequence[Sequence[str]],
    vclasses: Sequence[str] = ("passenger",),
    users: Mapping[Route, RouteUser] | None = None,
    is_left_hand: bool = False,
) -> RouteNetwork:
    """Read the lanes along a route.

    Args:
        file: SUMO network.
        main_edges: edges of the subject vehicle's route.
        routes: edges of all routes in the demand; what lies off the subject vehicle's route becomes a ramp.
        vclasses: SUMO's vehicle classes of the traffic.
        users: who drives along each route, for messages.
        is_left_hand: whether the network says that traffic drives on the left.

    Raises:
        ScenarioError: the network cannot be read, or a route has an edge that it lacks or two that are not
            connected.
    """
    try:
        net = sumolib.net.readNet(str(file), withInternal=True)
    except (KeyError, ValueError, TypeError, AttributeError, IndexError, SyntaxError, SAXException) as error:
        # what is missing or odd in a network shows in sumolib as whatever it trips over; lxml's errors are SyntaxErrors
        raise ScenarioError(file, f"expected a network that SUMO's own tools read: {error!r:.100}.") from None
    refuse_broken(net, file, list(dict.fromkeys(map(tuple, [main_edges, *routes]))), users or {})
    findings: list[Finding] = []
    place = _main_axis(net, main_edges)
    place |= _ramp_axis(net, file, main_edges, routes, place, findings)
    used = {pair for route in [main_edges, *routes] for pair in pairwise(route)}
    lanes, lane_count = {}, {}
    for edge, (start_m, end_m) in place.items():
        lane_count[edge] = len(net.getEdge(edge).getLanes())
        for lane in net.getEdge(edge).getLanes():
            lanes[(edge, lane.getIndex())] = _route_lane(file, lane, (start_m, end_m), place, vclasses, used, findings)
    ramps = tuple(edge for edge in place if edge not in main_edges)
    is_mirrored = is_left_hand and _is_drawn_from_left(net, main_edges)
    joints = join_lanes(file.name, lanes, tuple(main_edges), net, is_mirrored)
    return RouteNetwork(
        file=file,
        main_edges=tuple(main_edges),
        lanes=joints.lanes,
        lane_count=lane_count,
        ramp_edges=ramps,
        junction_lanes=_junction_lanes(net, lanes),
        net=net,
        findings=tuple(counted([*findings, *joints.findings, *forking_lanes(file, lanes, main_edges)])),
        zones=joints.zones,
        is_left_hand=is_mirrored,
    )


def _main_axis(net: Any, main_edges: Sequence[str]) -> dict[str, tuple[float, float]]:
    place, position = {}, 0.0
    for edge, following in zip(main_edges, [*main_edges[1:], None], strict=True):
        length = net.getEdge(edge).getLength()
        place[edge] = (position, position + length)
        position += length + (_junction_length(net, edge, following) if following else 0.0)
    return place


def _junction_length(net: Any, edge: str, following: str) -> float:
    """Return the longest internal lane between two edges; lanes differ by centimetres."""
    lengths = [0.0]
    for lane in net.getEdge(edge).getLanes():
        for connection in lane.getOutgoing():
            if connection.getTo().getID() == following and connection.getViaLaneID():
                lengths.append(net.getLane(connection.getViaLaneID()).getLength())
    return max(lengths)


def _ramp_axis(
    net: Any,
    file: Path,
    main_edges: Sequence[str],
    routes: Sequence[Sequence[str]],
    place: dict[str, tuple[float, float]],
    findings: list[Finding],
) -> dict[str, tuple[float, float]]:
    """Lay on-ramps backwards from where they join and off-ramps forwards from where they leave."""
    ramps: dict[str, tuple[float, float]] = {}
    main = list(main_edges)
    for route in routes:
        on_main = [edge in place for edge in route]
        if not any(on_main):
            continue
        first, last = on_main.index(True), len(on_main) - 1 - on_main[::-1].index(True)
        stretch = list(route[first : last + 1])
        begin = main.index(stretch[0])
        if stretch != main[begin : begin + len(stretch)]:
            words = "a route that leaves the subject vehicle's road and comes back: the surrogate knows one road"
            findings.append(Finding(Level.SUMO_ALONE, file.name, f"route '{route_ends(route)}'", words))
        end_m = place[stretch[0]][0]
        for edge, following in zip(route[first - 1 :: -1] if first else [], route[first:0:-1], strict=True):
            end_m -= _junction_length(net, edge, following)
            ramps[edge] = (end_m - net.getEdge(edge).getLength(), end_m)
            end_m = ramps[edge][0]
        start_m = place[stretch[-1]][1]
        for edge, before in zip(route[last + 1 :], route[last:-1], strict=True):
            start_m += _junction_length(net, before, edge)
            ramps[edge] = (start_m, start_m + net.getEdge(edge).getLength())
            start_m = ramps[edge][1]
    return ramps


def _route_lane(
    file: Path,
    lane: Any,
    extent_m: tuple[float, float],
    place: dict[str, tuple[float, float]],
    vclasses: Sequence[str],
    used: set[tuple[str, str]],
    findings: list[Finding],
) -> RouteLane:
    edge = lane.getEdge().getID()
    successors = []
    for connection in lane.getOutgoing():
        target = connection.getToLane()
        following = target.getEdge().getID()
        if (edge, following) not in used or following not in place:  # no route turns there
            continue
        if not all(map(target.allows, vclasses)):  # nobody goes on into a closed lane
            continue
        successors.append((following, target.getIndex()))
        finding = right_of_way(file, connection, edge, following)
        if finding is not None:
            findings.append(finding)
    closed_to = [vclass for vclass in vclasses if not lane.allows(vclass)]
    if closed_to:
        findings.append(closed_lane(file, lane.getID(), closed_to, vclasses))
    return RouteLane(
        edge=edge,
        index=lane.getIndex(),
        start_m=extent_m[0],
        end_m=extent_m[1],
        speed_limit_mps=lane.getSpeed(),
        successors=tuple(successors),
        is_acceleration=bool(lane.isAccelerationLane()) if hasattr(lane, "isAccelerationLane") else False,
        is_open=not closed_to,
    )


def _is_drawn_from_left(net: Any, main_edges: Sequence[str]) -> bool:
    """Whether lane 1 is drawn on the right of lane 0; so it is, too, where no edge has two lanes to tell it by."""
    for edge in main_edges:
        lanes = net.getEdge(edge).getLanes()
        if len(lanes) > 1:
            (x, y), (ahead_x, ahead_y) = (point[:2] for point in lanes[0].getShape()[:2])
            beside_x, beside_y = lanes[1].getShape()[0][:2]
            return (ahead_x - x) * (beside_y - y) - (ahead_y - y) * (beside_x - x) < 0.0
    return True


def _junction_lanes(net: Any, lanes: dict[LaneKey, RouteLane]) -> dict[str, tuple[LaneKey, float]]:
    found = {}
    for lane in lanes.values():
        for connection in net.getEdge(lane.edge).getLanes()[lane.index].getOutgoing():
            target = connection.getToLane()
            if (target.getEdge().getID(), target.getIndex()) in lanes and connection.getViaLaneID():
                found[connection.getViaLaneID()] = (lane.key, lane.end_m)
    return found
