"""What a parameter vector means for several vTypes: common factors, with a bound for shares, or values of their own."""

import dataclasses
import math
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import read_scenario
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.world.world_builder import build_template

LAYOUT = ParameterLayout(("main",), (("f_main_o1", "f_main_e"),), ("car", "van"), ("tau", "lcCooperative"))
SCALED = dataclasses.replace(LAYOUT, factors=((1.0, 1.0), (1.25, 2.0)), most=(math.inf, 1.0))
VALUES = (3100.0, 1.6, 0.7)
APART = dataclasses.replace(LAYOUT, groups=(("car",), ("van",)))
VALUES_APART = (*VALUES, 2.3, 0.4)
# the order of the vector is that of the groups, and the first of each is not the first of all
MIXED = dataclasses.replace(
    LAYOUT,
    vtypes=("car", "van", "truck"),
    factors=((0.8, 2.0), (1.0, 1.0), (1.0, 1.0)),
    most=(math.inf, 1.0),
    groups=(("van", "car"), ("truck",)),
)


@pytest.mark.parametrize(
    ("layout", "of_van"),
    [(LAYOUT, {"tau": 1.6, "lcCooperative": 0.7}), (SCALED, {"tau": 2.0, "lcCooperative": 1.0})],
)
def test_vtypes_share_values_or_factors(layout: ParameterLayout, of_van: dict[str, float]):
    assert layout.values_of("car", VALUES[1:]) == {"tau": 1.6, "lcCooperative": 0.7}
    assert layout.values_of("van", VALUES[1:]) == pytest.approx(of_van)


def test_each_group_has_its_part_of_the_vector():
    behaviour = VALUES_APART[1:]
    assert MIXED.values_of("van", behaviour) == {"tau": 1.6, "lcCooperative": 0.7}
    assert MIXED.values_of("car", behaviour) == pytest.approx({"tau": 0.8 * 1.6, "lcCooperative": 1.0})
    assert MIXED.values_of("truck", behaviour) == {"tau": 2.3, "lcCooperative": 0.4}


def test_names_say_the_group_where_there_are_several():
    names = ("main", "tau[van]", "lcCooperative[van]", "tau[truck]", "lcCooperative[truck]")
    assert MIXED.names == names
    assert (MIXED.names_of("tau"), MIXED.names_of("main")) == ((names[1], names[3]), ())
    assert MIXED.driver_parameters[2] == ("truck", "tau")
    together = dataclasses.replace(MIXED, groups=(("van", "truck", "car"),))
    assert together.names == LAYOUT.names == ("main", "tau", "lcCooperative")
    assert together.driver_parameters == (("van", "tau"), ("van", "lcCooperative"))


@pytest.fixture
def with_vans(own_corridor: Path) -> Path:
    """The corridor, on which the exit's traffic are vans."""
    demand = own_corridor / "scenario/demand.rou.xml"
    text = demand.read_text()
    car = text[text.index('<vType id="car"') :]
    car = car[: car.index("/>") + 2]
    flow = text[text.index('<flow id="f_main_o1"') :]
    flow = flow[: flow.index(">") + 1]
    text = text.replace(car, car + "\n" + car.replace('id="car"', 'id="van"'), 1)
    demand.write_text(text.replace(flow, flow.replace('type="car"', 'type="van"'), 1))
    return own_corridor / "scenario/scenario.sumocfg"


