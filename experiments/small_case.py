"""A case of one kilometre, for whole commands: two lanes and an on-ramp, drives of a minute, drivers who are known.

The scenario believes in other drivers than those who drive: they keep larger gaps, drive slower, and there are fewer.
SUMO makes the logs, as a process of its own: `python -m experiments.small_case FOLDER [DRIVES]`.
"""

import sys
from pathlib import Path

from experiments.blind_effects.drive import record_drive
from experiments.blind_effects.field_spec import DriverType, FieldSpec
from experiments.blind_effects.generate import write_case
from experiments.blind_effects.sensors import logs
from experiments.roads.road import BELIEVED_DRIVER, ROADS, SUBJECT, Flow, Road

MAIN, RAMP = ("m2", "m3", "m4"), ("in1", "on1", "m3", "m4")
ROAD = Road(
    name="small",
    net_file=ROADS["two_lane"].net_file,
    ego_edges=MAIN,
    flows=(Flow("f_main", "main", 1.0, MAIN), Flow("f_on1", "on1", 1.0, RAMP)),
    inputs_vehph={"main": 2700.0, "on1": 420.0},
    local_edges=(),
    edges_before_ramp=(),
    warmup_s=60.0,
    duration_s=180.0,
)
TRUTH = {"tau": 1.7, "speedFactor": 0.8}
TRUE_INPUTS_VEHPH = {"main": 2000.0, "on1": 420.0}
DEPARTS_S = (60.0, 70.0, 80.0, 90.0)
USUAL_DRIVES, FIRST_SEED = 8, 301


def make(folder: Path, num_drives: int = USUAL_DRIVES) -> None:
    """Write the case; every fourth drive is held out."""
    attributes = BELIEVED_DRIVER | {name: str(value) for name, value in TRUTH.items()}
    spec = FieldSpec((DriverType(1.0, attributes),), SUBJECT, TRUE_INPUTS_VEHPH)
    departs_s = [DEPARTS_S[number % len(DEPARTS_S)] for number in range(num_drives)]
    roles = ["held_out" if number % 4 == 3 else "fit" for number in range(num_drives)]
    made = []
    for number, depart_s in enumerate(departs_s):
        recording = record_drive(spec, ROAD, FIRST_SEED + number, depart_s)
        made.append((*logs(recording, ROAD, spec.sensor, FIRST_SEED + number), None))
    write_case(folder, "small", ROAD, made, departs_s, roles)


if __name__ == "__main__":
    make(Path(sys.argv[1]), *map(int, sys.argv[2:]))
