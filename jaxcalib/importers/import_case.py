"""One call makes a case of a recording: tables, the scenario if the recording shows its road, case.toml."""

import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import sumolib

from jaxcalib.case.case import Role
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError
from jaxcalib.importers.importer import Imported, ImportedDrive, ImportOptions
from jaxcalib.importers.registry import load_importer
from jaxcalib.importers.straight_road import write_scenario
from jaxcalib.new_case.case_text import case_text
from jaxcalib.new_case.logged_route import logged_route
from jaxcalib.new_case.new_case import NewLogs, write_case
from jaxcalib.new_case.recorded_drives import RecordedDrive, read_recorded_drives, roles_of
from jaxcalib.new_case.scenarioless import tables_without_scenario
from jaxcalib.runs.disk import writing_to
from sim_adapters.scenario.configuration import read_configuration

FIELD, SCENARIO = "field", "scenario"
STRANGE = re.compile(r"[^A-Za-z0-9._-]+")
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
    imported = load_importer(name)(source, options)
    was_there = folder.is_dir()
    with writing_to(folder):
        (folder / FIELD).mkdir(parents=True, exist_ok=True)
        try:
            return [*imported.said, *_write(folder, imported, options)]
        except BaseException:
            shutil.rmtree(folder)
            if was_there:
                folder.mkdir()
            raise


def _write(folder: Path, imported: Imported, options: ImportOptions) -> list[str]:
    drives = _named(imported.drives)
    tables = [_write_tables(folder / FIELD, drive) for drive in drives]
    recorded, left_out = read_recorded_drives(tables)
    if options.config is not None:
        recorded, elsewhere = _on_one_route(recorded, options.config)
        left_out = (*left_out, *elsewhere)
    kept: dict[str, Role | None] = {drive.id: drive.role for drive in drives}
    guessed = roles_of(len(recorded))
    roles: tuple[Role, ...] = tuple(kept.get(drive.id) or role for drive, role in zip(recorded, guessed, strict=True))
    logs = NewLogs(recorded, left_out, roles=roles)
    said = [*left_out, f"{len(recorded)} drives, {sum(role == 'held_out' for role in roles)} of them held out."]
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


def _on_one_route(drives: Sequence[RecordedDrive], config: Path) -> tuple[tuple[RecordedDrive, ...], tuple[str, ...]]:
    """Drives along the way of the one that got farthest, and a line for each that went elsewhere."""
    net = sumolib.net.readNet(str(read_configuration(config).net_file))
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
    main = set(routes[max(placed, key=lambda drive: drive.driven_m).id])
    kept = tuple(drive for drive in placed if set(routes[drive.id]) <= main)
    said += [f"drive {drive.id} is left out: it takes another way." for drive in placed if drive not in kept]
    return kept, tuple(said)


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
