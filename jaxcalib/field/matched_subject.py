"""Lays the subject vehicle's table onto the route."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.errors import CaseError
from jaxcalib.field.lane_causes import lane_cause
from jaxcalib.field.log_checks import MOST_WRONG, refuse_if_most, refuse_lanes, unread_columns
from jaxcalib.field.log_tables import SubjectLog
from jaxcalib.field.map_matching import (
    BORDER_REACH_M,
    beyond_ends_m,
    lane_centre_m,
    match_lanes,
    match_points,
    match_points_in_rows,
)
from jaxcalib.field.route_geometry import RouteGeometry
from jaxcalib.field.table_files import row_place
from sim_adapters.frame_table import SubjectTable

FARTHEST_FROM_ROUTE_M = 30.0
MOST_CONTRADICTING = 0.05  # share of rows; the subject vehicle's own lane should be known
BACKWARDS_M = 5.0  # errors of position at standstill are smaller
FARTHEST_BEYOND_M = 300.0  # an end of the route: recordings go on where a network ends, but not for long


@dataclass(frozen=True)
class MatchedSubject:
    """The subject vehicle on the route."""

    table: SubjectTable  # the rows that have a place and a speed
    yaw_rate_radps: np.ndarray  # angular velocity in those rows
    log_row: np.ndarray  # their numbers in the log, counted from 0
    edge: np.ndarray  # index of the edge in those rows
    across_m: np.ndarray  # where the places lie across the road, whatever lane the log names
    warnings: tuple[str, ...]  # what a user should know


def match_subject(geometry: RouteGeometry, log: SubjectLog) -> MatchedSubject:
    """Find the subject vehicle on the route.

    Raises:
        CaseError: most rows have no place, a place is far from the route, the road has no lane of that number there, or
            lane and place contradict each other too often.
    """
    has_place = ~log.place.is_missing & ~np.isnan(log.speed_mps)
    log_row = np.flatnonzero(has_place)
    refuse_if_most(log.file, ~has_place, f"expected {log.place.columns} and speed_kmh; one is missing")
    if log.place.kind == "globe" and not geometry.has_projection:
        raise CaseError(
            log.file,
            f"columns {log.place.columns}",
            "expected places in the network's own coordinates (columns x_m, y_m, or edge, position_m); the network has "
            "no projection that longitude and latitude could refer to.",
        )
    xy = log.place.points(geometry, log_row)
    reached = np.asarray(np.isfinite(xy).all(axis=1))
    beyond_m = beyond_ends_m(geometry, np.where(reached[:, None], xy, 1e9))
    inside = (beyond_m <= BACKWARDS_M) | (beyond_m > FARTHEST_BEYOND_M)
    if inside.sum() > 0.5 * len(inside):  # else it is the log of another road
        log_row, xy, reached = log_row[inside], xy[inside], reached[inside]
    point = match_points(geometry, np.where(reached[:, None], xy, 1e9))
    far = point.distance_m > FARTHEST_FROM_ROUTE_M
    if np.any(far):
        index = int(np.argmax(far))
        distance = f"{point.distance_m[index]:.0f} m away" if reached[index] else "off the route"
        place = f"{row_place(int(log_row[index]))}, columns {log.place.columns}"
        expected = f"expected a place within {FARTHEST_FROM_ROUTE_M:g} m of the route, got one {distance}"
        share = float(np.mean(far))
        also = f", and so in {share:.0%} of the rows. Is it the log of another road?" if share > MOST_WRONG else "."
        raise CaseError(log.file, place, expected + also)
    edge, num_contradicting_roads = _edge_of_road(geometry, log.road[log_row], point.position_m)
    across_m = lane_centre_m(geometry, geometry.edge_at(point.position_m), point.row) + point.lateral_m
    lanes = match_lanes(geometry, point.position_m, across_m, log.lane[log_row], edge, log.lanes_from_left)
    refuse_lanes(geometry, log.file, log_row, log.lane[log_row], np.ones(len(log_row), bool), lanes)
    wrong_share = float(np.mean(lanes.contradicts))
    if wrong_share > MOST_CONTRADICTING:
        index = int(np.argmax(lanes.contradicts))
        expected = (
            f"expected the lane where {log.place.columns} lie, got {log.lane[log_row[index]]}; "
            f"{wrong_share:.0%} of the rows contradict so."
            f"{lane_cause(geometry, point.position_m, across_m, log.lane[log_row], edge, log.lanes_from_left)}"
        )
        raise CaseError(log.file, row_place(int(log_row[index]), "lane"), expected)
    row = np.where(lanes.row >= 0, lanes.row, point.row)
    placed = match_points_in_rows(geometry, xy, row, point.position_m)
    table = SubjectTable(
        time_s=log.time_s[log_row],
        position_m=placed.position_m,
        speed_mps=log.speed_mps[log_row],
        acceleration_mps2=_acceleration(log, log_row),
        row=row,
        lateral_m=placed.lateral_m,
        num_lanes=geometry.num_lanes[geometry.edge_at(placed.position_m)],
    )
    warnings = _subject_warnings(
        log, table, int((~has_place).sum()), int(lanes.contradicts.sum()), num_contradicting_roads
    )
    return MatchedSubject(table, log.yaw_rate_radps[log_row], log_row, lanes.edge, across_m, warnings)


def _edge_of_road(geometry: RouteGeometry, road: np.ndarray, position_m: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the edge that lanes are counted on, and how many rows name an edge that is somewhere else.

    A vehicle between two edges may be counted with either; the column says with which. A road's name says nothing.
    """
    here = geometry.edge_at(position_m)
    number = {edge: index for index, edge in enumerate(geometry.edges)}
    named = np.asarray([number.get(name, -1) for name in road], np.int64)
    edge = np.where(named >= 0, named, here)
    away_m = np.maximum(geometry.edge_start_m[edge] - position_m, position_m - geometry.edge_end_m[edge])
    elsewhere = away_m > BORDER_REACH_M
    return np.where(elsewhere, here, edge), int((elsewhere & (named >= 0)).sum())


def _acceleration(log: SubjectLog, log_row: np.ndarray) -> np.ndarray:
    """Fill what is missing with the change of speed from the row before to the row after."""
    recorded = log.acceleration_mps2[log_row]
    if not np.any(np.isnan(recorded)) or len(log_row) < 2:
        return recorded
    return np.where(np.isnan(recorded), np.gradient(log.speed_mps[log_row], log.time_s[log_row]), recorded)


def _subject_warnings(
    log: SubjectLog,
    table: SubjectTable,
    num_without_place: int,
    num_contradicting_lanes: int,
    num_contradicting_roads: int,
) -> tuple[str, ...]:
    name, num_rows = log.file.name, len(log.time_s)
    steps_m = np.diff(table.position_m)
    found = [
        (num_without_place, "rows have no place or no speed and are left out"),
        (num_rows - len(table.time_s) - num_without_place, "rows lie before the route or behind it and are left out"),
        (int(np.isnan(log.acceleration_mps2).sum()), "rows have no acceleration; it is taken from the speeds"),
        (num_contradicting_lanes, "rows have a lane other than where the place lies; the lane counts"),
        (num_contradicting_roads, "rows name a road other than where the place lies; the place counts"),
        (int((steps_m < -BACKWARDS_M).sum()), f"rows lie more than {BACKWARDS_M:g} m behind the row before"),
    ]
    warnings = [f"{name}: {count} of {num_rows} {what}." for count, what in found if count]
    return tuple(warnings + unread_columns(log.extra_columns, name))
