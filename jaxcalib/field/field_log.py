"""A recorded drive, matched to the route and cleaned: what the measures of the field are taken from."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxcalib.case.case import Case, Drive, Role
from jaxcalib.field.even_clock import EvenDrive, to_even_clock
from jaxcalib.field.log_cleaning import GAP_TOLERANCE, CleaningRules, clean_tracks, rules_for
from jaxcalib.field.log_tables import (
    EARLY_START_S,
    ObjectLog,
    SubjectLog,
    read_object_log,
    read_subject_log,
)
from jaxcalib.field.logged_motion import logged_motion
from jaxcalib.field.matched_objects import match_objects
from jaxcalib.field.matched_subject import MatchedSubject, match_subject
from jaxcalib.field.object_places import at_front, front_to_front, lacks_length, with_distances
from jaxcalib.field.physics.impossible_tracks import ImpossibleRows, impossible_rows
from jaxcalib.field.physics.motion import DriveMotion
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from jaxcalib.field.sensor_errors import SensorErrors, without_errors
from sim_adapters.frame_table import ObjectTable, SubjectTable, stack_frames
from sim_adapters.scenario.road_builder import RowMap
from surrogate.road.perception import PerceptionFrame


@dataclass(frozen=True)
class DriveCounts:
    """What became of the rows of a drive's tables."""

    subject_rows: int  # rows of the subject vehicle's table
    subject_rows_without_place: int  # left out, for longitude, latitude or speed is missing
    object_rows: int  # rows of the objects' table
    rows_without_subject: int  # left out, for the subject vehicle's table has no such time
    rows_without_place: int  # left out, for distance, speed, or both lane and place across are missing
    rows_off_route: int  # left out, before the route's beginning or behind its end
    rows_off_road: int  # left out, beside the carriageway
    rows_of_fragments: int  # left out with episodes that were too short
    lanes_contradicting: int  # rows that stay although lane and place across mean different lanes
    fragments: int  # episodes that were too short
    splits: int  # jumps that split a track
    long_gaps: int  # gaps that were too long to bridge
    tracks: int  # tracks that stay
    rows_without_length: int = 0  # whose distance needs the vehicle's length, which is missing
    rows_impossible: int = 0  # left out, of tracks that no vehicle of the traffic can have made


@dataclass(frozen=True)
class DriveLog:
    """A drive at the sampling that it was recorded with; SI units, rows of the road instead of lanes."""

    id: str  # name of the drive
    role: Role  # whether the calibration may use it
    subject: SubjectTable  # the subject vehicle
    yaw_rate_radps: np.ndarray  # its angular velocity, one value per row of `subject`; nan where unknown
    objects: ObjectTable  # the detected vehicles
    # for each row of `objects` the number of its episode; nothing may be interpolated between episodes
    episode: np.ndarray
    ahead_m: float  # range of the sensors ahead
    behind_m: float  # range behind
    rules: CleaningRules  # limits of the cleaning
    counts: DriveCounts  # what became of the tables' rows
    warnings: tuple[str, ...]  # what a user should know, one line each

    def on_clock(self, interval_s: float) -> EvenDrive:
        """Return the drive at the multiples of an interval; see `jaxcalib.field.even_clock`."""
        if not interval_s > 0.0:
            raise ValueError(f"Expected an interval > 0 s; got {interval_s!r}.")
        longest_gap_s = self.rules.longest_gap_s * (1 + GAP_TOLERANCE)
        return to_even_clock(self.subject, self.objects, self.episode, interval_s, longest_gap_s)

    def frames(self, interval_s: float, least_places: int = 96) -> PerceptionFrame:
        """What the subject vehicle detected at the multiples of an interval.

        Args:
            interval_s: interval of the clock.
            least_places: places for objects per frame, at least.

        Returns:
            A `PerceptionFrame` with a leading time axis; `valid` is False in gaps of the subject vehicle's log.
        """
        even = self.on_clock(interval_s)
        frames = stack_frames(even.subject, even.objects, self.ahead_m, self.behind_m, least_places)
        return dataclasses.replace(frames, valid=even.valid)


@dataclass(frozen=True)
class DriveTables:
    """The tables of a drive, the subject vehicle found on the route."""

    subject_log: SubjectLog
    object_log: ObjectLog  # less the rows that cannot be
    subject: MatchedSubject
    motion: DriveMotion  # what its physics is judged by
    impossible: ImpossibleRows  # rows of the objects' table that were left out
    left_out_objects: ObjectLog  # these rows

    def corrected(self, errors: SensorErrors) -> "DriveTables":
        """The tables with objects less what sensors got wrong."""
        return dataclasses.replace(self, object_log=without_errors(self.object_log, self.motion, errors))


