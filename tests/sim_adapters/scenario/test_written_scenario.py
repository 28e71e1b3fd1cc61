"""What is written is an ordinary scenario: plain SUMO runs it, and it says what was asked for."""

import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.scenario_writer import WrittenScenario, flow_factors, write_scenario
from sim_adapters.world.world_builder import build_template

VALUES = (2750.0, 640.0, 1.3, 2.4, 2.7, 1.07, 0.14, 0.9, 3.5)
DEPART_S = 24.0


def element(file: Path, tag: str, name: str) -> ET.Element:
    (found,) = (element for element in ET.parse(file).getroot() if (element.tag, element.get("id")) == (tag, name))
    return found


@pytest.fixture
def write(corridor: Scenario, layout: ParameterLayout, tmp_path: Path) -> Callable[..., WrittenScenario]:
    """Return a function that writes the corridor into a folder of its own."""

    def written(folder: str, **options: Any) -> WrittenScenario:
        (tmp_path / folder).mkdir()
        return write_scenario(corridor, layout, VALUES, DEPART_S, "ego", tmp_path / folder, **options)

    return written


@pytest.fixture
def trajectories(start_sumo: Callable[..., subprocess.Popen], tmp_path: Path) -> Callable[..., list[bytes]]:
    """Return a function that runs plain SUMO for a minute and returns what it writes of all vehicles."""

    def run(*runs: tuple[Path, int]) -> list[bytes]:
        files = [tmp_path / f"fcd-{number}.csv" for number in range(len(runs))]
        options = ("--precision", "6", "--device.fcd.period", "1", "--fcd-output.acceleration", "true")
        processes = [
            start_sumo(60.0, "ego", None, "-c", config, "--seed", str(seed), "--fcd-output", file, *options)
            for (config, seed), file in zip(runs, files, strict=True)
        ]
        assert [process.wait() for process in processes] == [0] * len(processes)
        return [file.read_bytes() for file in files]

    return run


def test_the_same_seed_gives_the_same_bits_wherever_it_is_written(
    write: Callable[..., WrittenScenario], trajectories: Callable[..., list[bytes]], tmp_path: Path
):
    here = write("here", name="run")
    with_net = write(
        "with-net", is_handed_over=True, comments={"tau": "time gap [s]"}, head="made for a test -- no more"
    )
    # a folder with its own network can be given away
    moved = Path(shutil.move(with_net.config.parent, tmp_path / "moved")) / with_net.config.name
    one, same, other_seed = trajectories((here.config, 5), (moved, 5), (here.config, 6))
    assert b";ego;" in one
    assert len(one) > 100_000
    assert one == same
    assert one != other_seed


def test_the_scenario_s_own_values_give_the_scenario(
    corridor: Scenario, layout: ParameterLayout, trajectories: Callable[..., list[bytes]], tmp_path: Path
):
    base = build_template(corridor, layout).base_values().tolist()
    written = write_scenario(corridor, layout, base, 300.0, "ego", tmp_path)
    original, again = trajectories((corridor.configuration.file, 2), (written.config, 2))
    assert original == again


def test_attributes_flows_and_departure_are_in_the_files(
    write: Callable[..., WrittenScenario], corridor: Scenario, layout: ParameterLayout
):
    written = write("out")
    car, before = element(written.files[-1], "vType", "car"), corridor.demand.vtypes["car"]
    changed = dict(zip(layout.attributes, ("1.3", "2.4", "2.7", "1.07", "0.14", "0.9", "3.5"), strict=True))
    assert dict(car.attrib) == before | changed
    assert dict(element(written.files[-1], "vType", "subject").attrib) == corridor.demand.vtypes["subject"]
    assert float(element(written.files[-1], "vehicle", "ego").get("depart", "")) == DEPART_S
    # the shares of an input's flows stay: 0.13 to 0.953333 on the main road, 0.017333 to 0.127111 on the ramp
    for flow, rate in {
        "f_main_o1": 2750 / 3600 * 0.13 / 1.083333,
        "f_main_e": 2750 / 3600 * 0.953333 / 1.083333,
        "f_on1_o1": 640 / 3600 * 0.017333 / 0.144444,
        "f_on1_e": 640 / 3600 * 0.127111 / 0.144444,
    }.items():
        period = element(written.files[-1], "flow", flow).get("period", "")
        assert float(period.removeprefix("exp(").removesuffix(")")) == pytest.approx(rate, rel=1e-12)


def test_what_is_written_is_read_back(write: Callable[..., WrittenScenario], layout: ParameterLayout):
    written = write("again", is_handed_over=True)
    scenario = read_scenario(written.config, "ego", 720.0)
    np.testing.assert_allclose(build_template(scenario, layout).base_values(), VALUES, rtol=1e-6)
    assert scenario.demand.subject_depart_s == DEPART_S
    assert scenario.configuration.processing["time-to-teleport"] == "-1"
    assert scenario.warnings == ()


