"""Minimal cases with one trouble each: accepted and right, or refused in a line that names the element."""

from pathlib import Path

import pytest

from jaxcalib.check.scenario_check import check_case
from sim_adapters.scenario.finding import Level
from sim_adapters.scenario.scenario import read_scenario
from sim_adapters.sumo.loading import load_in_sumo
from tests.places import SHARED

FAULTS = SHARED / "faults"
WHILE_IT_TAKES_S = 120.0

# Level, file, and words of the one finding, or of each of several; nothing where all is followed.
ACCEPTED: dict[str, list[tuple[Level, str, str]]] = {
    "00_base": [],
    "02_detectors": [(Level.BESIDE, "det.add.xml", "inductionLoop")],
    "05_step_1s": [],
    "07_vtype_distribution": [],
    "08_from_to": [],
    "10_minor_link": [(Level.APPROXIMATED, "highway.net.xml", "gives way")],
    "15_model_message_twice": [(Level.APPROXIMATED, "highway-ramp.rou.xml", "vType 'truck'")],
    "16_option_outside_section": [],
    "18_no_type": [],
    "23_norm": [],
    "24_hms": [],
    "25_route_distribution": [],
    "26_perhour": [],
    "27_scale": [],
}
# What the lines have to say: the file, the element, what to do.
REFUSED = {
    "06_no_projection": ("d01_subject.csv.gz", "columns longitude_rad and latitude_rad", "x_m, y_m"),
    "09_time_of_day": ("highway-ramp.sumocfg", "option 'end'", "expected an end after its begin, 28800 s"),
    "14_broken_route_late": ("highway-ramp.rou.xml", "flow 'f_2_passenger_through'", "from edge 'onr' to 'M3'"),
    "28_unused_connection": ("d01_subject.csv.gz", "row 2", "Is it the log of another road?"),
}


def case_of(name: str) -> Path:
    if not (FAULTS / name).is_dir():
        pytest.skip(f"{FAULTS / name} is not there")
    return FAULTS / name


@pytest.mark.long
@pytest.mark.parametrize("name", ACCEPTED)
def test_accepted(name: str):
    found = check_case(case_of(name), first_run_s=WHILE_IT_TAKES_S)
    assert found.refusals == ()
    assert [(one.level, one.file) for one in found.findings] == [one[:2] for one in ACCEPTED[name]]
    for finding, (_, _, words) in zip(found.findings, ACCEPTED[name], strict=True):
        assert words in str(finding)
    assert found.first_run is not None
    assert found.first_run.arrived_s is not None


@pytest.mark.long
@pytest.mark.parametrize("name", ["01_depart_attributes", "03_vehicles", "04_time_varying"])
def test_how_vehicles_come_is_no_reason_to_refuse(name: str):
    """Whether the surrogate follows it, or SUMO alone has to."""
    found = check_case(case_of(name), first_run_s=WHILE_IT_TAKES_S)
    assert found.refusals == ()
    assert {finding.file for finding in found.findings} <= {"highway-ramp.rou.xml"}
    assert found.first_run is not None
    assert found.first_run.arrived_s is not None


@pytest.mark.parametrize(("name", "share"), [("07_vtype_distribution", 1.0), ("08_from_to", 1.0), ("18_no_type", 1.0),
                                             ("24_hms", 1.0), ("25_route_distribution", 1.0), ("26_perhour", 1.0),
                                             ("27_scale", 0.5)])  # fmt: skip
def test_as_many_vehicles_come_as_were_written(name: str, share: float):
    rates = []
    for case in (case_of("00_base"), case_of(name)):
        config = case / "scenario/highway-ramp.sumocfg"
        scenario = read_scenario(config, "ego", 1600.0, load_in_sumo)
        rates.append(sum(map(scenario.mean_rate_vehps, scenario.flow_ids)))
    assert rates[1] == pytest.approx(share * rates[0], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str):
    refusals = check_case(case_of(name), first_run_s=WHILE_IT_TAKES_S).refusals
    file, *parts = REFUSED[name]
    assert refusals[0].startswith(f"{file}: ")
    assert all(part in refusals[0] for part in parts)
    assert "\n" not in refusals[0]
