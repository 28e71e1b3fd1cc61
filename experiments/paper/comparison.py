"""The paper's numbers beside ours, from the trials of a study alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from experiments.paper.methods import IMPROVED, NO_CALIBRATION, PRINTED, STATE_OF_THE_ART, label_of
from experiments.paper.patterns import DEMANDS
from experiments.paper.similarity import chance_at_least, chance_similarity, pair_shares
from experiments.paper.trial import Trial
from jaxcalib.calibration.objective.accuracy import MOES, VEHICLE_LEVEL, VEHICLE_LEVEL_SUM
from jaxcalib.statistics.bootstrap import percentile_interval

FEWEST_DRAWN = 3  # for an interval
NUM_DRAWS = 2000
OURS = (PRINTED, IMPROVED)
Pair = tuple[Trial, Trial]

ERRORS_DIFFER = "other road, field and drivers; ours on drives that no search has seen, the paper names none"
MEAN_UNDEFINED = "the paper does not say what is averaged: here the mean of the nine errors, before and after; " + (
    ERRORS_DIFFER
)
TIME_DIFFERS = (
    "the paper times VISSIM and does not say when its state of the art stops; here all searches run in the same "
    "surrogate and are planned with as many runs, but the method as improved goes on with SUMO where that drives "
    "unlike it"
)


@dataclass(frozen=True)
class PaperFigure:
    """A number of the paper."""

    name: str  # what it is
    section: str  # where it stands
    value: str  # as printed
    # the same for pairs of a method of ours and a method that it is compared with; None where it is not defined
    # for them
    ours: Callable[[Sequence[Pair]], float | None]
    against: str | None  # that method; None for a number of one method alone
    note: str  # why the two cannot be compared, or only with care
    # the bound of a share of pairs of patterns; None for a number of another kind
    least_similarity: float | None = None


def mean_error(trial: Trial) -> float:
    """Return the mean of the errors of Eqs. 24-36 that there are."""
    return float(np.mean([error for error in trial.errors.values() if error is not None]))


def _change(value_of: Callable[[Trial], float]) -> Callable[[Sequence[Pair]], float | None]:
    """Return the change of a mean over trials, in per cent of the other method's."""

    def change(pairs: Sequence[Pair]) -> float | None:
        ours, other = (float(np.mean([value_of(pair[side]) for pair in pairs])) for side in (0, 1))
        return 100.0 * (ours - other) / other if other > 0.0 else None

    return change


def _aspect(choose: Callable[[list[float]], float]) -> Callable[[Sequence[Pair]], float | None]:
    """Return one of the mean errors of the nine aspects, in per cent."""

    def aspect(pairs: Sequence[Pair]) -> float | None:
        means = mean_errors([pair[0] for pair in pairs])
        return 100.0 * choose([mean for mean in means.values() if mean is not None])

    return aspect


def mean_errors(trials: Sequence[Trial]) -> dict[str, float | None]:
    """Return the mean of each error over trials; None where no trial has it."""
    means: dict[str, float | None] = {}
    for name in MOES:
        known = [trial.errors[name] for trial in trials if trial.errors.get(name) is not None]
        means[name] = float(np.mean(np.asarray(known, float))) if known else None
    return means


def critical_sets(trials: Sequence[Trial]) -> dict[int, list[str]]:
    """Return the critical parameters by pattern, of its first repetition."""
    first: dict[int, Trial] = {}
    for trial in sorted(trials, key=lambda trial: trial.repetition):
        if trial.critical:
            first.setdefault(trial.pattern, trial)
    return {pattern: first[pattern].critical for pattern in sorted(first)}


def _similar(least: float) -> Callable[[Sequence[Pair]], float | None]:
    def share(pairs: Sequence[Pair]) -> float | None:
        shares = pair_shares(list(critical_sets([pair[0] for pair in pairs]).values()), least)
        return None if shares is None else 100.0 * shares

    return share


def _undone(pairs: Sequence[Pair]) -> float | None:
    known = [pair[0].stage2_undid_stage1 for pair in pairs if pair[0].stage2_undid_stage1 is not None]
    return 100.0 * float(np.mean(known)) if known else None


