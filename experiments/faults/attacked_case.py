"""The case that is attacked: one kilometre, two lanes and an on-ramp, four drives of a minute; sound, and small.

SUMO makes its logs, in a process of its own: `python -m experiments.faults.attacked_case FOLDER`.
"""

import sys
from pathlib import Path

from experiments.blind_effects.drive import record_drive
from experiments.blind_effects.field_spec import DriverType, FieldSpec
from experiments.blind_effects.generate import write_case
from experiments.blind_effects.sensors import logs
from experiments.roads.road import BELIEVED_DRIVER, ROADS, SUBJECT, Flow, Road

NAME = "attacked"
MAIN, RAMP = ("m2", "m3", "m4"), ("in1", "on1", "m3", "m4")
ROAD = Road(
    name=NAME,
    net_file=ROADS["two_lane"].net_file,
    ego_edges=MAIN,
    flows=(Flow("f_main", "main", 1.0, MAIN), Flow("f_on1", "on1", 1.0, RAMP)),
    inputs_vehph={"main": 2700.0, "on1": 420.0},
    local_edges=(),
    edges_before_ramp=(),
    warmup_s=60.0,
    duration_s=180.0,
)
# drivers of the road, other than those whom the scenario believes in: a calibration has something to find
TRUE_DRIVER = BELIEVED_DRIVER | {"tau": "1.7", "speedFactor": "0.8"}
TRUE_INPUTS_VEHPH = {"main": 2000.0, "on1": 420.0}
DEPARTS_S = [60.0, 70.0, 80.0, 90.0]
ROLES = ["fit", "fit", "fit", "held_out"]
FIRST_SEED = 301


def make(folder: Path) -> None:
    """Write the case."""
    spec = FieldSpec((DriverType(1.0, TRUE_DRIVER),), SUBJECT, TRUE_INPUTS_VEHPH)
    made = []
    for seed, depart_s in enumerate(DEPARTS_S, FIRST_SEED):
        recording = record_drive(spec, ROAD, seed, depart_s)
        made.append((*logs(recording, ROAD, spec.sensor, seed), None))
    write_case(folder, NAME, ROAD, made, DEPARTS_S, ROLES)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
