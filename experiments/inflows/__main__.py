"""`python -m experiments.inflows`: inflows that calibrations find back on drawn roads, against the truth."""

import json
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.progress import track

from experiments.blind_effects.generate import make_case
from experiments.blind_effects.plan import CasePlan
from experiments.inflows.information import inflow_bound
from experiments.results.record import Row
from experiments.results.record import record as keep
from experiments.results.terminal import as_table, write_json
from experiments.roads.drawn_road import DRAWN
from jaxcalib.calibration.first_look import successful_tallies
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.initial_values.initial_point import find_initial_point
from jaxcalib.problem.engines import prepare_devices, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.problem.settings import Settings

FIELD_SEED = 70_000  # of the first road's field
MOST_RATIO = 1.5
NUM_RUNS = 32  # of the surrogate at each demand, as at the beginning of a calibration
app = App(name="experiments.inflows", help="Inflows found back, against what the drives hold about them.")


@app.default
def inflows(
    *,
    roads: Annotated[int, Parameter(validator=Number(gte=1))] = 12,
    first: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    drives: Annotated[int, Parameter(validator=Number(gte=3))] = 12,
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100))] = 1.0,
    search: bool = True,
    out: Path = Path("inflows"),
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Calibrate fields without effect on drawn roads; what is in OUT already is read.

    Parameters
    ----------
    roads
        Number of roads.
    first
        Seed of the first road; the others follow.
    drives
        Drives of each field, every third held out.
    budget
        Factor on the calibration's numbers of runs.
    search
        Whether to calibrate; else inflows are those with which a calibration begins, read off the logs and the
        surrogate's drives.
    out
        Folder for cases, RUNs and bounds.
    record
        Keep the table in experiments/results.
    """
    cores = len(os.sched_getaffinity(0))
    prepare_devices(cores)
    with ProcessPoolExecutor(cores, mp_context=multiprocessing.get_context("spawn")) as pool:
        for seed in track(range(first, first + roads), "fields", console=Console(stderr=True)):
            if not (out / "labels" / f"{seed}.json").is_file():
                plan = CasePlan(f"{DRAWN}{seed}", f"{DRAWN}{seed}", "null", (), "IDM", FIELD_SEED + seed)
                write_json(out / "labels" / f"{seed}.json", make_case(plan, out, drives, 0, 0, pool))
    rows: list[Row] = []
    for seed in track(range(first, first + roads), "roads", console=Console(stderr=True)):
        rows += _rows(seed, out, budget if search else None)
    notes = summary_of(rows)
    Console().print(as_table(rows, "inflows found back on fields without effect"), "\n".join(notes))
    if record:
        what = "found back" if search else "read off the logs"
        name = "inflows" if search else "inflows_before_the_search"
        keep("calibration", name, rows, f"Inflows {what} over drawn roads", [f"- {note}" for note in notes])
    return 0


def summary_of(rows: Sequence[Row]) -> list[str]:
    """Return what all inputs together show, one line each."""
    ratio, error, scenario = (
        np.asarray([row[name] for row in rows], float)
        for name in ("error / bound", "found / truth - 1", "scenario / truth - 1")
    )
    known = ratio[np.isfinite(ratio)]
    return [
        f"error over bound, root mean square: {np.sqrt(np.mean(known**2)):.2f}, median of sizes "
        f"{np.median(np.abs(known)):.2f} ({len(known)} of {len(rows)} inputs; {MOST_RATIO:g} asked)",
        f"error of an inflow, mean of sizes {np.abs(error).mean():.1%}, largest {np.abs(error).max():.1%}; of the "
        f"scenario as it is {np.abs(scenario).mean():.1%}",
    ]


def _rows(seed: int, out: Path, budget: float | None) -> list[Row]:
    case = out / "cases" / f"{DRAWN}{seed}"
    label = json.loads((out / "labels" / f"{seed}.json").read_text(encoding="utf-8"))
    problem = read_problem(case)
    bound_file = out / "bounds" / f"{seed}.json"
    if not bound_file.is_file():
        bound = inflow_bound(problem, truth_of(problem, label))
        write_json(bound_file, dict(zip(bound.names, bound.relative, strict=True)))
    bounds = json.loads(bound_file.read_text(encoding="utf-8"))
    if budget is None:
        found, searched_in = _read_off(problem, out / "read_off" / f"{seed}.json"), None
    else:
        found, searched_in = _calibrated(case, out / "runs" / f"{DRAWN}{seed}", budget)
    scenario = problem.template.base_values()
    rows: list[Row] = []
    for number, name in enumerate(problem.layout.input_ids):
        truth = label["inputs"][name]
        error = found[name] / truth - 1.0
        rows.append(
            {
                "road": seed,
                "input": name,
                "truth, veh/h": round(truth),
                "scenario / truth - 1": round(float(scenario[number]) / truth - 1.0, 3),
                "found / truth - 1": round(error, 3),
                "bound": round(bounds[name], 3),
                "error / bound": round(error / bounds[name], 2),
                "search in": searched_in,
            }
        )
    return rows


def _read_off(problem: CalibrationProblem, file: Path) -> dict[str, float]:
    """Inflows with which a calibration begins."""
    if not file.is_file():
        surrogate = Evaluator(surrogate_engine(problem), problem.drive_starts("fit"), 0)

        def simulated(values: np.ndarray) -> np.ndarray:
            return successful_tallies(problem, surrogate, values, surrogate.rounds_of(NUM_RUNS))

        initial = find_initial_point(problem, Settings().scaling_factor, {}, 0, simulated)
        write_json(file, dict(zip(problem.layout.input_ids, map(float, initial.values), strict=False)))
    return json.loads(file.read_text(encoding="utf-8"))


def _calibrated(case: Path, run: Path, budget: float) -> tuple[dict[str, float], str]:
    """Inflows that a calibration finds, and the simulator in which it searched."""
    if not (run / "result.json").is_file():
        run.parent.mkdir(parents=True, exist_ok=True)
        options = ["--out", str(run), "--budget", f"{budget:g}", *(["--resume"] if run.exists() else [])]
        command = [sys.executable, "-m", "jaxcalib", "calibrate", str(case), *options]
        subprocess.run(command, check=True, capture_output=True)
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return result["parameters"]["demand"], "SUMO" if result["confirmation"]["searched_in_sumo"] else "surrogate"


def truth_of(problem: CalibrationProblem, label: dict[str, Any]) -> np.ndarray:
    """Return a label's values in the order of the layout; what it does not have is the scenario's."""
    values = problem.template.base_values()
    known = label["inputs"] | label["theta"]
    for number, name in enumerate(problem.layout.names):
        values[number] = known.get(name, values[number])
    return values


if __name__ == "__main__":
    sys.exit(app())
