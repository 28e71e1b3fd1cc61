"""The SUMO side of a lane change that takes time, in a process of its own, as libsumo holds one simulation.

Arguments: a folder with the scenario, for the results as well, and the duration of lane changes.
"""

import sys
from pathlib import Path

import libsumo
import numpy as np

from experiments.fidelity.timed_change import CHANGE_STEP, NUM_STEPS, STEP_S, VEHICLES


def main(folder: Path, duration_s: str) -> None:
    """Run SUMO and write positions, speeds, accelerations and lanes, [what, step, vehicle]."""
    libsumo.start(
        [
            "sumo", "-n", str(folder / "net.net.xml"), "-r", str(folder / "demand.rou.xml"), "--step-length",
            str(STEP_S), "--no-step-log", "--no-warnings", "--lanechange.duration", duration_s,
            "--lanechange.overtake-right", "true",
        ]
    )  # fmt: skip
    names = [vehicle[0] for vehicle in VEHICLES]
    ask = (
        libsumo.vehicle.getLanePosition, libsumo.vehicle.getSpeed, libsumo.vehicle.getAcceleration,
        libsumo.vehicle.getLaneIndex,
    )  # fmt: skip
    states = []
    for step in range(NUM_STEPS):
        libsumo.simulationStep()
        for name in names if step == 0 else ():
            libsumo.vehicle.setLaneChangeMode(name, 0)
        if step == CHANGE_STEP - 1:
            libsumo.vehicle.changeLane(names[0], 1, 1000.0)
        states.append([[getter(name) for name in names] for getter in ask])
    libsumo.close()
    np.save(folder / "change.npy", np.asarray(states, float).transpose(1, 0, 2))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