def _deviation_h(pairs: Sequence[Pair]) -> float | None:
    by_pattern: dict[int, list[float]] = {}
    for trial, _ in pairs:
        by_pattern.setdefault(trial.pattern, []).append(trial.calibration_s / 3600.0)
    means = [float(np.mean(hours)) for hours in by_pattern.values()]
    return float(np.std(means, ddof=1)) if len(means) > 1 else None


PAPER_FIGURES = (
    PaperFigure("vehicle-level error (Eq. 23), change against the state of the art [%]", "5.5.2", "-83.53",
                _change(lambda trial: trial.vehicle_level), STATE_OF_THE_ART, ERRORS_DIFFER),
    PaperFigure("vehicle-level error (Eq. 23), change against no calibration [%]", "5.5.2", "-85.22",
                _change(lambda trial: trial.vehicle_level), NO_CALIBRATION, ERRORS_DIFFER),
    PaperFigure("all nine errors, change against the state of the art [%]", "5.5.3", "-51.9",
                _change(mean_error), STATE_OF_THE_ART, MEAN_UNDEFINED),
    PaperFigure("all nine errors, change against no calibration [%]", "5.5.3", "-70.3",
                _change(mean_error), NO_CALIBRATION, MEAN_UNDEFINED),
    PaperFigure("least error of an aspect [%]", "5.5.3", "9.0", _aspect(min), None, ERRORS_DIFFER),
    PaperFigure("largest error of an aspect [%]", "5.5.3", "27.4", _aspect(max), None, ERRORS_DIFFER),
    PaperFigure("calibration time, change against the state of the art [%]", "5.5.4", "-76.75",
                _change(lambda trial: trial.calibration_s), STATE_OF_THE_ART, TIME_DIFFERS),
    PaperFigure("simulations of the search, change against the state of the art [%]", "-", "not given",
                _change(lambda trial: trial.surrogate_runs), STATE_OF_THE_ART, TIME_DIFFERS),
    PaperFigure("standard deviation of the calibration time over patterns [h]", "5.5.4", "2.38",
                _deviation_h, None, "the paper's VISSIM takes days; ours seconds to minutes"),
    PaperFigure("pairs of patterns with a similarity (Eq. 37) of 0.3 or more [%]", "5.5.4", "100",
                _similar(0.3), None, "see chance: what two random sets show", 0.3),
    PaperFigure("pairs of patterns with a similarity (Eq. 37) of 0.5 or more [%]", "5.5.4", "> 80",
                _similar(0.5), None, "see chance: what two random sets show", 0.5),
    PaperFigure("calibrations in which Stage 2 undid Stage 1 beyond noise [%]", "5.5.3", "2 of 4 errors grew",
                _undone, None, "the paper does not measure noise"),
)  # fmt: skip


def comparison_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return a row for each number of the paper: as printed, ours with 90 % interval, chance, and why they differ.

    Intervals draw patterns again, each with all its repetitions, for these share a field; of fewer than 3 patterns
    they draw repetitions, and say nothing of other fields. There are none for fewer than 3 of these either.
    """
    rows = []
    for figure in PAPER_FIGURES:
        row: dict[str, object] = {"figure": figure.name, "section": figure.section, "paper": figure.value}
        for method in OURS:
            pairs = paired(trials, method, figure.against or method)
            value = figure.ours(pairs) if pairs else None
            low, high = _interval(figure.ours, pairs) if figure.against else (None, None)
            row |= {method: rounded(value), f"{method}_low": rounded(low), f"{method}_high": rounded(high)}
        row |= {"chance": rounded(_chance(figure, trials)), "note": figure.note}
        rows.append(row)
    return pd.DataFrame(rows)


def paired(trials: Sequence[Trial], method: str, other: str) -> list[Pair]:
    """Return trials of two methods on the same pattern and repetition."""
    theirs = {(trial.pattern, trial.repetition): trial for trial in trials if trial.method == other}
    ours = [trial for trial in trials if trial.method == method]
    keys = [(trial.pattern, trial.repetition) for trial in ours]
    return [(trial, theirs[key]) for trial, key in zip(ours, keys, strict=True) if key in theirs]


def with_all_methods(trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials of patterns and repetitions that every method has made; means of others compare nothing.

    Where there are none, as in a study that has just begun, all trials.
    """
    methods = {trial.method for trial in trials}
    made: dict[tuple[int, int], set[str]] = {}
    for trial in trials:
        made.setdefault((trial.pattern, trial.repetition), set()).add(trial.method)
    return [trial for trial in trials if made[trial.pattern, trial.repetition] == methods] or list(trials)


