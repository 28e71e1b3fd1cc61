"""Lays the table of detected vehicles onto the route."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.errors import CaseError, shorten
from jaxcalib.field.log_checks import refuse_if_most, refuse_lanes, unread_columns
from jaxcalib.field.log_tables import CLOCK_TOLERANCE_S, ObjectLog, SubjectLog
from jaxcalib.field.map_matching import lane_centre_m, match_lanes
from jaxcalib.field.matched_subject import MatchedSubject
from jaxcalib.field.route_geometry import RouteGeometry
from jaxcalib.field.table_files import row_place
from sim_adapters.frame_table import ObjectTable

MOST_CONTRADICTING = 0.25  # share of rows; late reports reach 0.01, an exchanged sign well over the half


@dataclass(frozen=True)
class MatchedObjects:
    """The detected vehicles on the route."""

    table: ObjectTable  # the rows on the carriageway; `track` is still the vehicle's number in the log
    vehicle: np.ndarray  # that number
    rows_without_subject: int  # rows left out, for the subject vehicle's table has no such time or no place then
    rows_without_place: int  # rows left out, for something is missing
    rows_off_route: int  # rows left out, before or behind the route
    rows_off_road: int  # rows left out, beside the carriageway, or in a lane that is there a little farther on
    lanes_contradicting: int  # rows that stay although lane and place across mean different lanes
    warnings: tuple[str, ...]  # what a user should know


def match_objects(
    geometry: RouteGeometry, log: ObjectLog, subject_log: SubjectLog, subject: MatchedSubject
) -> MatchedObjects:
    """Find the detected vehicles on the route.

    A row whose time lies beside the subject vehicle's, by up to half a sampling interval, is moved to it along with the
    two speeds.

    Raises:
        CaseError: most rows have no time stamp of the subject vehicle's, the road has no lane of that number there, or
            lane and place across contradict each other in too many rows.
    """
    instant, late_s, is_timed = _instants(log, subject_log, subject)
    keep = is_timed & (instant >= 0)
    rows_without_subject = int((~keep).sum())

    has_place = ~np.isnan(log.relative_x_m) & ~np.isnan(log.speed_mps)
    rows_without_place = int((keep & ~has_place).sum())
    keep &= has_place
    instant, table = np.where(keep, instant, 0), subject.table
    offset_m = log.relative_x_m - (log.speed_mps - table.speed_mps[instant]) * late_s
    position_m = np.where(keep, table.position_m[instant] + offset_m, 0.0)
    on_route = (position_m >= 0.0) & (position_m <= geometry.route_length_m)
    rows_off_route = int((keep & ~on_route).sum())
    keep &= on_route

    subject_across_m = lane_centre_m(geometry, subject.edge, table.row) + table.lateral_m
    across_m = subject_across_m[instant] + (-log.relative_y_m if geometry.is_mirrored else log.relative_y_m)
    edge = geometry.edge_at(position_m)
    lanes = match_lanes(geometry, position_m, across_m, log.lane, edge, log.lanes_from_left)
    rows_misplaced = refuse_lanes(geometry, log.file, np.arange(len(keep)), log.lane, keep, lanes)
    contradicts = keep & lanes.contradicts
    share = int(contradicts.sum()) / max(int(keep.sum()), 1)
    if share > MOST_CONTRADICTING:
        expected = (
            f"expected lane (1 = rightmost) and relative_y_m (+ left) to mean one lane; {share:.0%} of the rows "
            f"contradict so."
        )
        raise CaseError(log.file, row_place(int(np.argmax(contradicts))), expected)
    rows_without_place += int((keep & lanes.unknown).sum())
    rows_off_road = int((keep & lanes.off_road).sum()) + rows_misplaced
    keep &= ~lanes.unknown & ~lanes.off_road & ~lanes.no_such_lane
    keep &= _nearest_of_each_instant(instant, log.vehicle, np.abs(late_s), keep)

    rows = np.flatnonzero(keep)
    return MatchedObjects(
        table=ObjectTable(
            instant=instant[rows],
            track=log.vehicle[rows],
            row=lanes.row[rows],
            offset_m=offset_m[rows],
            speed_mps=log.speed_mps[rows],
            lateral_m=lanes.lateral_m[rows],
        ),
        vehicle=log.vehicle[rows],
        rows_without_subject=rows_without_subject,
        rows_without_place=rows_without_place,
        rows_off_route=rows_off_route,
        rows_off_road=rows_off_road,
        lanes_contradicting=int(contradicts.sum()),
        warnings=_object_warnings(
            log, rows_without_subject, rows_without_place, rows_misplaced, int(contradicts.sum())
        ),
    )


def _instants(
    log: ObjectLog, subject_log: SubjectLog, subject: MatchedSubject
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each row that of the subject vehicle, -1 where it has no place, how late the row is, whether it fits.

    Raises:
        CaseError: most rows do not fit.
    """
    after = np.clip(np.searchsorted(subject_log.time_s, log.time_s), 1, len(subject_log.time_s) - 1)
    nearer_before = log.time_s - subject_log.time_s[after - 1] <= subject_log.time_s[after] - log.time_s
    nearest = np.where(nearer_before, after - 1, after)
    late_s = log.time_s - subject_log.time_s[nearest]
    is_timed = np.abs(late_s) <= subject_log.sampling_s / 2 + CLOCK_TOLERANCE_S
    if len(is_timed):
        expected = f"expected a time stamp of {shorten(subject_log.file.name)}; it has none near"
        refuse_if_most(log.file, ~is_timed, expected)
    place_of_row = np.full(len(subject_log.time_s), -1)
    place_of_row[subject.log_row] = np.arange(len(subject.log_row))
    return place_of_row[nearest], late_s, is_timed


def _nearest_of_each_instant(
    instant: np.ndarray, vehicle: np.ndarray, late_s: np.ndarray, keep: np.ndarray
) -> np.ndarray:
    """Which rows to keep where objects were sampled more often than the subject vehicle."""
    rows = np.flatnonzero(keep)
    rows = rows[np.lexsort((late_s[rows], vehicle[rows], instant[rows]))]
    is_first = (np.diff(instant[rows], prepend=-1) != 0) | (np.diff(vehicle[rows], prepend=-1) != 0)
    nearest = np.zeros(len(keep), bool)
    nearest[rows[is_first]] = True
    return nearest


def _object_warnings(
    log: ObjectLog, rows_without_subject: int, rows_without_place: int, rows_misplaced: int, num_contradicting: int
) -> tuple[str, ...]:
    name, num_rows = log.file.name, len(log.time_s)
    counts = [
        (rows_without_subject, "rows have a time at which the subject vehicle has none or no place; left out"),
        (rows_without_place, "rows have no distance, no speed, or neither lane nor place across; left out"),
        (rows_misplaced, "rows have a lane that the road has only a little before or farther on; left out"),
        (num_contradicting, "rows have a lane other than their place across; the lane counts"),
    ]
    warnings = [f"{name}: {count} of {num_rows} {what}." for count, what in counts if count]
    if not num_rows:
        warnings.append(f"{name}: no rows; measures of the background have nothing to go by.")
    return tuple(warnings + unread_columns(log.extra_columns, name))
