"""Long use of one engine in this process: `python -m experiments.faults.soaking surrogate|sumo ROUNDS CASE`.

Prints a line of JSON: memory once it has settled and at the end, compilations in between, runs that failed.
"""

import gc
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np

from experiments.faults.attack import environment
from jaxcalib.problem.engines import prepare_devices, sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunOutcome, RunRequest, Status

SETTLED = 20  # rounds after which nothing more should be taken
BATCH = 4  # runs of a batch of the surrogate
LAST = 5  # rounds whose memory is looked at, then and at the end; the least counts, for rubbish comes and goes
COMPILED = "/jax/core/compile/backend_compile_duration"
PAGES = Path("/proc/self/statm")
SPREAD = 0.1  # of values around the scenario's


def use(
    problem: CalibrationProblem, run: Callable[[list[RunRequest]], list[RunOutcome]], rounds: int, size: int
) -> dict:
    """Make rounds of runs, and take note of memory and compilations."""
    chance, compiled, memory_mb = np.random.default_rng(0), [], []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, duration_secs, **kwargs: compiled.append(event) if event == COMPILED else None
    )
    base, starts = problem.template.base_values(), problem.drive_starts("fit")
    num_failed = num_before = 0
    for number in range(rounds):
        requests = []
        for place in range(size):
            depart_s, drive = starts[place % len(starts)]
            values = base * (1.0 + SPREAD * chance.uniform(-1.0, 1.0, len(base)))
            requests.append(RunRequest(tuple(map(float, values)), number * size + place, depart_s, drive=drive))
        outcomes = run(requests)
        num_failed += sum(outcome.status is Status.FAILED for outcome in outcomes)
        if number + 1 == SETTLED:
            num_before = len(compiled)
        gc.collect()
        memory_mb.append(int(PAGES.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20)
    return {
        "rounds": len(memory_mb),
        "failed": num_failed,
        "settled_mb": min(memory_mb[SETTLED - LAST : SETTLED]),
        "last_mb": min(memory_mb[-LAST:]),
        "compilations_before": num_before,
        "compilations": len(compiled) - num_before,
    }


def main(engine: str, rounds: int, case: str) -> None:
    """Use an engine for long, and print what that took."""
    os.environ.update(environment())  # for workers
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    if engine == "surrogate":
        simulator = surrogate_engine(problem)
        found = use(problem, lambda requests: simulator.run(requests), rounds, BATCH)
    else:
        with sumo_engine(problem) as pool:
            found = use(problem, pool.run, rounds, 1)
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
