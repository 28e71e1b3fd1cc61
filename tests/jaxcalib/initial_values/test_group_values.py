"""What one fit of all vehicles says of each group: made-up estimates of three groups on the corridor's flows."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.driver_values import DriverEstimate
from jaxcalib.initial_values.group_values import OTHER_GROUP_ERROR, drivers_of_all_groups
from jaxcalib.problem.parameter_space import ParameterSpace, parameter_space
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario

LAYOUT = ParameterLayout(
    ("main",), (("f",),), ("car", "van", "truck"), ("tau", "speedFactor", "sigma", "lcSpeedGain"),
    groups=(("car",), ("van",), ("truck",)),
)  # fmt: skip
SCENARIO = np.asarray([1.2, 1.0, 0.4, 1.0, 1.5, 0.8, 0.0, 2.0, 2.6, 0.9, 0.3, 3.0])  # by group; vans do not dawdle
FIRST = DriverEstimate(
    np.asarray([1.5, 0.9, 0.5, 1.0]),
    np.asarray([0.03, 0.05, 0.04, np.inf]),
    ("pairs", "speeds", "pairs", "scenario"),
    None,
    700,
    ("tau", "sigma"),
    lambda theta: jnp.sum(theta),
)


@pytest.fixture
def scenario(corridor: Scenario) -> Scenario:
    """The corridor with a van to four other vehicles."""
    first, *others = corridor.flows
    alike = [dataclasses.replace(flow, rate_vehps=0.0) for flow in others[1:]]
    car = dataclasses.replace(first, vtype="car", rate_vehps=0.4, begin_s=10.0, end_s=50.0)
    van = dataclasses.replace(others[0], vtype="van", rate_vehps=0.2, begin_s=30.0, end_s=50.0)
    return dataclasses.replace(corridor, flows=(car, van, *alike))


@pytest.fixture
def space() -> ParameterSpace:
    return parameter_space(LAYOUT, "Krauss", np.asarray([1800.0]), 0.2, {}, behaviour=SCENARIO.tolist())


@pytest.fixture
def found(scenario: Scenario, space: ParameterSpace) -> DriverEstimate:
    return drivers_of_all_groups(FIRST, scenario, space, SCENARIO)


def test_other_groups_leave_the_scenario_by_the_first_s_factors(found: DriverEstimate, space: ParameterSpace):
    of_car, of_van, of_truck = np.reshape(found.values, (3, 4))
    np.testing.assert_array_equal(of_car, FIRST.values)
    np.testing.assert_allclose(of_van, [1.5 * 1.25, 0.8 * 0.9, 0.0, 2.0])  # no factor says anything of 0
    np.testing.assert_allclose(of_truck, [space.upper[space.index("tau[truck]")], 0.81, 0.375, 3.0])
    assert of_truck[0] < 2.6 * 1.25


def test_what_is_said_of_other_groups_is_less_certain(found: DriverEstimate, space: ParameterSpace):
    of_car, of_van, of_truck = np.reshape(found.unit_error, (3, 4))
    np.testing.assert_allclose(of_car[:3], np.hypot([0.03, 0.05, 0.04], 0.2 * OTHER_GROUP_ERROR))
    assert np.isinf([of_car[3], of_van[2], of_van[3], of_truck[3]]).all()
    # factors are as certain wherever they are applied on a logarithmic scale, and shrink with the value on an even one
    np.testing.assert_allclose(of_van[0], np.hypot(0.03, OTHER_GROUP_ERROR))
    np.testing.assert_allclose(of_van[1], np.hypot(0.8 * 0.05, OTHER_GROUP_ERROR))
    np.testing.assert_allclose(of_truck[1], np.hypot(0.9 * 0.05, OTHER_GROUP_ERROR))
    assert not space.ranges[space.index("speedFactor[van]")].is_logarithmic


def test_sources_say_whose_factor_it_is(found: DriverEstimate):
    assert found.source[4:8] == ("pairs, by the factor of car", "speeds, by the factor of car", "scenario", "scenario")
    assert found.fitted == ("tau[car]", "sigma[car]")
    assert found.replay_loss is None


def test_one_group_is_what_was_found_of_it(scenario: Scenario, space: ParameterSpace):
    assert drivers_of_all_groups(FIRST, scenario, space.of_first_group(), SCENARIO[:4]) is FIRST
