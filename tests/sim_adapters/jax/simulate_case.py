"""Run with a number of devices, a case and a file to write: runs of a short drive, as a process of its own.

The file gets what each run came to, bit for bit, and how the batch lay on the devices.
"""

import json
import sys
from pathlib import Path
from typing import Any

from jaxcalib.cli.compilation_cache import keep_compiled_programs

keep_compiled_programs()

import jax  # noqa: E402
import numpy as np  # noqa: E402
from jax.sharding import Mesh  # noqa: E402

from jaxcalib.problem.engines import prepare_devices  # noqa: E402
from jaxcalib.problem.problem import read_problem  # noqa: E402
from sim_adapters.interface import RunRequest  # noqa: E402
from sim_adapters.jax.batch_program import BatchProgram  # noqa: E402
from sim_adapters.jax.program_store import program_store  # noqa: E402
from sim_adapters.jax.simulator import JaxSimulator  # noqa: E402
from surrogate.loop.world import Clock  # noqa: E402
from surrogate.road.perception import Sensor  # noqa: E402

DEPART_S, END_S = 31.0, 70.0
CAPACITY = 128
NUM_REQUESTS = 10  # neither a multiple of 4 nor of 16: batches are filled up


def runs_of_devices(parts: dict[str, Any], batch: int) -> list[list[int]]:
    """Return which runs of a batch each device computes, as the compiled program has it: the one that is kept."""
    mesh = Mesh(np.asarray(jax.devices()), ("run",))
    program = BatchProgram(**parts, steps_per_frame=5, has_effects=False, batch=batch, mesh=mesh)
    (inputs, *_), _ = program.compiled(CAPACITY, 1, program_store()).program.input_shardings
    rows = inputs.values.devices_indices_map((batch, len(parts["template"].layout.names)))
    return sorted(list(range(batch))[place[0]] for place in rows.values())


def main(num_devices: int, case: Path, result: Path) -> None:
    prepare_devices(num_devices)
    problem = read_problem(case)
    parts = {
        "template": problem.template,
        "observer": problem.tally,
        "sensor": Sensor(jax.numpy.asarray(150.0), jax.numpy.asarray(150.0), 8),
        "clock": Clock(step_s=0.1, steps_per_decision=10),
        "end_s": END_S,
    }
    simulator = JaxSimulator(**parts, capacity=CAPACITY, runs_per_device=2, programs=program_store())
    base = problem.template.base_values()
    # every run has another demand and seed, so none can be taken for another
    requests = [RunRequest(tuple(base * (1.0 - 0.01 * one)), 40 + one, DEPART_S) for one in range(NUM_REQUESTS)]
    outcomes = simulator.run(requests) + simulator.run(requests[::-1])[::-1]
    told = [
        [one.status.value, one.observed.tobytes().hex() if one.observed is not None else None,
         one.num_inserted.tolist(), one.num_vehicle_steps, one.num_collisions]
        for one in outcomes
    ]  # fmt: skip
    result.write_text(
        json.dumps(
            {
                "devices": len(jax.devices()),
                "batch": simulator.batch,
                "runs_of_devices": runs_of_devices(parts, simulator.batch),
                "compile_s": simulator.compile_s,
                "forwards": told[:NUM_REQUESTS],
                "backwards": told[NUM_REQUESTS:],
            }
        ),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]))
