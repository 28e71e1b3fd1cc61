"""`python -m experiments.safety CASE`: safety measures of calibrated against true parameters, both in SUMO.

A calibration matches none of these measures. Whether they come right all the same can be told where the truth is known:
fields simulated on the case's road (`experiments.paper`), whose parameters are to be found back. Beside the differences
stand those of the truth from itself on other seeds, for rare events scatter.
"""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from jaxtyping import Float
from rich.console import Console

from experiments.paper.patterns import DEMANDS, PATTERN_FILE, prepare_pattern
from experiments.results.record import Row
from experiments.results.record import record as keep
from experiments.results.terminal import as_table
from jaxcalib.calibration.pipeline import calibrate
from jaxcalib.cli.guarded import guarded
from jaxcalib.measures.registry import safety_measures
from jaxcalib.problem.engines import prepare_devices, sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.calibrated_run import RESULT_FILE, read_calibrated_run
from sim_adapters.interface import RunRequest

FIRST_SEED = 1_700_000_000  # no calibration's
SEEDS_PER_SET = 100_000
FEWEST_OBSERVATIONS = 30.0  # of a measure in the true runs; what is rarer tells nothing of a relative difference
app = App(name="experiments.safety", help="Safety measures of calibrated against true parameters.")


@app.default
def safety(
    case: Path,
    /,
    *,
    out: Path,
    patterns: Annotated[tuple[int, ...], Parameter(consume_multiple=True, negative="")] = (2, 4),
    rounds: Annotated[int, Parameter(validator=Number(gte=2, lte=1000))] = 20,
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100.0))] = 1.0,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Make fields of known parameters, calibrate them, and compare both in SUMO; the same command goes on.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for fields and results.
    patterns
        Numbers of traffic patterns of `experiments.paper`, from 2.
    rounds
        How often each departure of the case is run, with the truth, with the truth again, and with what was found.
    budget
        Factor on the calibration's numbers of runs.
    record
        Keep the table in experiments/results.
    """

    def work() -> str:
        prepare_devices(len(os.sched_getaffinity(0)))
        problem = read_problem(case)
        rows = [row for number in patterns for row in _rows(problem, number, out, rounds, budget)]
        notes = summary_of(rows)
        Console().print(as_table(rows, f"safety measures on {problem.case.name}"), "\n".join(notes))
        if record:
            title = f"Safety measures of calibrated against true parameters on {problem.case.name}, both in SUMO"
            keep("calibration", f"safety_{problem.case.name}", rows, title, [f"- {note}" for note in notes])
        return ""

    return guarded(work, "nothing was recorded; the same command goes on.")


def summary_of(rows: Sequence[Row]) -> list[str]:
    """Return the median sizes of relative differences, one line each."""
    found, by_chance = (
        np.abs(np.asarray([row[name] for row in rows], float)) for name in ("calibrated / true - 1", "true again - 1")
    )
    return [
        f"median relative difference of {len(rows)} measures from the truth: {np.median(found):.1%} (15 % asked); of "
        f"the truth from itself on other seeds {np.median(by_chance):.1%}",
        f"measures with fewer than {FEWEST_OBSERVATIONS:.0f} observations in the true runs are left out",
    ]


def _rows(problem: CalibrationProblem, pattern: int, out: Path, rounds: int, budget: float) -> list[Row]:
    folder = prepare_pattern(problem, pattern, out)
    run = out / f"run-{pattern}"
    if not (run / RESULT_FILE).is_file():
        calibrate(folder, run, budget=budget, resume=run.exists())
    field = read_problem(folder)
    truth = json.loads((folder / PATTERN_FILE).read_text(encoding="utf-8"))["parameters"]
    true_values = tuple(truth[name] for name in field.layout.names)
    found_values = read_calibrated_run(run, field).values
    sets = [true_values, true_values, found_values]
    true, again, found = (
        _tallies(field, values, FIRST_SEED + SEEDS_PER_SET * number, rounds) for number, values in enumerate(sets)
    )
    rows: list[Row] = []
    for name in safety_measures():
        values = [
            field.measures[name].value(dict(zip(field.tally_names, tallies, strict=True)))
            for tallies in (true, again, found)
        ]
        is_enough = all(value.is_valid for value in values) and values[0].num_observations >= FEWEST_OBSERVATIONS
        if is_enough and values[0].value > 0.0:
            first, second, calibrated = (value.value for value in values)
            rows.append(
                {
                    "pattern": DEMANDS[pattern - 1].name,
                    "measure": name,
                    "true": round(first, 5),
                    "calibrated": round(calibrated, 5),
                    "calibrated / true - 1": round(calibrated / first - 1.0, 4),
                    "true again - 1": round(second / first - 1.0, 4),
                }
            )
    return rows


def _tallies(
    problem: CalibrationProblem, values: Sequence[float], first_seed: int, rounds: int
) -> Float[np.ndarray, " tally"]:
    """Return the tallies of SUMO's runs of all departures, pooled."""
    departs_s = sorted({drive.depart_s for drive in problem.case.drives})
    requests = [
        RunRequest(tuple(values), first_seed + number, depart_s)
        for number, depart_s in enumerate(depart_s for _ in range(rounds) for depart_s in departs_s)
    ]
    with sumo_engine(problem) as sumo:
        outcomes = sumo.run(requests)
    return np.sum([outcome.observed for outcome in outcomes if outcome.status.is_ok], axis=0)


if __name__ == "__main__":
    sys.exit(app())
