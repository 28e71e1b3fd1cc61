"""What is drawn of the drives of a case, in plain numbers: as far as it was understood, of drives refused, too."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jaxcalib.case.case import Case, Drive
from jaxcalib.check.check_road import CrossSection, cross_section, evenly, lane_lines, map_plane
from jaxcalib.errors import CaseError
from jaxcalib.field.drive_logs import DriveLogs
from jaxcalib.field.field_log import DriveTables
from jaxcalib.field.log_tables import CLOCK_TOLERANCE_S, ObjectLog, SubjectLog, read_object_log, read_subject_log
from jaxcalib.field.map_matching import lane_centre_m, match_lanes
from jaxcalib.field.physics.impossible_tracks import WORDS
from jaxcalib.field.physics.motion import LONGEST_STEP_S

HALF_WINDOW_S = 1.0  # before and after: places are off by a metre or so, which the way in two seconds outweighs
MOVES_MPS = 0.5
STAYS = -1
OFF_ROUTE, OFF_ROAD = "off_route", "off_road"
KINDS: Mapping[str, str] = {
    **WORDS,
    OFF_ROUTE: "before the route's beginning or behind its end",
    OFF_ROAD: "beside the carriageway",
}
NUMBER_OF = {kind: number for number, kind in enumerate(KINDS)}


@dataclass(frozen=True)
class DriveRecord:
    """A drive as it is drawn; SI units, nan where the log says nothing."""

    id: str
    role: str
    is_placed: bool  # whether it was laid onto the road, or along its own way; otherwise all is as the log has it
    has_lanes: bool  # whether places across the road are in the one coordinate that the route's lanes have
    num_subject_rows: int
    time_s: np.ndarray  # of the subject vehicle's rows that have a place
    speed_mps: np.ndarray  # as logged
    shown_speed_mps: np.ndarray  # by the way between the places
    own_across_m: np.ndarray  # where the vehicle is in the coordinate of `across_m`
    object_time_s: np.ndarray
    relative_x_m: np.ndarray  # along the road from the subject vehicle, + ahead
    across_m: np.ndarray  # across the road, + left; from the subject vehicle where it has no lanes
    faster_mps: np.ndarray  # the object's speed less the subject vehicle's
    kind: np.ndarray  # number of KINDS, why the row is left out; STAYS where it is not

    @property
    def counts(self) -> dict[str, int]:
        """How many rows are left out for each reason that there is."""
        return {kind: count for kind, number in NUMBER_OF.items() if (count := int(np.sum(self.kind == number)))}

    @property
    def shown_over_logged(self) -> float:
        """How many times the logged speed the places show, typically; nan where the vehicle does not move."""
        moves = (self.speed_mps > MOVES_MPS) & np.isfinite(self.shown_speed_mps)
        return float(np.median(self.shown_speed_mps[moves] / self.speed_mps[moves])) if np.any(moves) else np.nan


@dataclass(frozen=True)
class LogRecords:
    """What is drawn of a case's logs."""

    lanes_xy_m: tuple[np.ndarray, ...]  # centre line of each row of lanes, nan between its pieces; none without road
    borders_m: Mapping[float, float]  # borders of lanes across the road, + left, with their share of the route
    ways_xy_m: Mapping[str, np.ndarray]  # places of every drive that could be read, by its id
    drives: tuple[DriveRecord, ...]  # the drives that are shown
    ahead_m: float  # range of the sensors
    behind_m: float


