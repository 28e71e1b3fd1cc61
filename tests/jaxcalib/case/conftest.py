"""A small valid case to be spoilt."""

from pathlib import Path

import pytest

CASE_TOML = """\
format = 1
name = "small"

[scenario]
config     = "scenario/scenario.sumocfg"
warmup_s   = 60.0
duration_s = 300
step_s     = 0.1

[subject]
vtype        = "subject"
vehicle      = "ego"

[perception]
ahead_m   = 150.0
behind_m  = 120.0
reference = "front"
nominal_length_m = 4.8

[behaviour]
vtypes = ["car"]
car_following = "IDM"
parameters = ["tau", "minGap"]

[[input]]
id    = "main"
flows = ["f_main_o1", "f_main_e"]

[[input]]
id    = "on1"
flows = ["f_on1"]

[[drive]]
id       = "d01"
depart_s = 60.0
subject  = "field/d01_subject.csv"
objects  = "field/d01_objects.csv"
role     = "fit"

[[drive]]
id       = "d02"
depart_s = 80.0
subject  = "field/d02_subject.csv"
objects  = "field/d02_objects.csv"
role     = "held_out"
"""
FILES = (
    "scenario/scenario.sumocfg",
    "field/d01_subject.csv",
    "field/d01_objects.csv",
    "field/d02_subject.csv",
    "field/d02_objects.csv",
)


@pytest.fixture
def case_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "small case"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    (folder / "case.toml").write_text(CASE_TOML)
    return folder
