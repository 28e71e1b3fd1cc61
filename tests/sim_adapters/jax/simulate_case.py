"""Run with a number of devices, a case and a file to write: runs of its surrogate, as a process of its own.

The file gets what each run came to, bit for bit, and how the batch lay on the devices.
"""

import json
import sys
from pathlib import Path

from jaxcalib.cli.compilation_cache import keep_compiled_programs

keep_compiled_programs()

import jax  # noqa: E402

from jaxcalib.problem.engines import prepare_devices, surrogate_engine  # noqa: E402
from jaxcalib.problem.problem import read_problem  # noqa: E402
from sim_adapters.interface import RunRequest  # noqa: E402
from sim_adapters.jax.simulator import JaxSimulator  # noqa: E402

DEPART_S = 91.0
NUM_REQUESTS = 42  # three batches of one device, the last not full; less than one of eight


def runs_of_devices(simulator: JaxSimulator) -> list[list[int]]:
    """Return which runs of a batch each device computes, as the program of the runs has it."""
    (inputs, *_), _ = simulator._program(1).program.input_shardings
    rows = inputs.values.devices_indices_map((simulator.batch, len(simulator.layout.names)))
    return sorted(list(range(simulator.batch))[place[0]] for place in rows.values())


def main(num_devices: int, case: Path, result: Path) -> None:
    prepare_devices(num_devices)
    problem = read_problem(case)
    simulator = surrogate_engine(problem)
    base = problem.template.base_values()
    # every run has another demand and seed, so none can be taken for another
    requests = [RunRequest(tuple(base * (1.0 - 0.005 * one)), 40 + one, DEPART_S) for one in range(NUM_REQUESTS)]
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
                "runs_of_devices": runs_of_devices(simulator),
                "compile_s": simulator.compile_s,
                "forwards": told[:NUM_REQUESTS],
                "backwards": told[NUM_REQUESTS:],
            }
        ),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]))