def clock_of(case: Case, drive: Drive) -> tuple[float, float]:
    """First and last time that a drive's tables may have."""
    return drive.depart_s - EARLY_START_S, case.scenario.duration_s if case.scenario else np.inf


def read_drive(
    case: Case,
    drive: Drive,
    row_map: RowMap,
    geometry: RouteGeometry | None = None,
    rules: CleaningRules | None = None,
) -> DriveLog:
    """Read the tables of a drive, find everything on the route and clean the tracks.

    Args:
        case: the case.
        drive: one of its drives.
        row_map: rows of the lanes along the subject vehicle's route.
        geometry: of that route, if it is there already.
        rules: limits of the cleaning.

    Raises:
        CaseError: a table is wrong, see `jaxcalib.field.log_tables`, or does not fit the road, see
            `jaxcalib.field.matched_subject` and `jaxcalib.field.matched_objects`.
    """
    geometry = geometry or build_route_geometry(row_map)
    return lay_out(case, drive, geometry, read_tables(case, drive, geometry), rules)


def read_tables(case: Case, drive: Drive, geometry: RouteGeometry) -> DriveTables:
    """Read the tables of a drive, find the subject vehicle on the route, and leave out what cannot be.

    Raises:
        CaseError: a table is wrong, or the subject vehicle's does not fit the road.
    """
    form, clock = case.log_form.with_time_zero(drive.time_zero), clock_of(case, drive)
    subject_log = read_subject_log(drive.subject_file, *clock, form=form)
    object_log = read_object_log(drive.objects_file, *clock, form=form)
    placed = match_subject(geometry, subject_log)
    length_m = case.perception.nominal_length_m
    object_log = front_to_front(with_distances(geometry, object_log, placed), form, length_m)
    subject = at_front(placed, form, length_m)
    motion = logged_motion(geometry, drive, subject_log, subject, object_log)
    impossible = impossible_rows(motion)
    left_out = impossible.any
    return DriveTables(
        subject_log=subject_log,
        object_log=object_log.without(left_out),
        subject=subject,
        motion=motion.without(left_out),
        impossible=impossible,
        left_out_objects=object_log.without(~left_out),
    )


def lay_out(
    case: Case, drive: Drive, geometry: RouteGeometry, tables: DriveTables, rules: CleaningRules | None = None
) -> DriveLog:
    """Find the detected vehicles of a drive on the route and clean their tracks.

    Raises:
        CaseError: they do not fit the road.
    """
    subject_log, subject, left_out = tables.subject_log, tables.subject, tables.impossible.any
    rules = rules or rules_for(subject_log.sampling_s)
    objects = match_objects(geometry, tables.object_log, subject_log, subject)

    table = objects.table
    clean = clean_tracks(subject.table.time_s[table.instant], objects.vehicle, table.offset_m, table.speed_mps, rules)
    cleaned = {field.name: getattr(table, field.name)[clean.keep] for field in dataclasses.fields(table)}
    cleaned["track"] = clean.track[clean.keep]
    counts = DriveCounts(
        subject_rows=len(subject_log.time_s),
        subject_rows_without_place=len(subject_log.time_s) - len(subject.log_row),
        object_rows=len(left_out),
        rows_without_subject=objects.rows_without_subject,
        rows_without_place=objects.rows_without_place,
        rows_off_route=objects.rows_off_route,
        rows_off_road=objects.rows_off_road,
        rows_of_fragments=int((~clean.keep).sum()),
        lanes_contradicting=objects.lanes_contradicting,
        fragments=clean.num_fragments,
        splits=clean.num_splits,
        long_gaps=clean.num_gaps,
        tracks=clean.num_tracks,
        rows_without_length=int(lacks_length(tables.object_log, case.log_form).sum()),
        rows_impossible=int(left_out.sum()),
    )
    warnings = [*subject.warnings, *objects.warnings]
    if clean.num_splits:
        warnings.append(f"{drive.objects_file.name}: {clean.num_splits} jumps; each one begins a new track.")
    return DriveLog(
        id=drive.id,
        role=drive.role,
        subject=subject.table,
        yaw_rate_radps=subject.yaw_rate_radps,
        objects=ObjectTable(**cleaned),
        episode=clean.episode[clean.keep],
        ahead_m=case.perception.ahead_m,
        behind_m=case.perception.behind_m,
        rules=rules,
        counts=counts,
        warnings=tuple(warnings),
    )
