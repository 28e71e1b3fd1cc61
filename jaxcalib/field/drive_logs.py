"""All drives of a case: read, judged together, laid onto the road; those that are left out, and what is wrong."""

import dataclasses
from dataclasses import dataclass

from jaxcalib.case.case import ROLES, Case, Drive
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.field_log import DriveLog, DriveTables, clock_of, lay_out, read_tables
from jaxcalib.field.log_cleaning import CleaningRules
from jaxcalib.field.log_tables import EmptyLogError, read_object_log, read_subject_log
from jaxcalib.field.own_path import own_path_geometry
from jaxcalib.field.physics.judgement import judge_drives
from jaxcalib.field.route_geometry import RouteGeometry, build_route_geometry
from jaxcalib.field.sensor_errors import HONEST, SensorErrors, measure_sensors
from sim_adapters.scenario.road_builder import RowMap


@dataclass(frozen=True)
class DriveLogs:
    """The drives of a case that have rows."""

    case: Case  # the case with these drives alone
    drives: tuple[DriveLog, ...]  # their logs
    left_out: tuple[str, ...]  # one line for each drive without rows
    refusals: tuple[CaseError, ...]  # what is wrong with the others, and what they contradict themselves in
    contradictions: tuple[str, ...] = ()  # what they contradict themselves in a little, one line each
    # tables of the drives that could be laid onto the road, or along their own way, those that are refused, too
    tables: tuple[tuple[Drive, DriveTables], ...] = ()
    geometry: RouteGeometry | None = None  # of the road; None where each drive was laid along its own way
    sensor_errors: SensorErrors = HONEST  # what the sensors of the drives to fit got wrong


def read_drives(
    case: Case, row_map: RowMap, rules: CleaningRules | None = None, *, corrects_sensors: bool = False
) -> DriveLogs:
    """Read all drives of a case, see `read_drive`; those without rows are left out, unless a role has none left.

    Where the quantities of a drive contradict one another, that is what is wrong with it: that its objects do not fit
    the road may follow from it. If asked to, what sensors got wrong is taken off before drives are laid onto the road.
    """
    geometry = build_route_geometry(row_map)
    tables: list[tuple[Drive, DriveTables]] = []
    empty: list[tuple[Drive, EmptyLogError]] = []
    refusals: list[CaseError] = []
    for drive in case.drives:
        try:
            own = read_tables(case, drive, geometry)
            _check_looked(case, drive, own)
            tables.append((drive, own))
        except EmptyLogError as error:
            empty.append((drive, error))
        except CaseError as error:
            refusals.append(error)
    for role in ROLES:
        of_role = [error for drive, error in empty if drive.role == role]
        if of_role and len(of_role) == len(case.drives_of(role)):
            expected = f"expected rows in one of the drives with role {quote(role)} at least; {of_role[0].expected}"
            refusals.append(CaseError(of_role[0].file, "", expected))
    found = judge_drives([own.motion for _, own in tables], [own.impossible for _, own in tables])
    refusals += [CaseError(one.file, one.column, one.words) for one in found if one.is_refused]
    contradictory = {drive for one in found if one.is_refused for drive in one.drives}
    there: list[tuple[Drive, DriveLog]] = []
    errors = measure_sensors([own.motion for drive, own in tables if drive.role == "fit"], found)
    for drive, own in tables:
        try:
            laid = own.corrected(errors) if corrects_sensors and errors != HONEST else own
            there.append((drive, lay_out(case, drive, geometry, laid, rules)))
        except CaseError as error:
            refusals += [] if drive.id in contradictory else [error]
    return DriveLogs(
        case=dataclasses.replace(case, drives=tuple(drive for drive, _ in there)),
        drives=tuple(log for _, log in there),
        left_out=tuple(f"drive {drive.id} is left out: {error}" for drive, error in empty),
        refusals=tuple(refusals),
        contradictions=tuple(str(one) for one in found if not one.is_refused),
        tables=tuple(tables),
        geometry=geometry,
        sensor_errors=errors,
    )


def _check_looked(case: Case, drive: Drive, tables: DriveTables) -> None:
    """Raise an EmptyLogError for a drive without objects: nobody looked, unless the case says that nobody was there."""
    if not len(tables.impossible.any) and not case.log_form.empty_road:
        todo = "write empty_road = true under [log] of case.toml if the road was empty."
        raise EmptyLogError(drive.objects_file, "", f"expected detected vehicles, got no row; {todo}")


def judge_without_road(case: Case) -> DriveLogs:
    """Judge drives by themselves, each along its own way; nothing is laid onto a road, so no drive comes back."""
    tables: list[tuple[Drive, DriveTables]] = []
    refusals: list[CaseError] = []
    left_out: list[str] = []
    for drive in case.drives:
        try:
            form = case.log_form.with_time_zero(drive.time_zero)
            geometry = own_path_geometry(read_subject_log(drive.subject_file, *clock_of(case, drive), form=form))
            if geometry is None:
                left_out.append(f"drive {drive.id} is not judged: its places mean nothing without the scenario.")
            else:
                tables.append((drive, read_tables(case, drive, geometry)))
        except EmptyLogError as error:
            left_out.append(f"drive {drive.id} is left out: {error}")
        except CaseError as error:
            refusals.append(error)
    found = judge_drives([own.motion for _, own in tables], [own.impossible for _, own in tables])
    refusals += [CaseError(one.file, one.column, one.words) for one in found if one.is_refused]
    contradictions = tuple(str(one) for one in found if not one.is_refused)
    return DriveLogs(case, (), tuple(left_out), tuple(refusals), contradictions, tuple(tables))


def table_faults(case: Case) -> list[CaseError]:
    """What is wrong with the drives' tables by themselves, wherever the road may lie."""
    faults = []
    for drive in case.drives:
        for read, file in ((read_subject_log, drive.subject_file), (read_object_log, drive.objects_file)):
            try:
                read(file, *clock_of(case, drive), form=case.log_form.with_time_zero(drive.time_zero))
            except EmptyLogError:
                continue  # such a drive is left out
            except CaseError as error:
                faults.append(error)
    return faults
