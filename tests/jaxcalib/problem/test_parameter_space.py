"""Bounds of what is searched."""

import numpy as np

from jaxcalib.problem.parameter_space import parameter_space
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
