"""The lanes of a route as polylines with their place on the route's axis: what map matching looks things up in."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sim_adapters.scenario.road_builder import RowMap
from sim_adapters.scenario.route_network import RouteNetwork

SAMPLE_M = 1.0  # distance of the points that the nearest lane is looked up among


@dataclass(frozen=True)
class RouteGeometry:
    """The route's carriageway, cut into straight segments; every segment lies in one row.

    Where an edge's shape is shorter or longer than its length in the network, positions are scaled, as SUMO does.
    The stretch between two edges belongs to the edge before it, as in `sim_adapters.scenario.road_builder`.
    """

    begin_xy: np.ndarray  # where each segment begins, in the network's plane
    step_xy: np.ndarray  # from there to its end
    begin_m: np.ndarray  # where it begins on the route's axis
    length_m: np.ndarray  # its length on the axis
    row: np.ndarray
    by_row: tuple[np.ndarray, ...]  # for each row its segments in the order of the axis
    tree: KDTree  # points along all segments, for looking up the nearest
    segment_of_point: np.ndarray  # segment of each point
    edges: tuple[str, ...]  # the route's edges
    edge_start_m: np.ndarray  # where each edge begins on the axis
    edge_end_m: np.ndarray  # where it ends
    num_lanes: np.ndarray  # its number of lanes
    row_of_lane: np.ndarray  # row of each (edge, lane), -1 where there is no such lane
    # centre of each (edge, lane) across the road, + left, in one coordinate for the whole route
    lane_centre_m: np.ndarray
    lane_width_m: np.ndarray
    projection: Any  # of the network, from longitude and latitude in degrees; None where it has none
    net_offset_m: tuple[float, float]  # added to the projected coordinates
    # whether the plane, across the road too, is mirrored, for traffic drives on the left: to whoever looks things
    # up here the network's lane 0 is the rightmost in any case
    is_mirrored: bool = False
    has_lanes: bool = True  # whether it knows the road's lanes; otherwise everything is on its one lane

    @property
    def route_length_m(self) -> float:
        """Length of the route."""
        return float(self.edge_end_m[-1])

    @property
    def has_projection(self) -> bool:
        """Whether longitude and latitude mean something in the network."""
        return self.projection is not None

    def mirrored(self, points: np.ndarray) -> np.ndarray:
        """Points (x, y) of the network's plane in the plane of this geometry."""
        return points * (1.0, -1.0) if self.is_mirrored else points

    def point_on_edge(self, edge: int, position_m: float) -> np.ndarray:
        """Point (x, y) on the rightmost lane of an edge (its index), at a distance from the edge's beginning."""
        order = self.by_row[int(self.row_of_lane[edge, 0])]
        place_m = float(self.edge_start_m[edge]) + position_m
        before = int(np.searchsorted(self.begin_m[order], place_m, side="right")) - 1
        segment = order[int(np.clip(before, 0, len(order) - 1))]
        share = np.clip((place_m - self.begin_m[segment]) / self.length_m[segment], 0.0, 1.0)
        return self.begin_xy[segment] + share * self.step_xy[segment]

    def edge_at(self, position_m: np.ndarray) -> np.ndarray:
        """Return the index of the edge at a position; before and behind the route the first and the last one."""
        index = np.searchsorted(self.edge_start_m, position_m, side="right") - 1
        return np.clip(index, 0, len(self.edges) - 1)


def build_route_geometry(row_map: RowMap) -> RouteGeometry:
    """Return the geometry of the route's carriageway."""
    network = row_map.network
    net, edges = network.net, network.main_edges
    pieces = [
        (row_map.row_of_lane[(edge, index)], shape, start_m, end_m)
        for number, edge in enumerate(edges)
        for index in range(network.lane_count[edge])
        for shape, start_m, end_m in _lane_pieces(row_map, number, index)
    ]
    begin_xy, step_xy, begin_m, length_m, row = _cut(pieces)
    segment_of_point, points = _points(begin_xy, step_xy)
    row_of_lane, centre_m, width_m = _cross_section(row_map)
    return RouteGeometry(
        begin_xy=begin_xy,
        step_xy=step_xy,
        begin_m=begin_m,
        length_m=length_m,
        row=row,
        by_row=tuple(_in_axis_order(begin_m, row, number) for number in range(row_map.num_rows)),
        tree=KDTree(points),
        segment_of_point=segment_of_point,
        edges=edges,
        edge_start_m=np.asarray([network.edge_start_m(edge) for edge in edges]),
        edge_end_m=np.asarray([network.edge_end_m(edge) for edge in edges]),
        num_lanes=np.asarray([network.lane_count[edge] for edge in edges]),
        row_of_lane=row_of_lane,
        lane_centre_m=centre_m,
        lane_width_m=width_m,
        projection=_projection(network),
        net_offset_m=_offset_m(net),
        is_mirrored=network.is_left_hand,
    )