@pytest.mark.parametrize(
    ("layout", "values"),
    [(SCALED, VALUES), (SCALED, tuple(np.asarray(VALUES))), (APART, VALUES_APART)],
    ids=["float", "numpy", "apart"],
)
def test_both_simulators_get_the_same(
    layout: ParameterLayout, values: tuple[float, ...], with_vans: Path, tmp_path: Path
):
    scenario = read_scenario(with_vans, "ego", 720.0)
    template = build_template(scenario, layout)
    world = template.world(jnp.asarray(values, jnp.float32), jnp.asarray(1), jnp.asarray(300.0, jnp.float32))
    classes = dict(zip(template.class_names, world.classes, strict=True))
    expected = {vtype: layout.values_of(vtype, values[1:]) for vtype in layout.vtypes}
    assert set(expected) <= set(classes)
    for vtype, attributes in expected.items():
        np.testing.assert_allclose(classes[vtype].car_following.time_gap_s, attributes["tau"], rtol=1e-6)
        np.testing.assert_allclose(classes[vtype].lane_change.cooperative, attributes["lcCooperative"], rtol=1e-6)
    out = tmp_path / "out"
    out.mkdir()
    written = write_scenario(scenario, layout, values, 300.0, "ego", out, is_handed_over=True)
    again = read_scenario(written.config, "ego", 720.0)
    rates = {flow.id: flow.rate_vehps for flow in scenario.flows}
    scaled = {flow.id: flow.rate_vehps for flow in again.flows if flow.id in ("f_main_o1", "f_main_e")}
    factor = VALUES[0] / template.base_demand_vehph()[0]
    assert scaled == pytest.approx({name: factor * rates[name] for name in scaled}, rel=1e-6)
    for vtype, attributes in expected.items():
        assert {name: again.values_of(vtype)[name] for name in attributes} == pytest.approx(attributes, rel=1e-6)


def test_the_scenario_as_it_is_has_each_group_s_own_values(with_vans: Path):
    demand = with_vans.parent / "demand.rou.xml"
    text = demand.read_text()
    van = text[text.index('<vType id="van"') :]
    van = van[: van.index("/>")]
    demand.write_text(text.replace(van, re.sub('tau="[^"]*"', 'tau="1.9"', van)))
    scenario = read_scenario(with_vans, "ego", 720.0)
    values = dict(zip(APART.names, build_template(scenario, APART).base_values(), strict=True))
    assert values["tau[van]"] == 1.9
    assert values["tau[car]"] == scenario.values_of("car")["tau"] != 1.9


def test_one_group_s_values_move_no_other_s_vehicles(with_vans: Path, tmp_path: Path):
    """To the bit, in both simulators."""
    scenario = read_scenario(with_vans, "ego", 720.0)
    template = build_template(scenario, APART)
    moved = (*VALUES_APART[:3], 1.1 * VALUES_APART[3], VALUES_APART[4])
    cars, vans, in_files = [], [], []
    for number, values in enumerate((VALUES_APART, moved)):
        world = template.world(jnp.asarray(values, jnp.float32), jnp.asarray(1), jnp.asarray(300.0, jnp.float32))
        classes = dict(zip(template.class_names, world.classes, strict=True))
        cars.append(classes["car"])
        vans.append(classes["van"])
        out = tmp_path / f"out{number}"
        out.mkdir()
        written = write_scenario(scenario, APART, values, 300.0, "ego", out, is_handed_over=True)
        in_files.append(read_scenario(written.config, "ego", 720.0).demand.vtypes)
    jax.tree.map(np.testing.assert_array_equal, *cars)
    assert in_files[0]["car"] == in_files[1]["car"]
    np.testing.assert_allclose([van.car_following.time_gap_s for van in vans], [2.3, 2.53], rtol=1e-6)
    assert [float(vtypes["van"]["tau"]) for vtypes in in_files] == pytest.approx([2.3, 2.53])
    assert {name for name in in_files[0]["van"] if in_files[0]["van"][name] != in_files[1]["van"][name]} == {"tau"}


def test_distant_vehicles_of_a_group_follow_as_they_are_told_and_change_lane_as_it_does(with_vans: Path):
    demand = with_vans.parent / "demand.rou.xml"
    text = demand.read_text()
    van = text[text.index('<vType id="van"') :]
    van = van[: van.index("/>") + 2]
    far = re.sub('tau="[^"]*"', 'tau="3.3"', van.replace('id="van"', 'id="far"'))
    demand.write_text(text.replace(van, van + far))
    template = build_template(read_scenario(with_vans, "ego", 720.0), APART, distant_vtypes={"van": "far"})
    world = template.world(jnp.asarray(VALUES_APART, jnp.float32), jnp.asarray(1), jnp.asarray(300.0, jnp.float32))
    classes = dict(zip(template.class_names, world.classes, strict=True))
    np.testing.assert_allclose(classes["far"].car_following.time_gap_s, 3.3, rtol=1e-6)
    np.testing.assert_allclose(classes["far"].lane_change.cooperative, 0.4, rtol=1e-6)
    np.testing.assert_allclose(classes["van"].car_following.time_gap_s, 2.3, rtol=1e-6)
