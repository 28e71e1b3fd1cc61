"""`python -m experiments.benchmarks.accelerator`: vehicle-steps per second of the surrogate on the devices JAX sees.

The runs are those of `experiments.benchmarks.throughput`, with all features, but many more of them, since an
accelerator is filled by thousands of runs. SUMO, which gains nothing from one, need not be installed. Runs that hold
more vehicles than most are made again with more room, as in a sweep: that time counts, their first try does not.
Runs that fail count with their time only.
"""

import json
import statistics
import time
from collections import Counter
from pathlib import Path
from typing import Annotated

import jax
from cyclopts import App, Parameter
from cyclopts.validators import Number

from experiments.benchmarks.throughput import CASE, SPARE_CAPACITY, bytes_per_vehicle, parameter_sets
from experiments.results.record import record as keep
from jaxcalib.problem.problem import read_problem
from jaxcalib.sweeps.local_engines import RoomySurrogate
from sim_adapters.interface import RunRequest

app = App(name="experiments.benchmarks.accelerator", help="Vehicle-steps per second of the surrogate alone.")


def measured(engine: RoomySurrogate, requests: list[RunRequest]) -> tuple[float, dict[str, int]]:
    """Return vehicle-steps per second of the runs that succeed, and how many fail of what."""
    began = time.perf_counter()
    outcomes = engine.run(requests)
    wall_s = time.perf_counter() - began
    failed = Counter(outcome.status.value for outcome in outcomes if not outcome.status.is_ok)
    return sum(outcome.num_vehicle_steps for outcome in outcomes if outcome.status.is_ok) / wall_s, dict(failed)


@app.default
def accelerator(
    case: Path = CASE,
    /,
    *,
    sets: Annotated[list[int] | None, Parameter(validator=Number(gte=1, lte=1_000_000))] = None,
    batch: Annotated[int | None, Parameter(validator=Number(gte=1, lte=1_000_000))] = None,
    rounds: Annotated[int, Parameter(validator=Number(gte=1, lte=100))] = 3,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Print one line of JSON for each number of sets.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    sets
        Numbers of parameter sets; 8192 unless given.
    batch
        Runs that a device makes together; from the room that they need unless given.
    rounds
        Rounds of each.
    record
        Also write the table to experiments/results.
    """
    problem = read_problem(case)
    depart_s, drive = problem.drive_starts("fit")[0]
    engine = RoomySurrogate(problem, SPARE_CAPACITY, batch)
    engine.engine(0).prepare()
    first_compile_s = engine.compile_s
    rows = []
    for number in sets or [8192]:
        requests = [
            RunRequest(values, seed, depart_s, drive=drive)
            for seed, values in enumerate(parameter_sets(problem, number))
        ]
        measured(engine, requests)  # compiles what dense runs need
        made = [measured(engine, requests) for _ in range(rounds)]
        rates = [rate for rate, _ in made]
        row = {
            "case": problem.case.name,
            "sets": number,
            "vehicle_steps_per_s": {"median": statistics.median(rates), "min": min(rates), "max": max(rates)},
            "failed": made[0][1],
            "batch": engine.batch,
            "compile_s": first_compile_s,
            "bytes_per_vehicle_and_set": bytes_per_vehicle(engine.engine(0)),
            "devices": [f"{device.device_kind} {device.id}" for device in jax.devices()],
        }
        print(json.dumps(row), flush=True)
        rows.append(row)
    if record:
        title = f"Parameter sets on an accelerator: {problem.case.name}"
        keep("performance", f"accelerator-{problem.case.name}", rows, title)
    return 0


if __name__ == "__main__":
    app()
