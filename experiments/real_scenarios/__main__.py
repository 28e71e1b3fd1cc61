"""`python -m experiments.real_scenarios FOLDER`: calibrate every case of a folder, and say how they fare."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.table import Table

from experiments.real_scenarios.case_row import TRAFFIC_LEVEL_MEAN, CaseRow, run_case
from experiments.real_scenarios.diagnoses import counted, diagnosed_rows
from experiments.results.record import Row
from experiments.results.record import record as keep
from experiments.results.terminal import as_table
from jaxcalib.calibration.objective.accuracy import VEHICLE_LEVEL_SUM
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.cli.guarded import guarded
from jaxcalib.errors import CaseError
from jaxcalib.runs.disk import check_out

LEVELS = {VEHICLE_LEVEL_SUM: "vehicle level", TRAFFIC_LEVEL_MEAN: "traffic"}
app = App(name="experiments.real_scenarios", help="How a folder of cases fares.")


@app.default
def real_scenarios(
    folder: Path,
    /,
    *,
    out: Path = Path("real_scenarios"),
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100))] = 1.0,
    only: tuple[str, ...] = (),
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Check and calibrate every case of a folder; what has a result in OUT already is read.

    Parameters
    ----------
    folder
        Folder of cases, each a folder with case.toml.
    out
        Folder for a RUN of each case.
    budget
        Factor on the numbers of simulation runs.
    only
        Names of cases, the option once for each; all by default.
    record
        Keep the table in experiments/results.
    """
    return guarded(
        lambda: _study(folder, out, budget, only, record),
        "the same command goes on where it stopped.",
        program="experiments.real_scenarios",
    )


@app.command
def diagnoses(runs: Path, /, *, record: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Say what diagnoses of such cases answer, whose logs hold no effect.

    Parameters
    ----------
    runs
        Folder with a RUN of `jaxcalib diagnose` for each case.
    record
        Keep the table in experiments/results.
    """
    rows, title = diagnosed_rows(runs), "Public scenarios without effects, diagnosed"
    Console().print(as_table(rows, title))
    Console().print(counted(rows))
    if record:
        keep("diagnosis", "public_roads", rows, title, [f"- {counted(rows)}"])
    return 0


def _study(folder: Path, out: Path, budget: float, only: Sequence[str], record: bool) -> str:
    cases = sorted(file.parent for file in folder.glob(f"*/{FILE_NAME}"))
    cases = [case for case in cases if not only or case.name in only]
    if not cases:
        raise CaseError(str(folder), "", f"expected folders with {FILE_NAME}; there are none.")
    check_out(out)
    out.mkdir(parents=True, exist_ok=True)
    console, rows = Console(stderr=True), []
    for number, case in enumerate(cases, 1):
        console.print(f"{number} of {len(cases)}: {case.name}", highlight=False)
        rows.append(run_case(case, out, budget))
        console.print(f"  {rows[-1].ending} {rows[-1].words}".rstrip(), highlight=False, markup=False)
    Console().print(shown(rows))
    if record:
        keep("real_scenarios", "cases", table_of(rows), "Public scenarios, as published", _notes(rows))
    return "\n".join(f"{what}: {share}" for what, share in shares(rows).items())


def shares(rows: Sequence[CaseRow]) -> dict[str, str]:
    """Return how many of the cases fare well, by what is asked of them."""
    ended = [row for row in rows if row.ending == "result"]
    better = [row for row in ended if all(row.is_better(level) for level in LEVELS)]
    return {
        "end with a result": f"{len(ended)} of {len(rows)}",
        **{
            f"of these, {words} error lower than before or at its noise floor": (
                f"{sum(row.is_better(level) for row in ended)} of {len(ended)}"
            )
            for level, words in LEVELS.items()
        },
        "of these, both": f"{len(better)} of {len(ended)}",
        "of these, surrogate alike in nine tenths of the sections, or SUMO alone and why": (
            f"{sum(row.is_followed_or_left for row in ended)} of {len(ended)}"
        ),
    }


def table_of(rows: Sequence[CaseRow]) -> list[Row]:
    """Return the table as it is kept."""
    return [_cells(row) for row in rows]


def shown(rows: Sequence[CaseRow]) -> Table:
    """Return the table for a terminal."""
    return as_table(table_of(rows), "cases, from folder to result")


def _cells(row: CaseRow) -> Row:
    errors = {}
    for level, words in LEVELS.items():
        before, after, floor, high = row.errors[level] if row.errors else (float("nan"),) * 4
        errors[f"{words}: before, after, floor (95 %)"] = (
            f"{before:.2f}, {after:.2f}, {floor:.2f} ({high:.2f})" if row.errors else None
        )
    return {
        "case": row.name,
        "ending": row.ending,
        "check, s": round(row.check_s, 1),
        "calibrate, s": round(row.calibrate_s) if row.ending == "result" else None,
        "search in": ("SUMO" if row.in_sumo else "surrogate") if row.ending == "result" else None,
        **errors,
        "sections alike": None if row.share_alike is None else f"{row.share_alike:.0%}",
        "why": row.words or None,
    }


def _notes(rows: Sequence[CaseRow]) -> list[str]:
    return [f"- {what}: {share}" for what, share in shares(rows).items()]


if __name__ == "__main__":
    sys.exit(app())
