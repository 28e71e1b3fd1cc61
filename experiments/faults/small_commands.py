"""The program's long commands at their smallest, and what of their results must not depend on what else happens."""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.faults.attack import Ground
from experiments.faults.commands import run_command
from experiments.results.terminal import write_json
from jaxcalib.runs.run_folder import identify_program

TIMES = ("wall_s", "timing", "profile")  # of results
KEY = ["candidate", "seed", "depart_s"]  # of a sweep's rows
LONGEST_S = 3600.0
Result = Mapping[str, str]  # its parts as text, by name


class NotMadeError(RuntimeError):
    """What trials are compared with could not be made."""


@dataclass(frozen=True)
class SmallCommand:
    """A command with the least that it can be asked to do."""

    name: str  # of the command
    options: tuple[str, ...]
    file: str  # which it leaves in its folder
    resumes: tuple[str, ...] = ()  # options with which it goes on, and begins as well

    def words(self, case: Path, folder: Path) -> list[str | Path]:
        """Return the command's words; results go into a folder that need not be there."""
        out = folder / self.file if self.is_table else folder
        return [self.name, case, "--out", out, *self.options, *self.resumes, "--quiet"]

    @property
    def is_table(self) -> bool:
        """Whether it leaves a table."""
        return self.file.endswith(".parquet")

    def result(self, folder: Path) -> Result:
        """Return what it has left, but for times.

        Raises:
            OSError, ValueError: it has left nothing that can be read.
        """
        file = folder / self.file
        if not self.is_table:
            content = json.loads(file.read_text(encoding="utf-8"))
            return {key: json.dumps(value, sort_keys=True) for key, value in content.items() if key not in TIMES}
        table: Any = pd.read_parquet(file).drop(columns=[*TIMES], errors="ignore")
        lines = table.to_csv(index=False, float_format="%.17g").splitlines()
        columns = {"columns": lines[0]}
        return columns | {f"row {number}": line for number, line in enumerate(lines[1:])}

    def num_doubled(self, folder: Path) -> int:
        """Return how many rows of the table that it has left are there twice."""
        return int(pd.read_parquet(folder / self.file).duplicated(KEY).sum()) if self.is_table else 0


_SWEEP = ("--design", "lhs:10", "--seeds", "2")
COMMANDS: Mapping[str, SmallCommand] = {
    "calibrate": SmallCommand("calibrate", ("--budget", "0.05"), "result.json", ("--resume",)),
    "diagnose": SmallCommand("diagnose", ("--budget", "0.05"), "diagnosis.json", ("--resume",)),
    "sweep": SmallCommand("sweep", _SWEEP, "sweep.parquet"),
    "sweep in SUMO": SmallCommand("sweep", (*_SWEEP, "--engine", "sumo"), "sweep.parquet"),
}


@dataclass(frozen=True)
class Reference:
    """An undisturbed run of a command."""

    folder: Path
    result: Result
    wall_s: float


def reference_of(ground: Ground, name: str) -> Reference:
    """Return an undisturbed run, which is made once for each version of the program.

    Raises:
        NotMadeError: the command fails even so.
    """
    folder = ground.folder.parent / "references" / name.replace(" ", "_")
    note, made_by = folder / "made.json", identify_program()
    command = COMMANDS[name]
    if not note.is_file() or json.loads(note.read_text(encoding="utf-8"))["program"] != made_by:
        shutil.rmtree(folder, ignore_errors=True)
        ended = run_command(*command.words(ground.case, folder / "run"), longest_s=LONGEST_S)
        if ended.code:
            raise NotMadeError(f"{name}: {ended.last_words}")
        write_json(note, {"program": made_by, "wall_s": ended.wall_s})
    wall_s = json.loads(note.read_text(encoding="utf-8"))["wall_s"]
    return Reference(folder / "run", command.result(folder / "run"), wall_s)


def difference(one: Result, other: Result) -> str:
    """Return in what two results differ; nothing where they are equal."""
    names = [name for name in {**one, **other} if one.get(name) != other.get(name)]
    if not names:
        return ""
    return f"{len(names)} of {len(other)} parts differ, first {names[0]}: {_apart(one, other, names[0])}"


def _apart(one: Result, other: Result, name: str) -> str:
    """Return the first place where the texts of a part are apart."""
    texts = [result.get(name, "(not there)") for result in (one, other)]
    place = next((n for n, (a, b) in enumerate(zip(*texts, strict=False)) if a != b), min(map(len, texts)))
    begin = max(0, place - 20)
    return " / ".join(text[begin : place + 30] for text in texts)


def digest_of(result: Result) -> str:
    """Return one short hash of a result."""
    text = json.dumps(dict(result), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def differing_rows(one: Result, other: Result) -> list[str]:
    """Return the names of the parts in which two results differ."""
    return [name for name in {**one, **other} if one.get(name) != other.get(name)]


def statuses(result: Result, names: Sequence[str]) -> set[str]:
    """Return the statuses that rows of a table have."""
    place = result["columns"].split(",").index("status")
    return {result[name].split(",")[place] for name in names}
