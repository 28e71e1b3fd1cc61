"""`python -m experiments.benchmarks.throughput`: vehicle-steps per second of the surrogate and of libsumo, in turn.

Both run the same scenario with all features, in 0.1-s steps as the case has them: arrivals, ramps, lane changes, the
subject vehicle, what it detects, and the measures of that. libsumo has as many processes as there are cores.
"""

import json
import os
import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
from cyclopts import App, Parameter
from cyclopts.validators import Number
from scipy.stats.qmc import Sobol

from experiments.results.record import record as keep
from jaxcalib.problem.engines import prepare_devices, sumo_engine, surrogate_engine
from jaxcalib.problem.parameter_space import parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunOutcome, RunRequest, Simulator
from sim_adapters.jax.simulator import JaxSimulator

SPARE_CAPACITY = 2.0  # sets around the scenario's values can be much denser than the field
SPREAD = 0.1  # of the parameter sets, relative, to each side of the scenario's values
CASE = Path(__file__).parents[1] / "cases" / "corridor"
app = App(name="experiments.benchmarks.throughput", help="Vehicle-steps per second of both simulators.")


@dataclass(frozen=True)
class Round:
    """One call of a simulator."""

    vehicle_steps: int  # of all its runs
    wall_s: float  # computing time

    @property
    def rate(self) -> float:
        """Vehicle-steps per second."""
        return self.vehicle_steps / self.wall_s


def parameter_sets(problem: CalibrationProblem, number: int) -> list[tuple[float, ...]]:
    """Return parameter vectors around the scenario's, within the ranges of a calibration."""
    base = problem.template.base_values()
    space = parameter_space(problem.layout, problem.model, problem.template.base_demand_vehph(), SPREAD, {})
    cube = Sobol(len(base), rng=np.random.default_rng(0)).random(number)
    around = base * (1.0 + SPREAD * (2.0 * cube - 1.0))
    return [tuple(round_values(row)) for row in np.clip(around, space.lower, space.upper)]


def timed(engine: Simulator, requests: list[RunRequest]) -> Round:
    """Make runs and time them.

    Raises:
        RuntimeError: a run failed.
    """
    began = time.perf_counter()
    outcomes: list[RunOutcome] = engine.run(requests)
    wall_s = time.perf_counter() - began
    failed = {outcome.status.value for outcome in outcomes if not outcome.status.is_ok}
    if failed:
        raise RuntimeError(f"Expected runs that succeed: {'; '.join(sorted(failed))}.")
    return Round(sum(outcome.num_vehicle_steps for outcome in outcomes), wall_s)


def prepared(problem: CalibrationProblem) -> JaxSimulator:
    """Return a surrogate whose program is compiled, or loaded where it was compiled before."""
    engine = surrogate_engine(problem, SPARE_CAPACITY, most_overfull_share=0.0)
    engine.prepare()
    return engine


def bytes_per_vehicle(engine: JaxSimulator) -> float:
    """Return the memory of a batch per place for a vehicle."""
    memory = engine.memory_bytes()
    return memory / (engine.batch * engine.capacity)


@app.default
def throughput(
    case: Path = CASE,
    /,
    *,
    sets: Annotated[int, Parameter(validator=Number(gte=1, lte=100_000))] = 64,
    rounds: Annotated[int, Parameter(validator=Number(gte=1, lte=100))] = 5,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Print one line of JSON.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    sets
        Parameter sets in a round of the surrogate.
    rounds
        Rounds of each simulator, in turn.
    record
        Also write the table to experiments/results.
    """
    result = measure_throughput(case, sets, rounds)
    print(json.dumps(result))
    if record:
        title = f"Vehicle-steps per second of both simulators: {result['case']}"
        keep("performance", f"throughput-{result['case']}", [result], title)
    return 0


def measure_throughput(case: Path, sets: int, rounds: int) -> dict[str, Any]:
    """Return vehicle-steps per second of both simulators, in turn, and what a program takes to compile.

    Args:
        case: the case's folder.
        sets: parameter sets in a round of the surrogate.
        rounds: of each simulator.
    """
    cores = len(os.sched_getaffinity(0))
    prepare_devices(cores)
    problem = read_problem(case)
    depart_s, drive = problem.drive_starts("fit")[0]
    requests = [
        RunRequest(values, seed, depart_s, drive=drive) for seed, values in enumerate(parameter_sets(problem, sets))
    ]
    with tempfile.TemporaryDirectory() as folder:
        jax.config.update("jax_compilation_cache_dir", folder)
        compile_s = {"cold": prepared(problem).compile_s, "cached": prepared(problem).compile_s}
        surrogate = prepared(problem)
    pairs: list[tuple[Round, Round]] = []
    with sumo_engine(problem, cores) as sumo:
        timed(sumo, requests[:cores])  # processes start
        timed(surrogate, requests)  # finds out how much room the runs need
        for number in range(rounds):
            few = [requests[(cores * number + core) % sets] for core in range(cores)]
            pairs.append((timed(surrogate, requests), timed(sumo, few)))
    ratios = [ours.rate / theirs.rate for ours, theirs in pairs]
    return {
        "case": problem.case.name,
        "sets": sets,
        "surrogate_vehicle_steps_per_s": statistics.median(ours.rate for ours, _ in pairs),
        "sumo_vehicle_steps_per_s": statistics.median(theirs.rate for _, theirs in pairs),
        "ratio": {"median": statistics.median(ratios), "min": min(ratios), "max": max(ratios)},
        "compile_s": compile_s,
        "bytes_per_vehicle_and_set": bytes_per_vehicle(surrogate),
        "devices": [str(device) for device in jax.devices()],
        "cores": cores,
    }


if __name__ == "__main__":
    app()
