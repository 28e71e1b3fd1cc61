"""`python -m experiments.blind_effects`: makes sealed field cases, has them diagnosed, and scores the answers."""

import os
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console

from experiments.blind_effects.generate import make_cases
from experiments.blind_effects.plan import KINDS, Size
from experiments.blind_effects.run import diagnose_cases
from experiments.blind_effects.score import score_answers
from experiments.roads.road import ROADS

CORES = len(os.sched_getaffinity(0))
Count = Annotated[int, Parameter(validator=Number(gte=0))]
app = App(name="experiments.blind_effects", help="The check on withheld effects.")


@app.command
def make(
    out: Path,
    /,
    *,
    key: Path,
    size: Size = "quick",
    road: list[str] | None = None,
    drawn: Count = 0,
    drives: Annotated[int, Parameter(validator=Number(gte=2))] = 12,
    checks: Count = 6,
    twins: Count = 0,
    first: Annotated[int | None, Parameter(validator=Number(gte=1))] = None,
    kind: list[str] | None = None,
    weights: bool = False,
    jobs: Annotated[int, Parameter(validator=Number(gte=1))] = CORES,
) -> int:
    """Make sealed cases; the same command goes on where it was stopped.

    Parameters
    ----------
    out
        Folder for the cases and their seals.
    key
        File for the labels, outside of `out`: to be withheld until the answers are there.
    size
        3 cases, every effect once at each strength, or four times.
    road
        Known roads; all of them without this option.
    drawn
        So many roads drawn at random from the key's own seed, instead of known ones.
    drives
        Drives of each case, every third held out.
    checks
        Drives repeated without the effect to show that it changes something.
    twins
        Additional held-out drives in a twin of each case, which tell the true fraction closed.
    first
        Only so many cases of the plan, whose order is random: a sample, which a later command may enlarge.
    kind
        Only cases of these kinds, e.g. null; of all without this option.
    weights
        Draw the drivers' lane-change weights over all their values, and have them calibrated: often no log shows them.
    jobs
        SUMO processes.
    """
    roads = tuple(road or ROADS)
    unknown = [name for name in roads if name not in ROADS]
    if unknown:
        raise SystemExit(f"--road: expected {' or '.join(ROADS)}, got {unknown[0]}.")
    unknown = [name for name in kind or () if name not in KINDS]
    if unknown:
        raise SystemExit(f"--kind: expected {' or '.join(KINDS)}, got {unknown[0]}.")
    if road and drawn:
        raise SystemExit("make: expected either --road or --drawn.")
    of = tuple(kind or ())
    number = make_cases(out, key, size, () if drawn else roads, drawn, drives, checks, twins, jobs, first, of, weights)
    Console().print(f"{number} cases in {out}; publish the root in {out / 'seals.json'}, withhold {key}.")
    return 0


@app.command
def run(cases: Path, runs: Path, /, *, program: str = "jaxcalib", options: list[str] | None = None) -> int:
    """Diagnose each case with `jaxcalib diagnose CASE --out RUN`; the same command goes on where it was stopped.

    Parameters
    ----------
    cases
        Folder made by `make`, or any folder of cases.
    runs
        Folder for the answers.
    program
        Command of the diagnoser.
    options
        Further options for it.
    """
    failed = diagnose_cases(cases, runs, program, tuple(options or ()))
    return 1 if failed else 0


@app.command
def score(
    cases: Path,
    runs: Path,
    /,
    *,
    key: Path | None = None,
    practice: bool = False,
    train: list[Path] | None = None,
    out: Path | None = None,
) -> int:
    """Open the seals and print the table.

    Parameters
    ----------
    cases
        Folder of the cases.
    runs
        Folder of the answers.
    key
        The labels.
    practice
        The cases are not sealed: each has a label.json.
    train
        Further folders of labelled cases to train the naive random forest on.
    out
        Folder for score.json and score.html; without it, that of the answers.
    """
    if (key is None) != practice:
        raise SystemExit("score: expected either --key FILE or --practice.")
    score_answers(cases, runs, key, tuple(train or ()), out or runs, Console())
    return 0


if __name__ == "__main__":
    raise SystemExit(app())
