"""One call makes a case: the scenario and the logs stay where they are, case.toml says how they belong together."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import sumolib

from jaxcalib.case.case import Role
from jaxcalib.case.case_file import FILE_NAME, read_log_section
from jaxcalib.case.log_form import TABLE_1, LogForm
from jaxcalib.case.log_units import log_form_of
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.route_geometry import build_route_geometry
from jaxcalib.new_case.case_text import Line, NewDrive, Table, case_text
from jaxcalib.new_case.guesses import (
    USUAL_RANGE_M,
    Drivers,
    depart_s,
    drivers_of,
    end_s,
    entrances_of,
    filling_s,
    on_scenario_clock,
    range_m,
    warmup_s,
)
from jaxcalib.new_case.logged_route import logged_route
from jaxcalib.new_case.recorded_drives import RecordedDrive, read_recorded_drives, roles_of
from jaxcalib.new_case.subject_vehicle import ROUTE_FILE, add_subject, find_subject, path_from
from jaxcalib.runs.disk import writing_to
from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import SumoConfiguration, read_configuration
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.sumo.loading import load_in_sumo


@dataclass(frozen=True)
class NewLogs:
    """The drives of a new case."""

    drives: tuple[RecordedDrive, ...]
    left_out: tuple[str, ...]  # one line for each drive without rows
    form: LogForm = TABLE_1  # how their tables are written
    text: str = ""  # section [log] of case.toml, which says the same
    roles: tuple[Role, ...] = ()  # of the drives; a third is held out where there are none

    @property
    def all_roles(self) -> tuple[Role, ...]:
        """Roles of the drives."""
        return self.roles or tuple(roles_of(len(self.drives)))


def make_case(
    folder: Path,
    config: Path,
    tables: Sequence[tuple[Path, Path]],
    subject: str | None = None,
    log_file: Path | None = None,
) -> tuple[str, ...]:
    """Make a case.

    Args:
        folder: of the case; empty, or not there yet.
        config: the scenario's .sumocfg.
        tables: for each drive the subject vehicle's table and the detected vehicles'.
        subject: id of the subject vehicle; found, or added, unless given.
        log_file: a file with section [log], which says how the tables are written; Table 1 unless given.

    Returns:
        One line for each thing that was left out or added.

    Raises:
        CaseError: something in scenario or logs is wrong; nothing is left behind then.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CaseError(folder, "", "expected an empty folder, or a path where none is yet.")
    section, log_text = (None, "") if log_file is None else read_log_section(log_file)
    form = log_form_of(section, log_file or FILE_NAME)
    drives, left_out = read_recorded_drives(tables, form)
    was_there = folder.is_dir()
    with writing_to(folder):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            return (*left_out, *write_case(folder, config, NewLogs(drives, left_out, form, log_text), subject))
        except BaseException:
            for entry in folder.iterdir():
                entry.unlink()
            if not was_there:
                shutil.rmtree(folder)
            raise


def write_case(folder: Path, config: Path, logs: NewLogs, subject: str | None = None) -> list[str]:
    """Write case.toml, and a subject vehicle where the scenario has none, into a folder that is there.

    Raises:
        CaseError: something in scenario or logs is wrong.
    """
    try:
        return _write(folder, config, logs, subject)
    except ScenarioError as error:
        raise CaseError(error.file, "", error.message) from None


def _write(folder: Path, config: Path, logs: NewLogs, subject: str | None) -> list[str]:
    configuration = read_configuration(config)
    drives = on_scenario_clock(logs.drives, configuration, logs.form)
    read_xml(configuration.net_file)  # refuses what sumolib would read without a word
    said: list[str] = []
    comment = "as asked for"
    if subject is None:
        farthest = max(drives, key=lambda drive: drive.driven_m)
        route = logged_route(sumolib.net.readNet(str(configuration.net_file)), farthest)
        found = find_subject(configuration, route)
        if found is None:
            config, subject = _added(folder, configuration, drives, route)
            comment = f"guess: the scenario has none; {ROUTE_FILE} adds it along the logged route"
            said.append(f"{ROUTE_FILE}: the scenario has no subject vehicle; this one drives along the logged route.")
        else:
            subject, how = found
            comment = f"guess: {how}"
    last_s = end_s(drives)
    until_s = last_s if configuration.end_s is None else min(last_s, configuration.end_s)
    scenario = read_scenario(config, subject, until_s, load_in_sumo)
    tables = [
        *_scenario_tables(folder, config, scenario, drives, until_s),
        Table("[subject]", (Line("vtype", scenario.demand.subject_vtype), Line("vehicle", subject, comment))),
        *_traffic_tables(scenario, drives),
        *_drive_tables(folder, scenario, replace(logs, drives=drives)),
    ]
    (folder / FILE_NAME).write_text(case_text(_name(folder), tables, logs.text), encoding="utf-8")
    return said


