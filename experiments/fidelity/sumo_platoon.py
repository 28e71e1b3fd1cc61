"""Runs one platoon in SUMO; a process of its own, since libsumo holds one simulation per process.

Arguments: the folder with net, demand and the leader's speeds; the number of vehicles.
"""

import sys
from pathlib import Path

import numpy as np


def main(folder: Path, num_vehicles: int) -> None:
    """Write the front bumpers at the beginning of each step, [step, vehicle]."""
    import libsumo

    leader_mps = np.load(folder / "leader.npy")
    options = ["--net-file", str(folder / "net.net.xml"), "--route-files", str(folder / "demand.rou.xml")]
    quiet = ["--no-step-log", "--no-warnings", "--collision.action", "none"]
    libsumo.start(["sumo", *options, "--step-length", "0.1", *quiet])
    names = [str(index) for index in range(num_vehicles)]
    libsumo.simulationStep()  # vehicles enter at the end of it
    libsumo.vehicle.setSpeedMode(names[0], 0)
    places = []
    for step in range(len(leader_mps)):
        places.append([libsumo.vehicle.getLanePosition(name) for name in names])
        if step + 1 < len(leader_mps):
            libsumo.vehicle.setSpeed(names[0], float(leader_mps[step + 1]))
            libsumo.simulationStep()
    libsumo.close()
    np.save(folder / "places.npy", np.asarray(places))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
