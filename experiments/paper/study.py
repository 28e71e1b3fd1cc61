"""The study: every method on every traffic pattern, several times, each trial in a folder of its own."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import msgspec

from experiments.paper.methods import ABLATIONS, METHODS
from experiments.paper.patterns import DEMANDS, prepare_pattern
from experiments.paper.trial import TRIAL_FILE, Trial, read_trial, table_of
from experiments.paper.trial_runs import run_trial
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.problem import read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.runs.run_folder import identify, open_run_folder
from sim_adapters.atomic_file import write_atomically

STUDY_FILE, TABLE, CASES, TRIALS = "study.json", "trials", "cases", "trials"
FIRST_SEED = 1  # a calibration's seed; each trial of a pattern and repetition has one, the same for all methods
SEEDS_PER_PATTERN = 100


TrialKey = tuple[int, int, str]  # pattern, repetition, method


@dataclass(frozen=True)
class StudyPlan:
    """What is to be done."""

    case: Path  # the case's folder
    out: Path  # the study's folder
    methods: Sequence[str]  # names of the methods
    patterns: Sequence[int]  # numbers of the traffic patterns, from 1
    repetitions: int  # of each
    budget: float  # factor on the numbers of runs
    settings: Settings  # what all methods share
    cores: int  # devices that the surrogate uses


def seed_of(pattern: int, repetition: int) -> int:
    """Return the seed of a pattern and repetition."""
    return FIRST_SEED + SEEDS_PER_PATTERN * (pattern - 1) + repetition


def run_study(
    plan: StudyPlan, progress_of: Callable[[str], AbstractContextManager[Progress]], say: Callable[[str], None] = print
) -> list[Trial]:
    """Make all trials that are not there yet, and write what there is after each of them.

    Raises:
        CaseError: the case, the options or the folder are wrong.
    """
    if not 1 <= plan.repetitions <= SEEDS_PER_PATTERN:
        raise CaseError("command line", "--repetitions", f"expected 1 to {SEEDS_PER_PATTERN}, got {plan.repetitions}.")
    prepare_devices(plan.cores)
    problem = read_problem(plan.case)
    options = {
        "study": "ablation" if set(plan.methods) - set(METHODS) else "paper",
        "budget": plan.budget,
        "settings": repr(plan.settings),
    }
    identity = identify(problem.case, options, (Path(__file__).parent,))
    with open_run_folder(plan.out, identity, resume=True):
        trials, failed = known_trials(plan.out / TRIALS), []
        for repetition in range(plan.repetitions):  # whole rounds first: what there is can be looked at meanwhile
            for pattern in plan.patterns:
                case = prepare_pattern(problem, pattern, plan.out / CASES)
                for method in plan.methods:
                    folder = trial_folder(plan.out, pattern, repetition, method)
                    name = folder.relative_to(plan.out / TRIALS).as_posix()
                    folder.mkdir(parents=True, exist_ok=True)
                    began = time.perf_counter()
                    try:
                        with progress_of(name) as progress:
                            trial = run_trial(
                                method, pattern, repetition, case, folder, seed=seed_of(pattern, repetition),
                                budget=plan.budget, settings=plan.settings, progress=progress,
                            )  # fmt: skip
                    except AllRunsFailedError as error:  # one failed trial must not keep the others from being made
                        failed.append(name)
                        write_data(plan, in_order(trials), failed)
                        say(f"{name}: no result, {error}")
                        continue
                    jax.clear_caches()  # the programs of one trial serve no other, and there are hundreds of trials
                    trials[pattern, repetition, method] = trial
                    write_data(plan, in_order(trials), failed)
                    say(f"{name}: vehicle-level error {trial.vehicle_level:.3f}, {time.perf_counter() - began:.0f} s")
    return in_order(trials)


def trial_folder(out: Path, pattern: int, repetition: int, method: str) -> Path:
    """Return the folder of a trial in that of its study."""
    return out / TRIALS / f"pattern-{pattern}" / f"repetition-{repetition}" / method


def known_trials(folder: Path) -> dict[TrialKey, Trial]:
    """Return the trials that lie in a folder, whichever call made them, by pattern, repetition and method."""
    trials = [read_trial(file) for file in sorted(folder.rglob(TRIAL_FILE))]
    return {(trial.pattern, trial.repetition, trial.method): trial for trial in trials}


def in_order(trials: dict[TrialKey, Trial]) -> list[Trial]:
    """Return trials repetition by repetition, as they are made, the methods in the order in which they are listed."""
    methods = (*METHODS, *ABLATIONS)
    return [trials[key] for key in sorted(trials, key=lambda key: (key[1], key[0], methods.index(key[2])))]


def write_data(plan: StudyPlan, trials: list[Trial], failed: Sequence[str] = ()) -> None:
    """Write the table of trials as CSV and Parquet, and beside it what they were made with, and what failed."""
    table = table_of(trials)
    write_atomically(plan.out / f"{TABLE}.csv", lambda file: table.to_csv(file, index=False))
    write_atomically(plan.out / f"{TABLE}.parquet", lambda file: table.to_parquet(file, index=False))
    about = {
        "case": plan.case.name,
        "methods": list(dict.fromkeys(trial.method for trial in trials)),
        "patterns": [DEMANDS[n - 1].__dict__ | {"pattern": n} for n in sorted({trial.pattern for trial in trials})],
        "repetitions": 1 + max((trial.repetition for trial in trials), default=-1),
        "budget": plan.budget,
        "settings": msgspec.to_builtins(plan.settings),
        "seeds": {f"{trial.pattern}/{trial.repetition}": trial.seed for trial in trials},
        "versions": versions("SALib"),
        "commit": commit(),
        "failed": list(failed),
        "trials": [msgspec.to_builtins(trial) for trial in trials],
    }
    text = msgspec.json.format(msgspec.json.encode(about), indent=1) + b"\n"
    write_atomically(plan.out / STUDY_FILE, lambda file: file.write(text))


def read_study(out: Path) -> tuple[dict[str, Any], list[Trial]]:
    """Return what a study has written: how it was made, and its trials.

    Raises:
        CaseError: there is none, or it cannot be read.
    """
    file = out / STUDY_FILE
    try:
        about = msgspec.json.decode(file.read_bytes())
        trials = msgspec.convert(about.pop("trials"), list[Trial])
    except (OSError, KeyError, msgspec.DecodeError, msgspec.ValidationError):
        raise CaseError(
            file, "", "expected the data of a study; make it with python -m experiments.paper CASE."
        ) from None
    return about, trials


def read_parts(folders: Sequence[Path]) -> tuple[dict[str, Any], list[Trial]]:
    """Return a study that was made in several folders, each with some of its patterns, as `read_study` does.

    Raises:
        CaseError: a folder has no study, or one of another case, budget, settings or program.
    """
    parts = [read_study(folder) for folder in folders]
    if len(parts) == 1:
        return parts[0]
    about = parts[0][0]
    for folder, (other, _) in zip(folders[1:], parts[1:], strict=True):
        for what in ("case", "budget", "settings", "versions", "commit"):
            if other.get(what) != about.get(what):
                raise CaseError(folder / STUDY_FILE, what, f"expected the same as in {folders[0]}.")
    trials = in_order({(one.pattern, one.repetition, one.method): one for _, kept in parts for one in kept})
    patterns = {one["pattern"]: one for other, _ in parts for one in other["patterns"]}
    about |= {
        "methods": list(dict.fromkeys(one.method for one in trials)),
        "patterns": [patterns[number] for number in sorted(patterns)],
        "repetitions": max((one.repetition for one in trials), default=-1) + 1,
        "failed": sorted({name for other, _ in parts for name in other["failed"]}),
    }
    return about, trials
