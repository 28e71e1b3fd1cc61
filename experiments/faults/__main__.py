"""`python -m experiments.faults OUT`: attack the program in every way of the registry, and count what it survives."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from filelock import FileLock, Timeout
from rich.console import Console
from rich.text import Text

from experiments.faults.attack import Trial
from experiments.faults.registry import ATTACKS, chosen_attacks
from experiments.faults.study import failures_of, kept_trials, make_trials, notes_of, table_of
from experiments.results.record import record as keep
from experiments.results.terminal import as_table
from jaxcalib.cli.guarded import guarded
from jaxcalib.errors import CaseError
from jaxcalib.runs.disk import check_out

SOME_FAILED = 1
WIDTH = 160
COLOURS = {"passed": "green", "failed": "red", "not run": "yellow"}
app = App(name="experiments.faults", help="What the program survives.")


@app.default
def faults(
    out: Path,
    /,
    *,
    only: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (),
    number: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    seed: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Make the trials of attacks; those that are finished are read, so the same command goes on where it stopped.

    The exit code is 1 if a trial failed.

    Parameters
    ----------
    out
        Folder for a JSON file of each trial, and for what trials leave.
    only
        Names of attacks; all by default.
    number
        Trials of each attack, or as many as there are; what is usual for each by default.
    seed
        Seed of all random numbers.
    record
        Keep the table of all finished trials of OUT in experiments/results.
    """
    has_failed = False

    def work() -> str:
        nonlocal has_failed
        has_failed = _study(out, only, number, seed, record)
        return ""

    code = guarded(work, "the same command goes on where it stopped.", program="experiments.faults")
    return code or (SOME_FAILED if has_failed else 0)


def _study(out: Path, only: Sequence[str], number: int | None, seed: int, record: bool) -> bool:
    """Make the trials, show them, and return whether one failed."""
    attacks = chosen_attacks(only)
    check_out(out)
    out.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)

    def tell(name: str, trial: Trial) -> None:
        line = Text(f"{name} {trial.number}: ").append(trial.ending, COLOURS[trial.ending])
        console.print(line.append(f" {trial.wall_s:.1f} s: {trial.name}: {trial.happened}"), soft_wrap=True)

    try:
        with FileLock(out / ".lock", timeout=0):
            made = make_trials(attacks, out.absolute(), number, seed, tell)
    except Timeout:
        raise CaseError(out, "", "expected a folder that nobody else uses; another study runs in it.") from None
    result = Console(width=WIDTH)
    result.print(as_table(table_of(attacks, made), "what the program survives"))
    for line in failures_of(made):
        result.print(line, highlight=False, markup=False, soft_wrap=True)
    if record:
        kept = kept_trials(ATTACKS, out.absolute(), seed)
        keep("faults", "attacks", table_of(ATTACKS, kept), "What the program survives", notes_of(kept, seed))
    return any(trial.ending == "failed" for trials in made.values() for trial in trials)


if __name__ == "__main__":
    sys.exit(app())
