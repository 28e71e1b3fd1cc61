"""Flows and single vehicles cut into windows of time, each with a factor of its own, in both simulators alike."""

import xml.etree.ElementTree as ET
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.demand_windows import cut_flows, id_at, parts_in_windows
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.world.world_builder import build_template

BEGINS_S = (0.0, 250.0, 500.0)
SINGLE = '<vehicle id="v{0}" type="car" route="r_main_e" depart="{0}" departLane="0"/>'
WINDOWS = {"f_main_e": BEGINS_S, "vehicles of in0": BEGINS_S}
LAYOUT = ParameterLayout(
    ("main@0", "main@250", "main@500"),
    tuple((f"f_main_e@{begin}", f"vehicles of in0@{begin}") for begin in (0, 250, 500)),
    ("car",),
    ("tau",),
)


def parts_of(attributes: str, begins_s: tuple[float, ...] = BEGINS_S) -> list[dict[str, str]]:
    flow = ET.fromstring(f'<flow id="f" {attributes}/>')
    return [dict(part.attrib) for part in cut_flows(Path("x"), [flow], {"f": begins_s})]


def test_a_part_keeps_all_but_its_window():
    assert parts_of('route="r" begin="100" end="400" period="exp(0.2)"') == [
        {"id": "f@0", "route": "r", "begin": "100.0", "end": "250.0", "period": "exp(0.2)"},
        {"id": "f@250", "route": "r", "begin": "250.0", "end": "400.0", "period": "exp(0.2)"},
    ]


def test_the_first_window_reaches_back_and_the_last_one_on():
    parts = parts_of('vehsPerHour="900"', (250.0, 500.0))
    assert [(part["begin"], part.get("end")) for part in parts] == [("0.0", "500.0"), ("500.0", None)]


@pytest.mark.parametrize(
    ("attributes", "ends", "vehph"),
    [
        ('number="80" end="800"', ["250.0", "500.0", "800.0"], 360.0),
        ('number="80" vehsPerHour="720"', ["250.0", "400.0"], 720.0),
    ],
)
def test_a_number_of_vehicles_becomes_a_rate_and_an_end(attributes: str, ends: list[str], vehph: float):
    parts = parts_of(attributes)
    assert [part["end"] for part in parts] == ends
    assert {float(part["vehsPerHour"]) for part in parts} == {vehph}
    assert not any("number" in part for part in parts)


def test_what_nothing_cuts_stays():
    other = ET.fromstring('<flow id="g" period="3"/>')
    assert cut_flows(Path("x"), [other], {"f": BEGINS_S}) == [other]
    assert id_at("g", {"f": BEGINS_S}, 300.0) == "g"
    assert [id_at("f", {"f": (250.0, 500.0)}, time_s) for time_s in (0.0, 250.0, 499.9, 500.0)] == [
        "f@250", "f@250", "f@250", "f@500",
    ]  # fmt: skip
    assert parts_in_windows("f", {"f": BEGINS_S}, ["f@500", "g", "f@0"]) == ("f@0", "f@500")


@pytest.fixture
def cut(own_corridor: Path) -> Scenario:
    file = own_corridor / "scenario/demand.rou.xml"
    singles = "".join(SINGLE.format(depart_s) for depart_s in range(60, 720, 10))
    file.write_text(file.read_text().replace("<vehicle ", f"{singles}<vehicle ", 1))
    return read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0, windows=WINDOWS)


def test_as_many_vehicles_come_in_each_window_in_both_simulators(cut: Scenario, tmp_path: Path):
    template = build_template(cut, LAYOUT)
    factors = np.asarray([1.0, 0.5, 2.0])
    values = template.base_values() * [*factors, 1.0]
    written = write_scenario(cut, LAYOUT, values, 300.0, "ego", tmp_path)
    elements = [element for file in written.files for element in ET.parse(file).getroot()]
    rates = {one.get("id"): one.get("period") for one in elements if one.tag == "flow"}
    period = {begin: rates[f"f_main_e@{begin}"] for begin in (0, 250, 500)}
    np.testing.assert_allclose([float(text[4:-1]) for text in period.values() if text], 0.953333 * factors, rtol=1e-6)
    assert rates["f_main_o1"] == "exp(0.130000)"
    in_sumo = [float(one.get("depart", 0)) for one in elements if (one.get("id") or "").startswith("v")]
    assert len([depart_s for depart_s in in_sumo if depart_s < 250]) == 19
    table = template.world(jnp.asarray(values, jnp.float32), jnp.asarray(5), jnp.asarray(300.0)).inflow.timetable
    assert table is not None
    of_singles = np.sort(np.asarray(table.time_s)[-1])
    np.testing.assert_allclose(of_singles[np.isfinite(of_singles)], np.sort(in_sumo))
    of_flows = np.asarray(table.time_s)[0]
    for begin_s, end_s, factor in zip(BEGINS_S, (*BEGINS_S[1:], 720.0), factors, strict=True):
        expected = (end_s - begin_s) * (0.953333 * factor + 0.13)
        number = np.sum((of_flows >= begin_s) & (of_flows < end_s))
        assert abs(number - expected) < 4.0 * np.sqrt(expected)