def geometry_of_line(line: np.ndarray, projection: Any) -> RouteGeometry:
    """Return the geometry of a road of which nothing but a line is known.

    Args:
        line: its points, [point, 2].
        projection: from longitude and latitude in degrees to the line's plane; None where there is none.
    """
    length_m = float(np.hypot(*np.diff(line, axis=0).T).sum())
    begin_xy, step_xy, begin_m, lengths_m, row = _cut([(0, line, 0.0, length_m)])
    segment_of_point, points = _points(begin_xy, step_xy)
    return RouteGeometry(
        begin_xy=begin_xy,
        step_xy=step_xy,
        begin_m=begin_m,
        length_m=lengths_m,
        row=row,
        by_row=(np.arange(len(row)),),
        tree=KDTree(points),
        segment_of_point=segment_of_point,
        edges=("",),
        edge_start_m=np.zeros(1),
        edge_end_m=np.asarray([length_m]),
        num_lanes=np.ones(1, int),
        row_of_lane=np.zeros((1, 1), int),
        lane_centre_m=np.zeros((1, 1)),
        lane_width_m=np.full((1, 1), np.inf),
        projection=projection,
        net_offset_m=(0.0, 0.0),
        has_lanes=False,
    )


def _offset_m(net: Any) -> tuple[float, float]:
    """What SUMO adds to projected coordinates; nothing where the network has no <location>."""
    try:
        return tuple(net.getLocationOffset())
    except KeyError:
        return (0.0, 0.0)


def _projection(network: RouteNetwork) -> Any:
    """The projection from longitude and latitude in degrees to the network's plane, less its offset.

    None where there is none ("!"), or one that only SUMO knows ("-", "UTM").
    """
    try:
        return network.net.getGeoProj()
    except (KeyError, RuntimeError):  # no <location>; what PROJ cannot read
        return None


def _lane_pieces(row_map: RowMap, number: int, index: int) -> list[tuple[np.ndarray, float, float]]:
    """Return the shape of a lane, and that of the way from it to the next edge, with their places on the axis."""
    network = row_map.network
    edge = network.main_edges[number]
    lane, route_lane = network.net.getEdge(edge).getLanes()[index], network.lanes[(edge, index)]
    mirrored = network.is_left_hand
    shape = _plane(lane.getShape(), mirrored)
    pieces = [(shape, route_lane.start_m, route_lane.end_m)]
    if number + 1 == len(network.main_edges):
        return pieces
    following = network.main_edges[number + 1]
    for connection in lane.getOutgoing():
        target = connection.getToLane()
        if target.getEdge().getID() != following:
            continue
        via = connection.getViaLaneID()
        between = [_plane(network.net.getLane(via).getShape(), mirrored)] if via else []
        way = np.concatenate([shape[-1:], *between, _plane(target.getShape(), mirrored)[:1]])
        pieces.append((way, route_lane.end_m, network.edge_start_m(following)))
        break
    return pieces


def _plane(shape: Any, is_mirrored: bool) -> np.ndarray:
    points = np.asarray([point[:2] for point in shape], float)
    return points * (1.0, -1.0) if is_mirrored else points


def _cut(pieces: list[tuple[int, np.ndarray, float, float]]) -> tuple[np.ndarray, ...]:
    """Cut polylines into segments; what is left out has no length."""
    begin_xy, step_xy, begin_m, length_m, rows = [], [], [], [], []
    for row, shape, start_m, end_m in pieces:
        step = np.diff(shape, axis=0)
        drawn = np.hypot(step[:, 0], step[:, 1])
        if drawn.sum() == 0.0:
            continue
        scale = (end_m - start_m) / drawn.sum()
        keep = drawn > 0.0
        begin_xy.append(shape[:-1][keep])
        step_xy.append(step[keep])
        begin_m.append((start_m + scale * (np.cumsum(drawn) - drawn))[keep])
        length_m.append((scale * drawn)[keep])
        rows.append(np.full(int(keep.sum()), row))
    return tuple(np.concatenate(parts) for parts in (begin_xy, step_xy, begin_m, length_m, rows))


def _points(begin_xy: np.ndarray, step_xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points along the segments at most SAMPLE_M apart, and the segment of each."""
    drawn = np.hypot(step_xy[:, 0], step_xy[:, 1])
    count = np.ceil(drawn / SAMPLE_M).astype(int) + 1
    segment = np.repeat(np.arange(len(count)), count)
    rank = np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    share = rank / (count - 1)[segment]
    return segment, begin_xy[segment] + share[:, None] * step_xy[segment]


def _in_axis_order(begin_m: np.ndarray, row: np.ndarray, number: int) -> np.ndarray:
    segments = np.flatnonzero(row == number)
    return segments[np.argsort(begin_m[segments], kind="stable")]


def _cross_section(row_map: RowMap) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return row, centre across the road and width of each (edge, lane).

    The coordinate across the road is carried on from edge to edge by the rows that both have, so that it does not jump
    where an auxiliary lane begins.
    """
    network = row_map.network
    most = max(network.lane_count[edge] for edge in network.main_edges)
    rows = np.full((len(network.main_edges), most), -1)
    centres, widths = np.full((2, *rows.shape), np.nan)
    for number, edge in enumerate(network.main_edges):
        lanes = range(network.lane_count[edge])
        width = np.asarray([lane.getWidth() for lane in network.net.getEdge(edge).getLanes()])
        centre = np.cumsum(width) - width / 2
        row = [row_map.row_of_lane[(edge, index)] for index in lanes]
        if number:
            before = {r: centres[number - 1, i] for i, r in enumerate(rows[number - 1]) if r >= 0}
            shift = [before[r] - centre[i] for i, r in enumerate(row) if r in before]
            centre = centre + (np.mean(shift) if shift else 0.0)
        rows[number, lanes], centres[number, lanes], widths[number, lanes] = row, centre, width
    return rows, centres, widths