def _added(
    folder: Path, configuration: SumoConfiguration, drives: Sequence[RecordedDrive], route: Sequence[str]
) -> tuple[Path, str]:
    highest_mps = max(float(np.nanmax(drive.log.speed_mps)) for drive in drives)
    return add_subject(configuration, folder, route, min(drive.begin_s for drive in drives), highest_mps)


def _name(folder: Path) -> str:
    name = "".join(c for c in folder.resolve().name if c.isprintable())[:100]
    return name or "case"


def _scenario_tables(
    folder: Path, config: Path, scenario: Scenario, drives: Sequence[RecordedDrive], until_s: float
) -> list[Table]:
    configuration = scenario.configuration
    first_s = min(depart_s(scenario, build_route_geometry(scenario.row_map), drive) for drive in drives)
    filling = filling_s(scenario, drives)
    warm_s = warmup_s(configuration.begin_s, first_s, filling)
    why = f"guess: the road fills in about {filling:.0f} s"
    if warm_s == first_s:
        why += ", but the first drive departs now" if first_s - configuration.begin_s < filling else ""
    if until_s == configuration.end_s:
        end = "end of the configuration"
    else:
        end = "guess: last row and once more the longest drive, for simulated ones may be slower"
    return [
        Table(
            "[scenario]",
            (
                Line("config", path_from(folder, config)),
                Line("warmup_s", warm_s, why),
                Line("duration_s", until_s, end),
                Line("step_s", configuration.step_s, "step-length of the configuration"),
            ),
        )
    ]


def _traffic_tables(scenario: Scenario, drives: Sequence[RecordedDrive]) -> list[Table]:
    drivers = drivers_of(scenario)
    ahead_m, behind_m = range_m([drive.ahead_m for drive in drives]), range_m([drive.behind_m for drive in drives])
    seen, unseen = "guess: farthest object of the logs, rounded up", "guess: the logs have no object there"
    length_m = scenario.values_of(drivers.vtypes[0])["length"]
    return [
        Table(
            "[perception]",
            (
                Line("ahead_m", ahead_m or USUAL_RANGE_M, seen if ahead_m else unseen),
                Line("behind_m", behind_m or USUAL_RANGE_M, seen if behind_m else unseen),
                Line("reference", "front"),
                Line("nominal_length_m", length_m, f"guess: length of vType {quote(drivers.vtypes[0])}"),
            ),
        ),
        Table(
            "[behaviour]",
            (
                Line("vtypes", drivers.vtypes, _said_of(drivers)),
                Line("car_following", drivers.car_following, "as in the vType"),
            ),
            ('parameters = ["tau", "minGap"] would let only these move; otherwise the list of docs/parameters.md.',),
        ),
        *(
            Table(
                "[[input]]",
                (
                    Line("id", entrance.id, f"the edge; {entrance.rate_vehph:.0f} veh/h in the scenario"),
                    Line("flows", entrance.flows),
                ),
            )
            for entrance in entrances_of(scenario)
        ),
    ]


def _said_of(drivers: Drivers) -> str:
    if not drivers.others:
        return "all that drive on the route"
    others = ", ".join(map(quote, drivers.others))
    return f"guess: most of the traffic, alike in model, class and length; not moved: {others}"


def _drive_tables(folder: Path, scenario: Scenario, logs: NewLogs) -> list[Table]:
    geometry = build_route_geometry(scenario.row_map)
    comment = "guess: by the log's first row and place"
    tables = [
        NewDrive(
            drive.id,
            depart_s(scenario, geometry, drive),
            path_from(folder, drive.subject_file),
            path_from(folder, drive.objects_file),
            role,
            drive.time_zero,
        ).table(comment)
        for drive, role in zip(logs.drives, logs.all_roles, strict=True)
    ]
    if logs.roles:
        roles = "Drives of later times are held out."
    elif len(logs.drives) > 1:
        roles = "guess: a third of the drives is held out."
    else:
        roles = "One drive alone: none is held out."
    first = Table(tables[0].name, tables[0].lines, (roles, *logs.left_out))
    return [first, *tables[1:]]