def summary_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return the mean of every error for every method, with what chance shows and what the calibration cost.

    The means are those over the patterns and repetitions that every method has made.
    """
    trials = with_all_methods(trials)
    names = list(dict.fromkeys(trial.method for trial in trials))
    columns: dict[str, list[float | None]] = {}
    for method in names:
        of_method = [trial for trial in trials if trial.method == method]
        columns[label_of(method)] = [
            *mean_errors(of_method).values(),
            float(np.mean([trial.vehicle_level for trial in of_method])),
            float(np.mean([trial.surrogate_runs for trial in of_method])),
            float(np.mean([trial.sumo_runs for trial in of_method])),
            float(np.mean([trial.calibration_s for trial in of_method])),
        ]
    rows = [*MOES, VEHICLE_LEVEL_SUM, "surrogate_runs", "sumo_runs", "calibration_s"]
    floor = noise_floor_of(trials)
    table = {"measure": rows, **{name: [rounded(value) for value in values] for name, values in columns.items()}}
    return pd.DataFrame(table | {"noise floor": [rounded(floor.get(row)) for row in rows]})


def by_pattern_table(trials: Sequence[Trial]) -> pd.DataFrame:
    """Return a row for each pattern: the vehicle-level error of every method, the mean over its repetitions.

    Beside them stands what chance makes of it with the values of the best method.
    """
    rows = []
    for pattern in sorted({trial.pattern for trial in trials}):
        here = [trial for trial in trials if trial.pattern == pattern]
        row: dict[str, object] = {"pattern": f"{pattern} {DEMANDS[pattern - 1].name}"}
        for method in dict.fromkeys(trial.method for trial in trials):
            known = [trial.vehicle_level for trial in here if trial.method == method]
            row[label_of(method)] = rounded(float(np.mean(known))) if known else None
        rows.append(row | {"noise floor": rounded(noise_floor_of(here)[VEHICLE_LEVEL_SUM])})
    return pd.DataFrame(rows)


def noise_floor_of(trials: Sequence[Trial]) -> dict[str, float | None]:
    """Return the mean noise floor of the best method that there is."""
    methods = {trial.method for trial in trials}
    best = IMPROVED if IMPROVED in methods else next(iter(sorted(methods)))
    floors: dict[str, float | None] = {}
    for name in MOES:
        known = [trial.floor.get(name) for trial in trials if trial.method == best]
        known = [value for value in known if value is not None]
        floors[name] = float(np.mean(known)) if known else None
    terms = [floor for name in VEHICLE_LEVEL if (floor := floors[name]) is not None]
    floors[VEHICLE_LEVEL_SUM] = float(sum(terms)) if terms else None  # a mean of sums is the sum of means
    return floors


def _interval(ours: Callable[[Sequence[Pair]], float | None], pairs: list[Pair]) -> tuple[float | None, float | None]:
    by_pattern: dict[int, list[Pair]] = {}
    for pair in pairs:
        by_pattern.setdefault(pair[0].pattern, []).append(pair)
    groups = list(by_pattern.values())
    if len(groups) < FEWEST_DRAWN:
        groups = [[pair] for pair in pairs]
    if len(groups) < FEWEST_DRAWN:
        return None, None
    interval = percentile_interval(
        lambda drawn: ours([pair for i in drawn for pair in groups[i]]),
        len(groups), np.random.default_rng(0), NUM_DRAWS, (0.05, 0.95),
    )  # fmt: skip
    return interval or (None, None)


def _chance(figure: PaperFigure, trials: Sequence[Trial]) -> float | None:
    """Return what two random sets of as many parameters would show."""
    sized = next((trial for trial in trials if trial.critical), None)
    if figure.least_similarity is None or sized is None:
        return None
    return 100.0 * chance_at_least(figure.least_similarity, len(sized.critical), sized.num_drivers)


def chance_of(trials: Sequence[Trial]) -> float | None:
    """Return the similarity that two random sets have on average; None if nobody screened."""
    sized = next((trial for trial in trials if trial.critical), None)
    return None if sized is None else chance_similarity(len(sized.critical), sized.num_drivers)


def rounded(value: float | None) -> float | None:
    """Return a number with the four digits of tables; None for what is not known."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.4g}")
