"""`python -m experiments.log_faults CASE`: put faults into the logs of a case, and say which are found."""

import dataclasses
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from cyclopts import App, Parameter
from rich.console import Console
from rich.table import Table as Shown

from experiments.log_faults.faults import FAULTS, Fault
from experiments.results.record import record as keep
from jaxcalib.case.case import Case, read_case, require_scenario
from jaxcalib.cli.guarded import guarded
from jaxcalib.field.drive_logs import read_drives
from jaxcalib.problem.drive_warnings import departure_warnings, one_sided_warnings
from jaxcalib.problem.inputs import read_scenario_of
from jaxcalib.problem.problem_checks import drive_faults
from sim_adapters.scenario.scenario import Scenario

INTERVAL_S = 0.5
Tables = dict[str, tuple[Any, Any]]
app = App(name="experiments.log_faults", help="Which faults of logs are found.")


@app.default
def log_faults(case: Path, /, *, record: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Put each fault into the logs of a case: into the first drive alone, and into all of them.

    Parameters
    ----------
    case
        Folder with case.toml and logs that are right.
    record
        Keep the table in experiments/results.
    """

    def work() -> str:
        rows = list(_rows(read_case(case)))
        _show(rows)
        if record:
            keep("log_faults", case.name, rows, f"Faults put into the logs of {case.name}", _notes(rows))
        return ""

    return guarded(work, "nothing was written.")


def _rows(case: Case) -> Iterator[dict[str, Any]]:
    scenario, _ = read_scenario_of(require_scenario(case))
    tables = {drive.id: (_read(drive.subject_file), _read(drive.objects_file)) for drive in case.drives}
    good = _lines(case, scenario, tables)
    for name, fault in FAULTS.items():
        for where in ("all drives",) if fault.is_small else ("one drive", "all drives"):
            spoilt = [case.drives[0].id] if where == "one drive" else list(tables)
            refusals, warnings = _lines(case, scenario, _spoilt(tables, fault, spoilt))
            new = [line for line in (*refusals, *warnings) if line not in {*good[0], *good[1]}]
            cause = next((line for line in new if re.search(fault.cause, line)), "")
            print(f"{name}, {where}: {cause or new[:1]}", file=sys.stderr)
            yield {
                "fault": fault.words,
                "in": where,
                "found": bool(new),
                "cause named": bool(cause),
                "refused": bool(refusals),
                "says": cause or next(iter(new), ""),
            }


def _read(file: Path) -> Any:
    return pd.read_parquet(file) if file.name.endswith(".parquet") else pd.read_csv(file)


def _spoilt(tables: Tables, fault: Fault, drives: Sequence[str]) -> Tables:
    return {name: fault.spoil(*pair) if name in drives else pair for name, pair in tables.items()}


def _lines(case: Case, scenario: Scenario, tables: Tables) -> tuple[list[str], list[str]]:
    """What is said of tables: refusals and warnings."""
    with tempfile.TemporaryDirectory() as folder:
        drives = []
        for drive in case.drives:
            files = [Path(folder) / f"{drive.id}_{part}.parquet" for part in ("subject", "objects")]
            for table, file in zip(tables[drive.id], files, strict=True):
                table.assign(**{name: table[name].astype(str) for name in ("road",) if name in table}).to_parquet(
                    file, index=False
                )
            drives.append(dataclasses.replace(drive, subject_file=files[0], objects_file=files[1]))
        spoilt = dataclasses.replace(case, drives=tuple(drives))
        logs = read_drives(spoilt, scenario.row_map)
        is_seen = [bool(np.any(drive.on_clock(INTERVAL_S).valid)) for drive in logs.drives]
        refusals = [*logs.refusals, *drive_faults(logs.case, logs.drives, is_seen, INTERVAL_S)]
        warnings = [*logs.left_out, *logs.contradictions, *departure_warnings(spoilt, logs.drives)]
        warnings += one_sided_warnings(spoilt, logs.drives)
        warnings += [line for drive in logs.drives for line in drive.warnings]
        return [str(refusal) for refusal in refusals], warnings


def _notes(rows: Sequence[dict[str, Any]]) -> list[str]:
    total, named = len(rows), sum(row["cause named"] for row in rows)
    return [f"{sum(row['found'] for row in rows)} of {total} found, the cause named in {named} ({named / total:.0%})."]


def _show(rows: Sequence[dict[str, Any]]) -> None:
    table = Shown(*rows[0])
    for row in rows:
        table.add_row(*("yes" if cell is True else "no" if cell is False else str(cell) for cell in row.values()))
    console = Console(width=160)
    console.print(table)
    for line in _notes(rows):
        console.print(line)


if __name__ == "__main__":
    sys.exit(app())