def test_the_configuration_holds_no_path_of_another_folder_if_the_network_is_copied(
    write: Callable[..., WrittenScenario],
):
    written = write("given away", is_handed_over=True)
    values = [option.get("value", "") for section in ET.parse(written.config).getroot() for option in section]
    assert not any("/" in value for value in values)


@pytest.mark.parametrize(
    ("rate", "attribute", "expected"),
    [
        ('vehsPerHour="457.6"', "vehsPerHour", 1280.0),
        ('period="exp(0.127111)"', "period", 1280 / 3600),
        ('period="7.9"', "period", 3600 / 1280),
        ('probability="0.127111"', "probability", 1280 / 3600),
        ('number="92"', "number", 256.0),  # in 720 s
    ],
)
def test_every_way_to_write_a_flow(
    own_corridor: Path, layout: ParameterLayout, tmp_path: Path, rate: str, attribute: str, expected: float
):
    demand = own_corridor / "scenario/demand.rou.xml"
    demand.write_text(demand.read_text().replace('period="exp(0.127111)"', rate))
    scenario = read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0)
    alone = ParameterLayout(("on1",), (("f_on1_e",),), layout.vtypes, ())
    factor = flow_factors(scenario, alone, [1280.0])["f_on1_e"]
    assert factor * scenario.mean_rate_vehps("f_on1_e") == pytest.approx(1280 / 3600)
    written = write_scenario(scenario, alone, [1280.0], DEPART_S, "ego", tmp_path)
    text = element(written.files[-1], "flow", "f_on1_e").get(attribute, "")
    assert float(text.removeprefix("exp(").removesuffix(")")) == pytest.approx(expected, rel=1e-6)
    assert ("exp(" in text) == ("exp(" in rate)


def test_a_bounded_speed_factor_keeps_its_bounds(own_corridor: Path, layout: ParameterLayout, tmp_path: Path):
    demand = own_corridor / "scenario/demand.rou.xml"
    text = demand.read_text().replace('speedFactor="1.0" speedDev="0.1"', 'speedFactor="normc(1.0, 0.1, 0.7, 1.4)"')
    demand.write_text(text)
    scenario = read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0)
    assert scenario.values_of("car")["speedDev"] == pytest.approx(0.1)
    written = write_scenario(scenario, layout, VALUES, DEPART_S, "ego", tmp_path)
    car = element(written.files[-1], "vType", "car")
    assert car.get("speedFactor") == "normc(1.07,0.14,0.7,1.4)"
    assert car.get("speedDev") is None


def test_flows_that_begin_later_stand_behind_who_departs_before(
    own_corridor: Path, layout: ParameterLayout, tmp_path: Path
):
    """SUMO would leave them out, and says so in a warning only."""
    demand = own_corridor / "scenario/demand.rou.xml"
    begin = demand.read_text().replace('id="f_on1_e" type="car" route="r_on1_e" begin="0"',
                                       'id="f_on1_e" type="car" route="r_on1_e" begin="350"')  # fmt: skip
    begin = begin.replace('id="f_on1_o1" type="car" route="r_on1_o1" begin="0"',
                          'id="f_on1_o1" type="car" route="r_on1_o1" begin="350"')  # fmt: skip
    demand.write_text(begin)
    scenario = read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0)
    written = write_scenario(scenario, layout, VALUES, (300.0, 340.0, 380.0), "ego", tmp_path)
    timed = [one for one in ET.parse(written.files[-1]).getroot() if one.tag in ("flow", "vehicle")]
    times = [float(one.get("depart") or one.get("begin") or 0.0) for one in timed]
    assert times == sorted(times) == [0.0, 0.0, 300.0, 340.0, 350.0, 350.0, 380.0]


def test_the_vtype_that_no_file_names_is_written_where_it_is_calibrated(own_corridor: Path, tmp_path: Path):
    demand = own_corridor / "scenario/demand.rou.xml"
    demand.write_text(demand.read_text().replace('type="car" ', ""))
    scenario = read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0)
    assert {flow.vtype for flow in scenario.flows} == {"DEFAULT_VEHTYPE"}
    layout = ParameterLayout((), (), ("DEFAULT_VEHTYPE",), ("tau", "sigma"))
    written = write_scenario(scenario, layout, [1.4, 0.3], DEPART_S, "ego", tmp_path)
    first = ET.parse(written.files[0]).getroot()[0]
    assert (first.tag, first.get("id"), first.get("tau")) == ("vType", "DEFAULT_VEHTYPE", "1.4")
    from sim_adapters.scenario.configuration import read_configuration
    from sim_adapters.sumo.loading import load_in_sumo

    assert load_in_sumo(read_configuration(written.config)).vtypes["DEFAULT_VEHTYPE"]["tau"] == 1.4
