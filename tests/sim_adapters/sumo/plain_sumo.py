"""Runs SUMO with nothing of this project around it; libsumo holds one simulation per process.

Arguments: when to end, a vehicle, a file for what is ahead of it at each step, and SUMO's options.
"""

import sys


def main(end_s: float, subject_vehicle: str, leaders: str, options: list[str]) -> None:
    import libsumo

    libsumo.start(["sumo", "--no-step-log", "--duration-log.disable", "--no-warnings", *options])
    with open(leaders, "w", encoding="utf-8") as file:
        print("time_s;speed_mps;leader;gap_m", file=file)
        while libsumo.simulation.getTime() < end_s - 1e-6:
            time_s = libsumo.simulation.getTime()  # of the state after the step, as SUMO's outputs call it
            libsumo.simulationStep()
            if subject_vehicle not in libsumo.vehicle.getIDList():
                continue
            # SUMO counts from a bumper that is minGap further ahead
            leader, gap_m = libsumo.vehicle.getLeader(subject_vehicle, 200.0) or ("", float("nan"))
            gap_m += libsumo.vehicle.getMinGap(subject_vehicle)
            speed_mps = libsumo.vehicle.getSpeed(subject_vehicle)
            print(time_s, speed_mps, leader, gap_m, sep=";", file=file)
    libsumo.close()


if __name__ == "__main__":
    main(float(sys.argv[1]), sys.argv[2], sys.argv[3], sys.argv[4:])
