"""`python -m experiments.benchmarks.scaling`: does a vehicle-step cost the same, however many there are?

Two series, with all features on: parameter sets on the case's own road, through the engine as a calibration uses it, on
all cores; and vehicles on one road, the case's stretched and full of traffic from the beginning, on one core.
"""

import json
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import jax
import matplotlib.pyplot as plt
from cyclopts import App, Parameter
from cyclopts.validators import Number

from experiments.benchmarks.full_road import measure_road
from experiments.benchmarks.throughput import CASE, SPARE_CAPACITY, parameter_sets
from experiments.results.record import record as keep
from jaxcalib.problem.engines import prepare_devices, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunRequest

DEPART_S = 61.0  # long before the case's drives: short runs, so that thousands fit into minutes
SIMULATED_S = 20.0
LEAST_S = 1.0
app = App(name="experiments.benchmarks.scaling", help="Cost of a vehicle-step by parameter sets and by vehicles.")


def measure_sets(problem: CalibrationProblem, counts: list[int], rounds: int) -> list[dict[str, Any]]:
    """Return one record for each number of parameter sets."""
    engine = surrogate_engine(problem, SPARE_CAPACITY, most_overfull_share=0.0)
    engine.prepare()
    records = []
    vectors = parameter_sets(problem, max(counts))
    engine.run([RunRequest(vectors[0], 0, DEPART_S)])
    for count in counts:
        requests = [RunRequest(values, seed, DEPART_S) for seed, values in enumerate(vectors[:count])]
        walls, processors, vehicle_steps = [], [], 0
        for _ in range(rounds):
            began, began_cpu = time.perf_counter(), time.process_time()
            outcomes = engine.run(requests)
            walls.append(time.perf_counter() - began)
            processors.append(time.process_time() - began_cpu)
            vehicle_steps = sum(outcome.num_vehicle_steps for outcome in outcomes)
        records.append(
            {
                "series": "sets",
                "sets": count,
                "batch": engine.batch,
                "devices": len(jax.devices()),
                **costs(min(walls), min(processors), vehicle_steps),
                "bytes_per_vehicle_and_set": engine.memory_bytes() / (engine.batch * engine.capacity),
                "compile_s": engine.compile_s,
            }
        )
        print(json.dumps(records[-1]), flush=True)
    return records


def measure_vehicles(problem: CalibrationProblem, counts: list[int], num_runs: int | None) -> list[dict[str, Any]]:
    """Return one record for each number of vehicles."""
    records = []
    for count in counts:
        cost = asdict(measure_road(problem, count, SIMULATED_S, LEAST_S, num_runs))
        record = {"series": "vehicles", **cost, **costs(cost["wall_s"], cost["cpu_s"], cost["vehicle_steps"])}
        records.append(record)
        print(json.dumps(record), flush=True)
    return records


def costs(wall_s: float, cpu_s: float, vehicle_steps: int) -> dict[str, float]:
    """Return times per vehicle-step; processor time is what others on the machine disturb least."""
    return {
        "vehicle_steps": vehicle_steps,
        "wall_ns_per_vehicle_step": 1e9 * wall_s / vehicle_steps,
        "cpu_ns_per_vehicle_step": 1e9 * cpu_s / vehicle_steps,
    }


def draw(records: list[dict[str, Any]], path: Path) -> None:
    """Write the figure: cost over the number of sets and over the number of vehicles."""
    figure, panels = plt.subplots(1, 2, figsize=(8.0, 3.2), sharey=True, layout="constrained")
    for panel, series, label in zip(
        panels, ("sets", "vehicles"), ("parameter sets", "vehicles on one road"), strict=True
    ):
        rows = [record for record in records if record["series"] == series]
        for kind, style in (("wall", "o-"), ("cpu", "s--")):
            cost = [row[f"{kind}_ns_per_vehicle_step"] for row in rows]
            name = {"wall": "elapsed", "cpu": "processor time, all cores"}[kind]
            panel.loglog([row[series] for row in rows], cost, style, label=name, markersize=4)
        panel.set_xlabel(label)
        panel.grid(True, which="both", alpha=0.3)
    panels[0].set_ylabel("ns per vehicle-step")
    panels[0].legend()
    figure.savefig(path)
    plt.close(figure)


@app.default
def scaling(
    case: Path = CASE,
    /,
    *,
    most_sets: Annotated[int, Parameter(validator=Number(gte=1, lte=65_536))] = 4096,
    most_vehicles: Annotated[int, Parameter(validator=Number(gte=100, lte=1_000_000))] = 100_000,
    roads: Annotated[int | None, Parameter(validator=Number(gte=1, lte=65_536))] = None,
    rounds: Annotated[int, Parameter(validator=Number(gte=1, lte=100))] = 3,
    figure: Path | None = None,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Print one line of JSON for each point.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    most_sets
        Parameter sets go from 1 to that, times 4 each.
    most_vehicles
        Vehicles on one road go from 100 to that, times 10 each.
    roads
        Roads in a batch of the second series; as many as a calibration takes unless given.
    rounds
        Rounds of each number of sets; the fastest counts.
    figure
        File to draw the costs to (.svg, .png or .pdf).
    record
        Also write the table to experiments/results.
    """
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    sets = [4**power for power in range(9) if 4**power <= most_sets]
    vehicles = [10**power for power in range(2, 7) if 10**power <= most_vehicles]
    records = measure_vehicles(problem, vehicles, roads) + measure_sets(problem, sets, rounds)
    if figure is not None:
        draw(records, figure)
    if record:
        title = f"Cost of a vehicle-step by parameter sets and by vehicles: {problem.case.name}"
        keep("performance", f"scaling-{problem.case.name}", records, title)
    return 0


if __name__ == "__main__":
    app()
