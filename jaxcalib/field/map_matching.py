"""Finds where on the route something is: from a point in the plane, or from a lane number and a place across."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.field.log_tables import LANE_UNKNOWN
from jaxcalib.field.route_geometry import RouteGeometry

NEAREST_POINTS = 8  # enough to reach both sides of a lane's border and of a bend
LANE_TOLERANCE_M = 0.5  # beyond half a lane's width: a vehicle that changes lanes is in either for a moment
ROADSIDE_M = 1.0  # beyond the outermost lanes: farther off it is on a ramp or on the shoulder
BORDER_REACH_M = 30.0  # errors of range, late reports and biased sensors carry an object across an edge's end
ROAD_REACH_M = 30.0  # across from any lane: a wide carriageway, and errors of position
MAP_REACH_M = 100.0  # a map that lies wrong, or a place that drifts, carries everything farther


@dataclass(frozen=True)
class MatchedPoints:
    """Places on the route."""

    position_m: np.ndarray  # along the route's axis
    lateral_m: np.ndarray  # offset from the centre of the lane, + left
    row: np.ndarray  # row of the lane
    distance_m: np.ndarray  # from the lane's centre line, also beyond the route's ends


@dataclass(frozen=True)
class LaneMatch:
    """The lanes that numbers of lanes mean."""

    edge: np.ndarray  # index of the edge on the route
    row: np.ndarray  # row of the lane, -1 where there is none
    # offset from its centre, + left; nan where unknown or where the number contradicts the place across
    lateral_m: np.ndarray
    contradicts: np.ndarray  # the number and the place across the road mean different lanes; `row` follows the number
    no_such_lane: np.ndarray  # the road has no lane of that number there
    misplaced: np.ndarray  # of these, the road has one a little before or farther on
    off_road: np.ndarray  # without a number, and farther off than the outermost lanes
    unknown: np.ndarray  # neither a number nor a place across


def match_points(geometry: RouteGeometry, xy: np.ndarray) -> MatchedPoints:
    """Return for each point the nearest place on the route's lanes.

    Args:
        geometry: the route.
        xy: finite points in the network's plane.
    """
    _, nearest = geometry.tree.query(xy, k=min(NEAREST_POINTS, len(geometry.segment_of_point)))
    segment = geometry.segment_of_point[nearest.reshape(len(xy), -1)]
    return _nearest_of(geometry, xy, segment)


def beyond_ends_m(geometry: RouteGeometry, xy: np.ndarray) -> np.ndarray:
    """Return how far each point lies before the route's beginning or behind its end, along the road; 0 elsewhere.

    A point counts as beyond an end where the straight line on from there passes within ROAD_REACH_M.
    """
    begin_m, end_m = geometry.begin_m, geometry.begin_m + geometry.length_m
    beyond_m = np.zeros(len(xy))
    for segment, sign in ((int(np.argmin(begin_m)), -1.0), (int(np.argmax(end_m)), 1.0)):
        step = geometry.step_xy[segment]
        along = step / np.hypot(*step)
        end_xy = geometry.begin_xy[segment] + (step if sign > 0.0 else 0.0)
        away = xy - end_xy
        over_m, aside_m = sign * (away @ along), np.abs(away @ np.asarray([-along[1], along[0]]))
        beyond_m = np.where((over_m > 0.0) & (aside_m <= ROAD_REACH_M), np.maximum(beyond_m, over_m), beyond_m)
    return beyond_m


def match_points_in_rows(
    geometry: RouteGeometry, xy: np.ndarray, row: np.ndarray, position_m: np.ndarray
) -> MatchedPoints:
    """Return the nearest place in a given row.

    Args:
        geometry: the route.
        xy: points in the network's plane.
        row: row to look in.
        position_m: roughly where on the axis, to within a segment or so.
    """
    segment = np.zeros((len(xy), 3), np.int64)
    for number, in_row in enumerate(geometry.by_row):
        mine = np.flatnonzero(row == number)
        if len(mine) and len(in_row):
            place = np.searchsorted(geometry.begin_m[in_row], position_m[mine], side="right") - 1
            segment[mine] = in_row[np.clip(place[:, None] + np.arange(-1, 2), 0, len(in_row) - 1)]
    return _nearest_of(geometry, xy, segment)


def _nearest_of(geometry: RouteGeometry, xy: np.ndarray, segment: np.ndarray) -> MatchedPoints:
    """Return the nearest place on the given segments of each point."""
    step = geometry.step_xy[segment]
    away = xy[:, None, :] - geometry.begin_xy[segment]
    share = np.clip(np.sum(away * step, axis=-1) / np.sum(step * step, axis=-1), 0.0, 1.0)
    miss = away - share[..., None] * step
    distance = np.hypot(miss[..., 0], miss[..., 1])
    best = np.argmin(distance, axis=1)[:, None]

    def of_best(values: np.ndarray) -> np.ndarray:
        return np.take_along_axis(values, best, axis=1)[:, 0]

    chosen = of_best(segment)
    left = of_best(step[..., 0] * away[..., 1] - step[..., 1] * away[..., 0]) >= 0.0
    distance, share = of_best(distance), of_best(share)
    return MatchedPoints(
        position_m=geometry.begin_m[chosen] + share * geometry.length_m[chosen],
        lateral_m=np.where(left, distance, -distance),
        row=geometry.row[chosen],
        distance_m=distance,
    )


def lane_centre_m(geometry: RouteGeometry, edge: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Return the centre of a row's lane across the road; nan where the edge has no lane in that row."""
    in_row = geometry.row_of_lane[edge] == row[:, None]
    lane = np.argmax(in_row, axis=1)
    return np.where(in_row.any(axis=1), geometry.lane_centre_m[edge, lane], np.nan)


