"""The lanes along the subject vehicle's route, read from a SUMO network, with their place on the route's axis."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sumolib

from sim_adapters.errors import ScenarioError

LaneKey = tuple[str, int]


@dataclass(frozen=True)
class RouteLane:
    """One lane on the carriageway or on a ramp.

    Attributes:
        edge: SUMO edge id.
        index: lane index in the edge, 0 = rightmost.
        start_m: where the edge begins on the route's axis.
        end_m: where it ends.
        speed_limit_mps: legal limit.
        successors: lanes reached without a lane change.
        is_acceleration: whether the network marks it as an acceleration lane.
    """

    edge: str
    index: int
    start_m: float
    end_m: float
    speed_limit_mps: float
    successors: tuple[LaneKey, ...]
    is_acceleration: bool

    @property
    def key(self) -> LaneKey:
        """Edge and index."""
        return (self.edge, self.index)


@dataclass(frozen=True)
class RouteNetwork:
    """All lanes that matter to the subject vehicle's route.

    Attributes:
        file: network file, for messages.
        main_edges: edges of the route in order.
        lanes: every lane of the route and of its ramps.
        lane_count: number of lanes of each edge.
        ramp_edges: edges of on- and off-ramps.
        junction_lanes: internal lanes on the route: id -> (lane before it, where it begins on the axis).
        net: the sumolib network, for projections and shapes.
    """

    file: Path
    main_edges: tuple[str, ...]
    lanes: dict[LaneKey, RouteLane]
    lane_count: dict[str, int]
    ramp_edges: tuple[str, ...]
    junction_lanes: dict[str, tuple[LaneKey, float]]
    net: Any = field(repr=False, compare=False)

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


def read_route_network(file: Path, main_edges: Sequence[str], routes: Sequence[Sequence[str]]) -> RouteNetwork:
    """Read the lanes along a route.

    Args:
        file: SUMO network.
        main_edges: edges of the subject vehicle's route.
        routes: edges of all routes in the demand; what lies off the subject vehicle's route becomes a ramp.

    Raises:
        ScenarioError: an edge is missing, or the road has something that the surrogate cannot represent: a traffic
            light, a junction where the route must give way, two lanes that merge into one, a route that leaves the
            carriageway and comes back.
    """
    net = sumolib.net.readNet(str(file), withInternal=True)
    for edge in {edge for route in [main_edges, *routes] for edge in route}:
        if not net.hasEdge(edge):
            raise ScenarioError(file, f"expected edge '{edge}', which a route uses; the network has no such edge.")
    place = _main_axis(net, main_edges)
    ramps = _ramp_axis(net, file, main_edges, routes, place)
    place |= ramps
    lanes, lane_count = {}, {}
    for edge, (start_m, end_m) in place.items():
        lane_count[edge] = len(net.getEdge(edge).getLanes())
        for lane in net.getEdge(edge).getLanes():
            lanes[(edge, lane.getIndex())] = _route_lane(net, file, lane, start_m, end_m, place)
    _refuse_merging_lanes(file, lanes)
    junction_lanes = _junction_lanes(net, lanes)
    return RouteNetwork(file, tuple(main_edges), lanes, lane_count, tuple(ramps), junction_lanes, net)


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
            raise ScenarioError(
                file,
                f"expected every route to stay on the carriageway between its ramps; one leaves it at '{stretch}'.",
            )
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
    net: Any, file: Path, lane: Any, start_m: float, end_m: float, place: dict[str, tuple[float, float]]
) -> RouteLane:
    edge = lane.getEdge().getID()
    successors = []
    for connection in lane.getOutgoing():
        target = connection.getToLane()
        if target.getEdge().getID() not in place:
            continue
        if connection.getTLSID():
            raise ScenarioError(
                file, f"traffic light '{connection.getTLSID()}' at the end of edge '{edge}': expected none."
            )
        if connection.getState() not in ("M", "="):
            raise ScenarioError(
                file,
                f"expected right of way from edge '{edge}' to '{target.getEdge().getID()}'; the connection's state is "
                f"'{connection.getState()}'.",
            )
        successors.append((target.getEdge().getID(), target.getIndex()))
    return RouteLane(
        edge=edge,
        index=lane.getIndex(),
        start_m=start_m,
        end_m=end_m,
        speed_limit_mps=lane.getSpeed(),
        successors=tuple(successors),
        is_acceleration=bool(lane.isAccelerationLane()) if hasattr(lane, "isAccelerationLane") else False,
    )


def _refuse_merging_lanes(file: Path, lanes: dict[LaneKey, RouteLane]) -> None:
    came_from: dict[LaneKey, LaneKey] = {}
    for lane in lanes.values():
        for successor in lane.successors:
            if successor in came_from:
                edge, index = came_from[successor]
                raise ScenarioError(
                    file,
                    f"lanes '{edge}_{index}' and '{lane.edge}_{lane.index}' both lead into "
                    f"'{successor[0]}_{successor[1]}': expected a lane of its own for each (an acceleration lane).",
                )
            came_from[successor] = lane.key


def _junction_lanes(net: Any, lanes: dict[LaneKey, RouteLane]) -> dict[str, tuple[LaneKey, float]]:
    found = {}
    for lane in lanes.values():
        for connection in net.getEdge(lane.edge).getLanes()[lane.index].getOutgoing():
            target = connection.getToLane()
            if (target.getEdge().getID(), target.getIndex()) in lanes and connection.getViaLaneID():
                found[connection.getViaLaneID()] = (lane.key, lane.end_m)
    return found
