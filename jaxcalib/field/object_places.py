"""Distances of detected vehicles from the subject vehicle, along and across the road, front bumper to front bumper."""

from dataclasses import replace

import numpy as np

from jaxcalib.case.log_form import LogForm
from jaxcalib.field.log_tables import LANE_UNKNOWN, ObjectLog
from jaxcalib.field.logged_place import LoggedPlace
from jaxcalib.field.map_matching import ROADSIDE_M, lane_centre_m, lane_number_from_right, match_points
from jaxcalib.field.matched_subject import MatchedSubject
from jaxcalib.field.route_geometry import RouteGeometry

AT_END_M = 1.0  # of the route: what is nearest to its end, but not there, lies beyond it


def with_distances(geometry: RouteGeometry, log: ObjectLog, subject: MatchedSubject) -> ObjectLog:
    """Lay objects that have places of their own along the road; others have their distances already.

    What lies off the route gets a distance that leads there, or none on another edge.

    Args:
        geometry: the route.
        log: the objects.
        subject: where the subject vehicle is, by the same points of vehicles.
    """
    if log.place is None:
        return log
    if log.place.kind == "edge":
        position_m, across_m = _on_edges(geometry, log, log.place)
        lane = log.lane
    else:
        position_m, across_m, is_beside = _in_plane(geometry, log.place)
        lane = np.where(is_beside, LANE_UNKNOWN, log.lane)
    time_s, table = subject.table.time_s, subject.table
    own_m = np.interp(log.time_s, time_s, table.position_m)
    own_across_m = np.interp(log.time_s, time_s, lane_centre_m(geometry, subject.edge, table.row) + table.lateral_m)
    left_m = across_m - own_across_m
    return replace(
        log, lane=lane, relative_x_m=position_m - own_m, relative_y_m=-left_m if geometry.is_mirrored else left_m
    )


def _in_plane(geometry: RouteGeometry, place: LoggedPlace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place along the route, across it, and whether it is beside the carriageway, of each row."""
    rows = np.flatnonzero(~place.is_missing)
    position_m, across_m = np.full((2, len(place.first)), np.nan)
    is_beside = np.zeros(len(place.first), bool)
    points = place.points(geometry, rows)
    is_finite = np.isfinite(points).all(axis=1)
    rows, points = rows[is_finite], points[is_finite]
    if not len(rows):
        return position_m, across_m, is_beside
    match = match_points(geometry, points)
    at_begin, at_end = match.position_m <= 0.0, match.position_m >= geometry.route_length_m
    beyond_m = np.where(match.distance_m > AT_END_M, match.distance_m, 0.0)
    position_m[rows] = match.position_m + np.where(at_end, beyond_m, 0.0) - np.where(at_begin, beyond_m, 0.0)
    edge = geometry.edge_at(match.position_m)
    across_m[rows] = lane_centre_m(geometry, edge, match.row) + match.lateral_m
    half_m = geometry.lane_width_m[edge].max(axis=1, initial=0.0, where=~np.isnan(geometry.lane_width_m[edge])) / 2
    is_beside[rows] = match.distance_m > half_m + ROADSIDE_M
    return position_m, across_m, is_beside


def _on_edges(geometry: RouteGeometry, log: ObjectLog, place: LoggedPlace) -> tuple[np.ndarray, np.ndarray]:
    number = {edge: index for index, edge in enumerate(geometry.edges)}
    edge = np.asarray([number.get(name, -1) for name in place.first], np.int64)
    on_route = edge >= 0
    position_m = np.where(on_route, geometry.edge_start_m[edge] + place.second, np.nan)
    lane = lane_number_from_right(geometry, log.lane, edge, log.lanes_from_left) - 1
    has_lane = on_route & (log.lane != LANE_UNKNOWN) & (lane >= 0) & (lane < geometry.num_lanes[edge])
    centre_m = geometry.lane_centre_m[edge, np.where(has_lane, lane, 0)]
    return position_m, np.where(has_lane, centre_m, np.nan)


def front_to_front(log: ObjectLog, form: LogForm, nominal_length_m: float) -> ObjectLog:
    """Make distances between other points of vehicles those between their front bumpers.

    Args:
        log: the objects.
        form: says which points distances mean.
        nominal_length_m: length of a vehicle whose length is unknown.
    """
    if form.reference == "front":
        return log
    length_m = np.where(np.isnan(log.length_m), nominal_length_m, log.length_m)
    if form.reference == "centre":
        further_m = (length_m - _own_length_m(form, nominal_length_m)) / 2.0
    else:  # the rear bumper of who is ahead, the front bumper of who is behind
        further_m = np.where(log.relative_x_m > 0.0, length_m, 0.0)
    return replace(log, relative_x_m=log.relative_x_m + further_m)


def lacks_length(log: ObjectLog, form: LogForm) -> np.ndarray:
    """Whether a row's distance needs a length that it does not have: of any vehicle, or of those ahead."""
    needs = np.full(len(log.relative_x_m), form.reference == "centre")
    needs |= (form.reference == "near_end") & (log.relative_x_m > 0.0)
    return needs & np.isnan(log.length_m)


def at_front(subject: MatchedSubject, form: LogForm, nominal_length_m: float) -> MatchedSubject:
    """Move the subject vehicle from the centre, where its places are, to its front bumper."""
    if form.reference != "centre":
        return subject
    position_m = subject.table.position_m + _own_length_m(form, nominal_length_m) / 2.0
    return replace(subject, table=replace(subject.table, position_m=position_m))


def _own_length_m(form: LogForm, nominal_length_m: float) -> float:
    return nominal_length_m if form.subject_length_m is None else form.subject_length_m
