"""What a parameter vector means for several vTypes: common factors, with a bound where values are shares."""

import dataclasses
import math
from pathlib import Path

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


@pytest.mark.parametrize(
    ("layout", "of_van"),
    [(LAYOUT, {"tau": 1.6, "lcCooperative": 0.7}), (SCALED, {"tau": 2.0, "lcCooperative": 1.0})],
)
def test_vtypes_share_values_or_factors(layout: ParameterLayout, of_van: dict[str, float]):
    assert layout.values_of("car", VALUES[1:]) == {"tau": 1.6, "lcCooperative": 0.7}
    assert layout.values_of("van", VALUES[1:]) == pytest.approx(of_van)


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


@pytest.mark.parametrize("values", [VALUES, tuple(np.asarray(VALUES))], ids=["float", "numpy"])
def test_both_simulators_get_the_same(values: tuple[float, ...], with_vans: Path, tmp_path: Path):
    scenario = read_scenario(with_vans, "ego", 720.0)
    template = build_template(scenario, SCALED)
    world = template.world(jnp.asarray(values, jnp.float32), jnp.asarray(1), jnp.asarray(300.0, jnp.float32))
    classes = dict(zip(template.class_names, world.classes, strict=True))
    expected = {vtype: SCALED.values_of(vtype, VALUES[1:]) for vtype in SCALED.vtypes}
    assert set(expected) <= set(classes)
    for vtype, attributes in expected.items():
        np.testing.assert_allclose(classes[vtype].car_following.time_gap_s, attributes["tau"], rtol=1e-6)
        np.testing.assert_allclose(classes[vtype].lane_change.cooperative, attributes["lcCooperative"], rtol=1e-6)
    out = tmp_path / "out"
    out.mkdir()
    written = write_scenario(scenario, SCALED, values, 300.0, "ego", out, is_handed_over=True)
    again = read_scenario(written.config, "ego", 720.0)
    rates = {flow.id: flow.rate_vehps for flow in scenario.flows}
    scaled = {flow.id: flow.rate_vehps for flow in again.flows if flow.id in ("f_main_o1", "f_main_e")}
    factor = VALUES[0] / template.base_demand_vehph()[0]
    assert scaled == pytest.approx({name: factor * rates[name] for name in scaled}, rel=1e-6)
    for vtype, attributes in expected.items():
        assert {name: again.values_of(vtype)[name] for name in attributes} == pytest.approx(attributes, rel=1e-6)