def log_records(case: Case, logs: DriveLogs | None, most: int, preferred: frozenset[str] = frozenset()) -> LogRecords:
    """Return what is drawn.

    Args:
        case: the case.
        logs: what was read of its drives; None where nothing could be laid anywhere.
        most: drives to be shown.
        preferred: ids of drives that are shown in any case, if these are not too many.
    """
    road = None if logs is None else logs.geometry
    first = sorted(case.drives, key=lambda drive: drive.id not in preferred)[:most]  # stable: else in the case's order
    section = None if road is None else cross_section(road)
    placed = {} if logs is None else {drive.id: own for drive, own in logs.tables}
    raw = {drive.id: _raw_logs(case, drive) for drive in first if drive.id not in placed}
    plane = map_plane(
        road, [own.subject_log.place for own in placed.values()] + [log.place for log, _ in raw.values() if log]
    )
    records, ways = [], {}
    for drive in case.drives:
        if own := placed.get(drive.id):
            ways[drive.id] = plane.points(own.subject_log.place, own.subject.log_row[evenly(own.subject.log_row)])
            if drive in first:
                records.append(_placed_record(drive, own, section))
            continue
        log, objects = raw.get(drive.id, (None, None))
        if log is not None:
            rows = np.flatnonzero(~log.place.is_missing)
            xy_m = plane.points(log.place, rows)
            ways[drive.id] = xy_m[evenly(xy_m)]
            own_across_m = None if section is None or plane.road is None else section.beside(xy_m)
            records.append(_raw_record(drive, log, objects, rows, xy_m, own_across_m))
    return LogRecords(
        lanes_xy_m=() if plane.road is None else lane_lines(plane.road),
        borders_m={} if section is None else section.borders_m,
        ways_xy_m=ways,
        drives=tuple(records),
        ahead_m=case.perception.ahead_m,
        behind_m=case.perception.behind_m,
    )


def _raw_logs(case: Case, drive: Drive) -> tuple[SubjectLog | None, ObjectLog | None]:
    """The tables of a drive, whatever the scenario's clock and road are; None for one that cannot be read."""
    form = case.log_form.with_time_zero(drive.time_zero)
    log = objects = None
    with suppress(CaseError):
        log = read_subject_log(drive.subject_file, form=form)
    with suppress(CaseError):
        objects = read_object_log(drive.objects_file, form=form)
    return log, objects


def _placed_record(drive: Drive, own: DriveTables, section: CrossSection | None) -> DriveRecord:
    """A drive that was laid onto the road, or along its own way where there is none."""
    motion, table = own.motion, own.subject.table
    impossible = own.impossible.any
    objects = _joined(own.object_log, own.left_out_objects)
    kind = np.full(len(objects.time_s), STAYS)
    num_kept = len(own.object_log.time_s)
    for name, rows in own.impossible.by_kind.items():
        kind[num_kept:][rows[impossible]] = NUMBER_OF[name]
    own_across_m, across_m = np.zeros(len(table.time_s)), objects.relative_y_m
    if section is not None:
        here_m = lane_centre_m(section.road, own.subject.edge, table.row) + table.lateral_m
        own_across_m = section.laid(own.subject.edge, here_m)
        across_m = _on_road(section, own, objects, kind, here_m)
    return DriveRecord(
        id=drive.id,
        role=drive.role,
        is_placed=True,
        has_lanes=section is not None,
        num_subject_rows=len(own.subject_log.time_s),
        time_s=motion.time_s,
        speed_mps=motion.speed_mps,
        shown_speed_mps=shown_speed_mps(motion.time_s, motion.position_m[:, None]),
        own_across_m=own_across_m,
        object_time_s=objects.time_s,
        relative_x_m=objects.relative_x_m,
        across_m=across_m,
        faster_mps=objects.speed_mps - np.interp(objects.time_s, motion.time_s, motion.speed_mps),
        kind=kind,
    )


def _raw_record(
    drive: Drive,
    log: SubjectLog,
    objects: ObjectLog | None,
    rows: np.ndarray,
    xy_m: np.ndarray,
    own_across_m: np.ndarray | None,
) -> DriveRecord:
    """A drive that could not be laid anywhere, as its tables have it; `rows` of the subject vehicle's have a place."""
    nothing = np.zeros(0)
    time_s, speed_mps = log.time_s[rows], log.speed_mps[rows]
    object_time_s = nothing if objects is None else objects.time_s
    own_mps, from_m = np.full((2, len(object_time_s)), np.nan)
    if len(rows):
        own_mps = np.interp(object_time_s, time_s, speed_mps)
        from_m = 0.0 if own_across_m is None else np.interp(object_time_s, time_s, own_across_m)
    return DriveRecord(
        id=drive.id,
        role=drive.role,
        is_placed=False,
        has_lanes=own_across_m is not None,
        num_subject_rows=len(log.time_s),
        time_s=time_s,
        speed_mps=speed_mps,
        shown_speed_mps=shown_speed_mps(time_s, xy_m),
        own_across_m=np.zeros(len(rows)) if own_across_m is None else own_across_m,
        object_time_s=object_time_s,
        relative_x_m=nothing if objects is None else objects.relative_x_m,
        across_m=nothing if objects is None else from_m + objects.relative_y_m,
        faster_mps=nothing if objects is None else objects.speed_mps - own_mps,
        kind=np.full(len(object_time_s), STAYS),
    )


