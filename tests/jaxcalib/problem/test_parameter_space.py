"""Bounds of what is searched."""

import dataclasses

import numpy as np
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.problem.parameter_space import ParameterSpace, parameter_space
from sim_adapters.interface import ParameterLayout


def test_bounds_hold_the_scenario_s_own_drivers() -> None:
    """Scenarios have values that traffic has not: -1 for nobody who makes room, 50 for the most eager."""
    layout = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "lcCooperative", "lcStrategic"))
    plain, holding = (
        parameter_space(layout, "IDM", np.asarray([1800.0]), 0.2, {}, behaviour=own)
        for own in (None, (1.4, -1.0, 50.0))
    )
    assert (holding.lower[2], holding.upper[3]) == (-1.0, 50.0)
    np.testing.assert_array_equal(holding.lower[[0, 1, 3]], plain.lower[[0, 1, 3]])
    np.testing.assert_array_equal(holding.upper[[0, 1, 2]], plain.upper[[0, 1, 2]])
    scenario = np.asarray([1800.0, 1.4, -1.0, 50.0])
    np.testing.assert_allclose(holding.values_of(holding.unit_of(scenario)[None])[0], scenario)
    chosen = parameter_space(
        layout, "IDM", np.asarray([1800.0]), 0.2, {"lcStrategic": (0.5, 20.0)}, behaviour=(1.4, -1.0, 50.0)
    )
    assert chosen.upper[3] == 20.0  # what the user says counts


APART = ParameterLayout(
    ("main",), (("f",),), ("car", "van", "truck"), ("tau", "lcCooperative"), groups=(("car", "van"), ("truck",))
)


def space_apart(**bounds: tuple[float, float]) -> ParameterSpace:
    named = {name.replace("_of_", "[") + "]" * ("_of_" in name): one for name, one in bounds.items()}
    return parameter_space(APART, "IDM", np.asarray([1800.0]), 0.2, named, behaviour=(1.4, 0.5, 7.5, -0.2))


def test_each_group_has_bounds_of_its_own_that_hold_its_own_drivers() -> None:
    space = space_apart()
    assert space.names == ("main", "tau[car]", "lcCooperative[car]", "tau[truck]", "lcCooperative[truck]")
    assert space.upper[3] == 7.5 > space.upper[1]
    assert space.lower[4] == -0.2 < space.lower[2] == 0.0
    assert [one.unit for one in space.ranges] == ["veh/h", "s", "", "s", ""]
    first = space.of_first_group()
    assert first.names == ("main", "tau", "lcCooperative")
    assert first.ranges == space.ranges[:3]


def test_bounds_of_an_attribute_are_those_of_all_groups_that_have_none_of_their_own() -> None:
    for bounds in ({"tau": (0.7, 1.9), "tau_of_truck": (1.1, 2.9)}, {"tau_of_truck": (1.1, 2.9), "tau": (0.7, 1.9)}):
        space = space_apart(**bounds)
        np.testing.assert_array_equal(space.lower[[1, 3]], [0.7, 1.1])
        np.testing.assert_array_equal(space.upper[[1, 3]], [1.9, 2.9])
    both = space_apart(tau=(0.7, 1.9))
    np.testing.assert_array_equal(both.upper[[1, 3]], [1.9, 1.9])
    np.testing.assert_array_equal(both.upper[[0, 2, 4]], space_apart().upper[[0, 2, 4]])


@pytest.mark.parametrize(
    ("bounds", "says"),
    [
        ({"tau_of_van": (0.7, 1.9)}, "expected one of main, tau\\[car\\]"),
        ({"tau": (0.0, 1.9)}, "bounds.tau: expected a lower bound above 0"),
        ({"tau": (1.9, 0.7)}, "bounds.tau: expected a lower bound below"),
    ],
)
def test_bounds_that_no_group_can_have(bounds: dict[str, tuple[float, float]], says: str) -> None:
    with pytest.raises(CaseError, match=says):
        space_apart(**bounds)


def test_with_one_group_names_are_the_attributes() -> None:
    together = dataclasses.replace(APART, groups=())
    space = parameter_space(together, "IDM", np.asarray([1800.0]), 0.2, {"tau": (0.7, 1.9)})
    assert space.names == ("main", "tau", "lcCooperative")
    assert space.upper[1] == 1.9
    assert space.of_first_group().names == space.names
