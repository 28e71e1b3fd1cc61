"""The stretched road of the scaling benchmark: sorted, full, as long as it must be."""

from itertools import pairwise

import numpy as np
import pytest

from experiments.benchmarks.full_road import SPACING_M, end_m, filled, stretched, through_rows
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import read_scenario
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.loop.run_state import RunPlan
from surrogate.loop.world import Clock
from tests.places import CORRIDOR


@pytest.fixture(scope="module")
def template() -> WorldTemplate:
    scenario = read_scenario(CORRIDOR / "scenario/scenario.sumocfg", "ego", 720.0)
    return build_template(scenario, ParameterLayout(("main",), (("f_main_o1", "f_main_e"),), ("car",), ("tau",)))


@pytest.mark.parametrize("num_vehicles", [70, 1001])
def test_a_full_road_holds_all_vehicles_in_order(template: WorldTemplate, num_vehicles: int) -> None:
    road = stretched(template, num_vehicles)
    rows = through_rows(template)
    assert rows.tolist() == [0, 1, 2]  # the ramps' row does not go all the way
    assert float(end_m(road)) * len(rows) == pytest.approx(num_vehicles * SPACING_M, rel=1e-5)
    state = filled(road, num_vehicles, RunPlan(Clock(0.1, 10), num_vehicles + 50, 5))
    vehicle_class, row = np.asarray(state.vehicles.vehicle_class), np.asarray(state.vehicles.row)
    position = np.asarray(state.vehicles.position_m)
    assert (vehicle_class >= 0).sum() == num_vehicles
    head = np.asarray(state.head)
    assert (vehicle_class[head[:-1]] == -1).all()
    assert np.isinf(position[head[:-1]]).all()
    assert head[-1] == num_vehicles + road.road.num_rows
    assert (vehicle_class[head[-1] :] == -2).all()
    for number, (first, end) in enumerate(pairwise(head)):
        assert (row[first:end] == number).all()
        inside = position[first + 1 : end]
        assert (np.diff(inside) < 0.0).all()
        assert ((inside > -SPACING_M) & (inside < float(end_m(road)))).all()
    assert len(set(np.asarray(state.vehicles.identity)[vehicle_class >= 0])) == num_vehicles
