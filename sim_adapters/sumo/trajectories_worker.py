"""The process that writes trajectories: reads a question on standard input, prints the answer as its last line."""

import json
import sys

from sim_adapters.sumo.question import ANSWER


def answer(question: dict) -> dict:
    """Run to the end, SUMO writing its floating car data, and say what each vehicle is."""
    import libsumo

    libsumo.start(["sumo", *question["arguments"]])
    simulation, vehicle = libsumo.simulation, libsumo.vehicle
    vehicles, until_s = {}, question["end_s"]
    subject, arrived = question["subject"], False
    while simulation.getTime() < until_s and not arrived:
        libsumo.simulationStep()
        for name in simulation.getDepartedIDList():
            size = (vehicle.getLength(name), vehicle.getWidth(name), vehicle.getHeight(name))
            vehicles[name] = [*size, vehicle.getVehicleClass(name)]
        arrived = subject in simulation.getArrivedIDList()
    libsumo.close()
    return {"vehicles": vehicles}


if __name__ == "__main__":
    print(f"\n{ANSWER}{json.dumps(answer(json.load(sys.stdin)))}", flush=True)
