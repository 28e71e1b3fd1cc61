"""`python -m experiments.paper CASE`: the paper's evaluation on any case; see docs/studies.md."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number

from experiments.paper.methods import ABLATIONS, IMPROVED, METHODS
from experiments.paper.patterns import DEMANDS
from jaxcalib.cli.guarded import guarded
from jaxcalib.errors import CaseError
from jaxcalib.problem.settings import read_settings

ALL_PATTERNS = tuple(range(1, len(DEMANDS) + 1))
Count = Annotated[int, Parameter(validator=Number(gte=1, lte=100))]
Patterns = Annotated[tuple[int, ...], Parameter(consume_multiple=True, negative="")]
Factor = Annotated[float, Parameter(validator=Number(gte=0.05, lte=100.0))]
app = App(name="experiments.paper", help="The paper's evaluation, its figures and its numbers, on any case.")


@app.default
def evaluate(
    case: Path,
    /,
    *,
    out: Path,
    repetitions: Count = 5,
    patterns: Patterns = ALL_PATTERNS,
    budget: Factor = 1.0,
    method: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = METHODS,
    settings: Path | None = None,
) -> int:
    """Run all methods on all traffic patterns; the same command goes on with what was stopped.

    Leaves trials.csv, trials.parquet, study.json, comparison.csv and the figures 7 to 13 in the folder of --out.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for the study; the same one goes on.
    repetitions
        Of every method on every pattern, with other seeds.
    patterns
        Numbers of traffic patterns; 1 is the case's own field, 2 to 5 are simulated in SUMO.
    budget
        Factor on the numbers of simulation runs, as in jaxcalib calibrate, the same for all methods.
    method
        Some of no_calibration, state_of_the_art, printed, improved.
    settings
        TOML file with what all methods share (docs/settings.md); with accuracy_threshold searches end there.
    """
    return _study(case, out, repetitions, patterns, budget, method, METHODS, settings)


@app.command
def ablation(
    case: Path,
    /,
    *,
    out: Path,
    repetitions: Count = 5,
    patterns: Patterns = (1,),
    budget: Factor = 1.0,
    method: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (IMPROVED, *ABLATIONS),
    settings: Path | None = None,
) -> int:
    """Run the method as improved, and without each of its parts: what does each of them buy?

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for the study; the same one goes on.
    repetitions
        Of every variant on every pattern, with other seeds.
    patterns
        Numbers of traffic patterns.
    budget
        Factor on the numbers of simulation runs.
    method
        Some of improved, without_logs, without_screening, without_optimiser, with_saga, without_polish,
        without_gradients, without_correction, without_whitening.
    settings
        TOML file with what all variants share.
    """
    return _study(case, out, repetitions, patterns, budget, method, (IMPROVED, *ABLATIONS), settings)


@app.command
def influence(
    case: Path,
    /,
    *,
    out: Path,
    trajectories: Annotated[int, Parameter(validator=Number(gte=2, lte=10_000))] = 20,
    base_samples: Annotated[int, Parameter(validator=Number(gte=2, lte=2**20))] = 64,
    runs_per_candidate: Count = 4,
    seed: Annotated[int, Parameter(validator=Number(gte=0, lte=2000))] = 0,
    settings: Path | None = None,
) -> int:
    """Does the range pick the right parameters? Range analysis beside Morris and Sobol indices, in the surrogate.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for the data; the same one goes on.
    trajectories
        Of Morris' design; each has one run more than there are driver parameters.
    base_samples
        Of Saltelli's design, a power of 2; times the number of driver parameters plus 2.
    runs_per_candidate
        Runs behind each accuracy.
    seed
        Of all random numbers.
    settings
        TOML file with further options.
    """
    from experiments.paper.influence import InfluencePlan, run_influence

    def work() -> str:
        plan = InfluencePlan(
            case, out, trajectories, base_samples, runs_per_candidate, seed, read_settings(settings), _cores()
        )
        return run_influence(plan)

    return _guarded(work)


@app.command
def figures(out: Path, /, *others: Path, record: Annotated[bool, Parameter(negative="")] = False) -> int:
    """Draw tables and figures anew from the data of a study.

    Parameters
    ----------
    out
        Folder of a study.
    others
        Folders with further patterns of it, made beside it.
    record
        Keep the tables in experiments/results.
    """
    from experiments.paper.report import write_report

    return _guarded(lambda: write_report(out, others, record))


def _study(
    case: Path,
    out: Path,
    repetitions: int,
    patterns: tuple[int, ...],
    budget: float,
    methods: tuple[str, ...],
    known: tuple[str, ...],
    settings: Path | None,
) -> int:
    from experiments.paper.report import write_report
    from experiments.paper.study import StudyPlan, run_study
    from jaxcalib.cli.terminal import TerminalProgress

    def work() -> str:
        for name in methods:
            if name not in known:
                raise CaseError("command line", "--method", f'expected some of {", ".join(known)}; got "{name}".')
        plan = StudyPlan(case, out, methods, patterns, repetitions, budget, read_settings(settings), _cores())
        run_study(plan, lambda name: TerminalProgress())
        return write_report(out)

    return _guarded(work)


def _guarded(work: Callable[[], str]) -> int:
    return guarded(work, "the same command goes on.", program="experiments.paper")


def _cores() -> int:
    return len(os.sched_getaffinity(0))


if __name__ == "__main__":
    sys.exit(app())
