"""One call makes a case of a recording: tables, the scenario if the recording shows its road, case.toml."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import sumolib
from pyarrow import ArrowException

from jaxcalib.case.case import Role
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.case.log_units import check_crs
from jaxcalib.errors import CaseError, shorten
from jaxcalib.importers.importer import Imported, ImportedDrive, ImportOptions
from jaxcalib.importers.registry import load_importer
from jaxcalib.importers.straight_road import write_scenario
from jaxcalib.importers.virtual_probes import evenly
from jaxcalib.new_case.case_text import case_text
from jaxcalib.new_case.logged_route import logged_route
from jaxcalib.new_case.new_case import NewLogs, write_case
from jaxcalib.new_case.recorded_drives import HELD_OUT_SHARE, RecordedDrive, read_recorded_drives
from jaxcalib.new_case.scenarioless import tables_without_scenario
from jaxcalib.new_case.subject_vehicle import subject_edges
from jaxcalib.runs.disk import writing_to
from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import SumoConfiguration, read_configuration

FIELD, SCENARIO = "field", "scenario"
STRANGE = re.compile(r"[^A-Za-z0-9._-]+")
SPARE = 4  # times the vehicles that are wanted are looked at where some may take another way
AFTER_S = 120.0  # of simulation after the last row: simulated drives may be slower


def import_case(name: str, source: Path, folder: Path, options: ImportOptions) -> list[str]:
    """Make a case.

    Args:
        name: of the format, see `jaxcalib.importers.registry`.
        source: file or folder of the recording.
        folder: of the case; empty, or not there yet.
        options: what the user chose.

    Returns:
        One line for each thing that was taken, converted, left out or guessed.

    Raises:
        CaseError: something in the recording or the scenario is wrong; nothing is left behind then.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise CaseError(folder, "", "expected an empty folder, or a path where none is yet.")
    if not source.exists():
        raise CaseError("command line", "SOURCE", f"expected a file or folder, got '{source}'.")
    if options.crs is not None:
        check_crs(options.crs, "command line", "--crs")
    configuration = None if options.config is None else _configuration(options.config)
    imported = _read(name, source, options)
    was_there = folder.is_dir()
    with writing_to(folder):
        (folder / FIELD).mkdir(parents=True, exist_ok=True)
        try:
            return [*imported.said, *_write(folder, source, imported, configuration, options)]
        except BaseException:
            shutil.rmtree(folder)
            if was_there:
                folder.mkdir()
            raise


def _configuration(config: Path) -> SumoConfiguration:
    try:
        return read_configuration(config)
    except ScenarioError as error:
        raise CaseError(error.file, "", error.message) from None


def _read(name: str, source: Path, options: ImportOptions) -> Imported:
    """Read a recording; more vehicles than are wanted where some may take another way.

    Raises:
        CaseError: the recording is not what the format promises: importers say what they look for, and what else may be
            wrong with a stranger's file is told in the words of the library that stumbled over it.
    """
    wanted = options
    if options.config is not None and not options.subjects:
        wanted = replace(options, probes=SPARE * options.probes)
    try:
        return load_importer(name)(source, wanted)
    except CaseError:
        raise
    except (ArithmeticError, ArrowException, IndexError, KeyError, OSError, TypeError, ValueError) as error:
        what = f"{type(error).__name__} {shorten(str(error), 120)}"
        raise CaseError(
            source, "", f"expected a recording of the format {name}; reading it ends with {what}."
        ) from None


