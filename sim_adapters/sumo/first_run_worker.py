"""The process that makes a first run: reads a question on standard input, prints the answer as its last line."""

import json
import sys
import time


def answer(question: dict) -> dict:
    """Run until the subject vehicle has arrived, the run's end, or the end of the time there is."""
    import libsumo

    libsumo.start(["sumo", *question["arguments"]])
    simulation, subject = libsumo.simulation, question["subject"]
    entered_s = arrived_s = None
    until_s, until_wall_s = question["end_s"], time.monotonic() + question["longest_s"]
    while simulation.getTime() < until_s and arrived_s is None and time.monotonic() < until_wall_s:
        libsumo.simulationStep()
        if subject in simulation.getDepartedIDList():
            entered_s = simulation.getTime()
        if subject in simulation.getArrivedIDList():
            arrived_s = simulation.getTime()
    now_s = simulation.getTime()
    is_there = subject in libsumo.vehicle.getIDList()
    said = {
        "reached_s": now_s,
        "is_whole": arrived_s is not None or now_s >= until_s,
        "entered_s": entered_s,
        "arrived_s": arrived_s,
        "edge": libsumo.vehicle.getRoadID(subject) if is_there else "",
        "waiting": list(simulation.getPendingVehicles()),
    }
    libsumo.close()
    return said


if __name__ == "__main__":
    said = answer(json.load(sys.stdin))
    print(f"\njaxcalib answer: {json.dumps(said)}", flush=True)