def shown_speed_mps(time_s: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Speed by the way between places a second before and after; nan beside gaps of the log.

    Args:
        time_s: time of each place, rising.
        places_m: places, [instant, coordinate]; with one coordinate the speed is below 0 where it falls.
    """
    if len(time_s) < 2:
        return np.full(len(time_s), np.nan)
    sampling_s = float(np.median(np.diff(time_s)))
    half_s = max(HALF_WINDOW_S, 1.5 * sampling_s)
    before_s, after_s = np.maximum(time_s - half_s, time_s[0]), np.minimum(time_s + half_s, time_s[-1])
    way_m = np.stack([np.interp(after_s, time_s, x) - np.interp(before_s, time_s, x) for x in places_m.T], axis=1)
    moved_m = way_m[:, 0] if way_m.shape[1] == 1 else np.hypot(way_m[:, 0], way_m[:, 1])
    gaps = np.concatenate([[0], np.cumsum(np.diff(time_s) > max(LONGEST_STEP_S, 1.6 * sampling_s))])
    spans_gap = np.interp(after_s, time_s, gaps) != np.interp(before_s, time_s, gaps)
    return np.where(spans_gap, np.nan, moved_m / (after_s - before_s))


def _joined(objects: ObjectLog, others: ObjectLog) -> ObjectLog:
    columns = ("time_s", "lane", "relative_x_m", "relative_y_m", "speed_mps")
    joined: dict[str, Any] = {name: np.concatenate([getattr(objects, name), getattr(others, name)]) for name in columns}
    return replace(objects, place=None, **joined)


def _on_road(
    section: CrossSection, own: DriveTables, objects: ObjectLog, kind: np.ndarray, here_m: np.ndarray
) -> np.ndarray:
    """Place of objects across the road; enters in `kind` what lies off it, by the rules of `match_objects`."""
    road, table = section.road, own.subject.table
    if len(table.time_s) < 2:
        return np.full(len(objects.time_s), np.nan)
    after = np.clip(np.searchsorted(table.time_s, objects.time_s), 1, len(table.time_s) - 1)
    is_nearer_before = objects.time_s - table.time_s[after - 1] <= table.time_s[after] - objects.time_s
    instant = np.where(is_nearer_before, after - 1, after)
    late_s = objects.time_s - table.time_s[instant]
    offset_m = objects.relative_x_m - (objects.speed_mps - table.speed_mps[instant]) * late_s
    is_timed = np.abs(late_s) <= own.subject_log.sampling_s / 2 + CLOCK_TOLERANCE_S
    is_considered = (kind == STAYS) & is_timed & np.isfinite(offset_m)
    position_m = np.where(np.isfinite(offset_m), table.position_m[instant] + offset_m, 0.0)
    on_route = (position_m >= 0.0) & (position_m <= road.route_length_m)
    across_m, edge = here_m[instant] + section.side * objects.relative_y_m, road.edge_at(position_m)
    lanes = match_lanes(road, position_m, across_m, objects.lane, edge, objects.lanes_from_left)
    kind[is_considered & ~on_route] = NUMBER_OF[OFF_ROUTE]
    kind[is_considered & on_route & (lanes.off_road | lanes.misplaced)] = NUMBER_OF[OFF_ROAD]
    in_lane_m = section.side * section.centre_m[lanes.row]  # its middle, where the log says no more
    in_lane_m[lanes.row < 0] = np.nan
    return np.where(np.isnan(across_m), in_lane_m, section.laid(edge, across_m))
