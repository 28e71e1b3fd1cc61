"""By how much safety measures of calibrated parameters differ from those of the true ones, both in SUMO."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from experiments.paper.methods import IMPROVED
from experiments.paper.patterns import DEMANDS, PATTERN_FILE, prepare_pattern
from experiments.paper.study import CASES, trial_folder
from experiments.paper.trial import TRIAL_FILE, read_trial
from experiments.results.record import Row
from jaxcalib.calibration.pipeline import calibrate
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.measures.measure import Measure
from jaxcalib.measures.registry import safety_measures
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.drives_in_turn import interleaved
from jaxcalib.validation.calibrated_run import RESULT_FILE, read_calibrated_run

FIRST_SEED = 1_700_000_000  # no calibration's
SEEDS_PER_SET = 100_000
FEWEST_OBSERVATIONS = 30.0  # of a measure in the true runs; what is rarer tells nothing of a relative difference
CALIBRATED, AGAIN = "calibrated / true - 1", "true again - 1"


def differences_on(problem: CalibrationProblem, pattern: int, out: Path, rounds: int, budget: float) -> list[Row]:
    """Return a row for each measure on a simulated pattern; what was made before in the folder is used.

    Args:
        problem: on whose road the pattern is.
        pattern: its number, from 2.
        out: folder for it; that of a study of `experiments.paper` holds both the pattern and what was found.
        rounds: how often each departure is run with each set of values.
        budget: factor on a calibration's numbers of runs.
    """
    folder = prepare_pattern(problem, pattern, out / CASES)
    field = read_problem(folder)
    truth = json.loads((folder / PATTERN_FILE).read_text(encoding="utf-8"))["parameters"]
    true = [truth[name] for name in field.layout.names]
    found = values_found(field, pattern, out, budget)
    tallies = [
        _tallies(field, values, FIRST_SEED + SEEDS_PER_SET * number, rounds)
        for number, values in enumerate((true, true, found))
    ]
    measures = {name: field.measures[name] for name in safety_measures()}
    name = DEMANDS[pattern - 1].name
    return [{"pattern": name, **row} for row in rows_of(measures, field.tally_names, *tallies)]


def values_found(field: CalibrationProblem, pattern: int, out: Path, budget: float) -> list[float]:
    """Return the values that a study has found, or those of a calibration, which is made if it is not there."""
    trial = trial_folder(out, pattern, 0, IMPROVED) / TRIAL_FILE
    if trial.is_file():
        found = read_trial(trial).parameters
        return [found[name] for name in field.layout.names]
    run = out / f"run-{pattern}"
    if not (run / RESULT_FILE).is_file():
        calibrate(field.case.folder, run, budget=budget, resume=run.exists())
    return list(read_calibrated_run(run, field).values)


def rows_of(
    measures: Mapping[str, Measure],
    tally_names: Sequence[str],
    true: Float[np.ndarray, " tally"],
    again: Float[np.ndarray, " tally"],
    calibrated: Float[np.ndarray, " tally"],
) -> list[Row]:
    """Return a row for each measure that is seen often enough, from pooled tallies.

    Args:
        measures: by name.
        tally_names: names of the tallies.
        true: of the true values.
        again: of the same on other seeds: what chance alone shows.
        calibrated: of what was found.
    """
    rows: list[Row] = []
    for name, measure in measures.items():
        values = [measure.value(dict(zip(tally_names, tallies, strict=True))) for tallies in (true, again, calibrated)]
        is_enough = all(value.is_valid for value in values) and values[0].num_observations >= FEWEST_OBSERVATIONS
        if is_enough and values[0].value > 0.0:
            first, second, found = (value.value for value in values)
            rows.append(
                {
                    "measure": name,
                    "true": round(first, 5),
                    "calibrated": round(found, 5),
                    CALIBRATED: round(found / first - 1.0, 4),
                    AGAIN: round(second / first - 1.0, 4),
                }
            )
    return rows


def summary_of(rows: Sequence[Row]) -> list[str]:
    """Return the median sizes of relative differences, one line each."""
    found, by_chance = (np.abs(np.asarray([row[name] for row in rows], float)) for name in (CALIBRATED, AGAIN))
    return [
        f"median relative difference of {len(rows)} measures from the truth: {np.median(found):.1%} (15 % asked); of "
        f"the truth from itself on other seeds {np.median(by_chance):.1%}",
        f"measures with fewer than {FEWEST_OBSERVATIONS:.0f} observations in the true runs are left out",
    ]


def _tallies(
    field: CalibrationProblem, values: Sequence[float], first_seed: int, rounds: int
) -> Float[np.ndarray, " tally"]:
    """Return the tallies of SUMO's runs of all departures, pooled; departures share runs where they may."""
    starts = interleaved(field.drive_starts())
    with sumo_engine(field) as sumo:
        runs = Evaluator(sumo, starts, first_seed, shares_runs=field.template.can_share_runs)
        evaluations = runs.evaluate(np.asarray(values, float)[None], rounds * len(starts))
    tally = evaluations.tally[0]
    return tally[np.isfinite(tally).all(axis=1)].sum(axis=0)
