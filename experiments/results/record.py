"""One table of measurements with where it comes from: date, commit, machine and command.

A study is one JSON file of this folder, `{"title": ..., "tables": [...]}`; a table that is recorded again replaces the
one of its name. The Markdown beside it is made from the JSON alone (`experiments.results.markdown`).
"""

import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from experiments.results.markdown import markdown
from jaxcalib.runs.provenance import commit

FOLDER = Path(__file__).parent
NUM_SHOWN = 10  # rows of a table that grows
Cell = str | int | float | bool | None
Row = Mapping[str, Cell]


@dataclass(frozen=True)
class Table:
    """A table of measurements."""

    name: str  # unique in its study
    title: str  # what the table shows, as a heading
    date: str  # day of the measurement, ISO 8601
    commit: str | None  # of the program; ends in "-changed" where files differed from it; None if that is not known
    machine: str  # processor, cores and accelerators
    command: str  # what made it
    rows: Sequence[Row]  # one mapping from column to value each; columns in the order of the first row's keys
    notes: Sequence[str] = ()  # what a reader must know beside it, a paragraph each
    num_shown: int | None = None  # rows on the page, the last ones; all of them if None


def record(
    study: str,
    name: str,
    rows: Sequence[Mapping[str, Any]],
    title: str,
    notes: Sequence[str] = (),
    folder: Path = FOLDER,
    num_shown: int | None = None,
) -> Path:
    """Write a table that this command has just measured into its study, and the study's Markdown anew.

    Args:
        study: name of the study's file.
        name: of the table; one of the same name is replaced.
        rows: mappings that may hold mappings; keys of both are joined by a blank.
        title: what the table shows.
        notes: what a reader must know beside it.
        folder: where studies lie.
        num_shown: how many rows the page shows, the last ones; all of them if None.

    Returns:
        The JSON file.
    """
    table = Table(
        name=name,
        title=title,
        date=datetime.now(UTC).date().isoformat(),
        commit=commit(),
        machine=machine(),
        command=_command(),
        rows=[flattened(row) for row in rows],
        notes=list(notes),
        num_shown=num_shown,
    )
    path = folder / f"{study}.json"
    before = read_study(path) if path.is_file() else {"title": study, "tables": []}
    tables: list[dict[str, Any]] = before["tables"]
    names = [table["name"] for table in tables]
    new = asdict(table)
    tables = [new if table["name"] == name else table for table in tables] + ([] if name in names else [new])
    write_study(path, {**before, "tables": tables})
    return path


def append(
    study: str, name: str, row: Mapping[str, Any], title: str, notes: Sequence[str] = (), folder: Path = FOLDER
) -> Path:
    """Add a row to a table that grows from commit to commit, and write its study anew.

    A row of the same commit on the same machine is replaced. The page shows the last rows.

    Args:
        study: name of the study's file.
        name: of the table.
        row: as in `record`; commit, day and machine are put in front.
        title: what the table shows.
        notes: what a reader must know beside it.
        folder: where studies lie.

    Returns:
        The JSON file.
    """
    path = folder / f"{study}.json"
    tables = read_study(path)["tables"] if path.is_file() else []
    before = next((table["rows"] for table in tables if table["name"] == name), [])
    front = {"commit": commit(), "date": datetime.now(UTC).date().isoformat(), "machine": machine()}
    kept = [each for each in before if (each["commit"], each["machine"]) != (front["commit"], front["machine"])]
    return record(study, name, [*kept, front | dict(row)], title, notes, folder, num_shown=NUM_SHOWN)


def read_study(path: Path) -> dict[str, Any]:
    """Return the title, the introduction if there is one, and the tables of a study."""
    return json.loads(path.read_text(encoding="utf-8"))


def write_study(path: Path, study: Mapping[str, Any]) -> None:
    """Write a study as JSON and as Markdown."""
    path.write_text(json.dumps(study, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    path.with_suffix(".md").write_text(markdown(study), encoding="utf-8")


def flattened(row: Mapping[str, Any]) -> dict[str, Cell]:
    """Turn mappings within a row into columns of their own, sequences into text, and what is no number into nothing."""
    flat: dict[str, Cell] = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            flat |= {f"{key} {inner}": cell for inner, cell in flattened(value).items()}
        elif isinstance(value, (list, tuple)):
            flat[key] = ", ".join(str(each) for each in value)
        else:
            flat[key] = None if isinstance(value, float) and math.isnan(value) else value
    return flat


def machine() -> str:
    """Describe what the program runs on: processor, cores that it may use, and accelerators."""
    import jax

    cores = len(os.sched_getaffinity(0))
    parts = [_processor(), f"{cores} core{'s' if cores > 1 else ''}"]
    accelerators = [device.device_kind for device in jax.devices() if device.platform != "cpu"]
    parts += [f"{accelerators.count(kind)} {kind}" for kind in dict.fromkeys(accelerators)]
    return ", ".join(parts)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or platform.machine()


def _command() -> str:
    """Return the command line as a user gives it, without folders of this machine."""
    main = sys.modules["__main__"].__spec__
    program = f"python -m {main.name.removesuffix('.__main__')}" if main else Path(sys.argv[0]).name
    arguments = [Path(word).name if Path(word).is_absolute() else word for word in sys.argv[1:]]
    return " ".join([program, *arguments])