def lane_number_from_right(
    geometry: RouteGeometry, lane: np.ndarray, edge: np.ndarray, from_left: bool = False
) -> np.ndarray:
    """Numbers of lanes, counted from 1 at the geometry's right: the network's lane 0.

    Args:
        geometry: the route.
        lane: as logged, counted from 1.
        edge: index of the edge that it is counted on; any shape that goes with `lane`.
        from_left: whether 1 is the leftmost on the road.
    """
    is_turned = geometry.is_mirrored != from_left
    return geometry.num_lanes[edge] + 1 - lane if is_turned else np.broadcast_to(lane, edge.shape)


def match_lanes(
    geometry: RouteGeometry,
    position_m: np.ndarray,
    across_m: np.ndarray,
    lane: np.ndarray,
    edge: np.ndarray,
    from_left: bool = False,
) -> LaneMatch:
    """Return the lanes that numbers of lanes mean.

    A number counts from the right of the edge that the vehicle is on, so it shifts by one where an auxiliary lane
    begins. Near an edge's end the number may still, or already, be that of the neighbouring edge: positions are
    rounded, vehicles between two edges are counted with either, and sensors report late. There the edge whose lane lies
    where the vehicle was seen across the road is taken.

    Args:
        geometry: the route.
        position_m: along the axis.
        across_m: across the road in the coordinate of `geometry.lane_centre_m`; nan where unknown.
        lane: 1 = rightmost, LANE_UNKNOWN where empty.
        edge: index of the edge that the number most likely refers to.
        from_left: whether 1 is the leftmost instead.
    """
    given, placed = (lane != LANE_UNKNOWN) & geometry.has_lanes, ~np.isnan(across_m)
    candidates = np.stack([edge, edge - 1, edge + 1], axis=1)
    last = len(geometry.edges) - 1
    inside = np.clip(candidates, 0, last)
    from_end_m = np.maximum(geometry.edge_start_m[inside] - position_m[:, None], 0.0) + np.maximum(
        position_m[:, None] - geometry.edge_end_m[inside], 0.0
    )
    reached = (candidates == inside) & (from_end_m <= BORDER_REACH_M)
    reached[:, 0] = True

    num_lanes = geometry.num_lanes[inside]
    from_first = lane_number_from_right(geometry, lane[:, None], inside, from_left) - 1
    index = np.where(given[:, None], from_first, 0)
    has_lane = (index >= 0) & (index < num_lanes)
    exists = reached & has_lane
    is_nearby = ((candidates == inside) & (from_end_m <= MAP_REACH_M) & has_lane).any(axis=1)
    column = np.clip(index, 0, geometry.row_of_lane.shape[1] - 1)
    lateral = across_m[:, None] - geometry.lane_centre_m[inside, column]
    fits = exists & (np.abs(lateral) <= geometry.lane_width_m[inside, column] / 2 + LANE_TOLERANCE_M)
    # The lane that fits counts first, then the one that is there; among equals the likely edge, then the nearer one.
    rank = np.where(fits, 0.0, np.where(exists, 1.0, 2.0))
    order = np.where(np.arange(3) == 0, 0.0, 1e-3 + from_end_m * 1e-6)
    choice = np.argmin(rank + order, axis=1)

    from_across = _lane_across(geometry, across_m, edge)
    chosen_edge = np.where(given, np.take_along_axis(inside, choice[:, None], axis=1)[:, 0], edge)
    chosen_lane = np.where(given, np.take_along_axis(column, choice[:, None], axis=1)[:, 0], from_across)
    is_there = np.where(given, np.take_along_axis(exists, choice[:, None], axis=1)[:, 0], placed)
    lateral = across_m - geometry.lane_centre_m[chosen_edge, chosen_lane]
    is_near = np.abs(lateral) <= geometry.lane_width_m[chosen_edge, chosen_lane] / 2 + np.where(
        given, LANE_TOLERANCE_M, ROADSIDE_M
    )
    off_road = ~given & placed & ~is_near
    return LaneMatch(
        edge=chosen_edge,
        row=np.where(is_there & ~off_road, geometry.row_of_lane[chosen_edge, chosen_lane], -1),
        lateral_m=np.where(is_there & is_near, lateral, np.nan),
        contradicts=given & is_there & placed & ~is_near,
        no_such_lane=given & ~is_there,
        misplaced=given & ~is_there & is_nearby,
        off_road=off_road,
        unknown=~given & ~placed,
    )


def _lane_across(geometry: RouteGeometry, across_m: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """Return the index of the lane whose centre is nearest."""
    away = np.abs(across_m[:, None] - geometry.lane_centre_m[edge])
    return np.argmin(np.where(np.isnan(away), np.inf, away), axis=1)