def _write(
    folder: Path, source: Path, imported: Imported, configuration: SumoConfiguration | None, options: ImportOptions
) -> list[str]:
    drives = _named(imported.drives)
    tables = [_write_tables(folder / FIELD, drive) for drive in drives]
    try:
        recorded, left_out = read_recorded_drives(tables)
    except CaseError as error:  # the tables were made of the source
        place = "" if error.place == "--drive" else error.place
        raise CaseError(source, place, error.expected) from None
    range_m = drives[0].range_m
    if configuration is not None:
        recorded, elsewhere = _on_one_route(recorded, configuration)
        left_out = (*left_out, *elsewhere)
        recorded = recorded if options.subjects else tuple(evenly(recorded, options.probes))
    if range_m is not None:  # who looks farther than anybody is seen looks as far all the same
        recorded = tuple(replace(one, ahead_m=range_m, behind_m=range_m) for one in recorded)
    _remove_others(folder / FIELD, recorded)
    logs = NewLogs(recorded, left_out, roles=_later_held_out(len(recorded)) if range_m is not None else ())
    num_held_out = sum(role == "held_out" for role in logs.all_roles)
    said = [*left_out, f"{len(recorded)} drives, {num_held_out} of them held out."]
    config = options.config
    if config is None and imported.road is not None:
        end_s = float(np.ceil(max(drive.end_s for drive in recorded) + AFTER_S))
        config = write_scenario(imported.road, folder / SCENARIO, end_s)
        said.append("scenario/: a straight road as the recording shows it, with its lanes and flows.")
    if config is None:
        tables = tables_without_scenario(logs, folder)
        (folder / FILE_NAME).write_text(case_text(folder.resolve().name or "case", tables), encoding="utf-8")
        return [*said, "no scenario: give --scenario MY.sumocfg for a case that can be calibrated."]
    return [*said, *write_case(folder, config, logs)]


def _on_one_route(
    drives: Sequence[RecordedDrive], configuration: SumoConfiguration
) -> tuple[tuple[RecordedDrive, ...], tuple[str, ...]]:
    """Drives along one way, and a line for each that went elsewhere.

    The way is that of the scenario's own subject vehicle, if it has one, else that which most drives take.
    """
    net = sumolib.net.readNet(str(configuration.net_file))
    routes: dict[str, tuple[str, ...]] = {}
    said: list[str] = []
    for drive in drives:
        try:
            routes[drive.id] = logged_route(net, drive)
        except CaseError as error:
            said.append(f"drive {drive.id} is left out: {error}")
    if not routes:
        raise CaseError("command line", "--scenario", f"expected the recording's road; {said[0]}")
    placed = [drive for drive in drives if drive.id in routes]
    ways = [set(routes[drive.id]) for drive in placed]
    own = set(subject_edges(configuration))
    if any(way <= own for way in ways):
        main = own
    else:
        ranked = [
            (sum(other <= way for other in ways), drive.driven_m) for drive, way in zip(placed, ways, strict=True)
        ]
        main = ways[ranked.index(max(ranked))]
    kept = tuple(drive for drive, way in zip(placed, ways, strict=True) if way <= main)
    elsewhere = len(placed) - len(kept)
    return kept, (*said, *([f"{elsewhere} vehicles that take another way are left out."] if elsewhere else []))


def _later_held_out(num_drives: int) -> tuple[Role, ...]:
    """Hold out the last third: it meets other traffic than the drives to fit, as far as the recordings go."""
    num_fit = num_drives - (max(1, round(HELD_OUT_SHARE * num_drives)) if num_drives > 1 else 0)
    return tuple("fit" if number < num_fit else "held_out" for number in range(num_drives))


def _remove_others(folder: Path, drives: Sequence[RecordedDrive]) -> None:
    kept = {file.name for drive in drives for file in (drive.subject_file, drive.objects_file)}
    for file in folder.iterdir():
        if file.name not in kept:
            file.unlink()


def _named(drives: Sequence[ImportedDrive]) -> list[ImportedDrive]:
    """Drives whose ids can be names of files; numbers where two would have one name."""
    names = [STRANGE.sub("_", drive.id).strip("._-") for drive in drives]
    if len(set(names)) < len(names) or not all(names):
        names = [f"d{number:02d}" for number in range(1, len(drives) + 1)]
    return [replace(drive, id=name) for drive, name in zip(drives, names, strict=True)]


def _write_tables(folder: Path, drive: ImportedDrive) -> tuple[Path, Path]:
    files = folder / f"{drive.id}_subject.parquet", folder / f"{drive.id}_objects.parquet"
    for table, file in zip((drive.subject, drive.objects), files, strict=True):
        table.to_parquet(file, index=False)
    return files
