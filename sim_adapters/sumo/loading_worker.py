"""The process that loads a scenario in SUMO: reads a question on standard input, prints the answer as its last line."""

import json
import sys

# SUMO's attribute names and the questions that libsumo answers of a vType.
QUESTIONS = {
    "length": "getLength", "minGap": "getMinGap", "tau": "getTau", "accel": "getAccel", "decel": "getDecel",
    "emergencyDecel": "getEmergencyDecel", "sigma": "getImperfection", "maxSpeed": "getMaxSpeed",
    "speedFactor": "getSpeedFactor", "speedDev": "getSpeedDeviation", "actionStepLength": "getActionStepLength",
}  # fmt: skip


def answer(question: dict) -> dict:
    """What SUMO says of the scenario that the question's arguments load."""
    import libsumo

    libsumo.start(["sumo", *question["arguments"]])
    vtypes = {
        name: {attribute: getattr(libsumo.vehicletype, ask)(name) for attribute, ask in QUESTIONS.items()}
        for name in libsumo.vehicletype.getIDList()
    }
    ways = [_way(libsumo, *trip) for trip in question["trips"]]
    libsumo.close()
    return {"vtypes": vtypes, "ways": ways}


def _way(libsumo, origin: str, destination: str, via: list[str], vtype: str) -> list[str]:
    """Edges from origin to destination; none where there is no way."""
    edges: list[str] = []
    for begin, end in zip([origin, *via], [*via, destination], strict=True):
        piece = list(libsumo.simulation.findRoute(begin, end, vtype).edges)
        if not piece:
            return []
        edges += piece if not edges else piece[1:]
    return edges


if __name__ == "__main__":
    said = answer(json.load(sys.stdin))
    print(f"\njaxcalib answer: {json.dumps(said)}", flush=True)
