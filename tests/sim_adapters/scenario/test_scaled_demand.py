"""Flows at equal intervals get another phase for each seed; what else they say stays."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from sim_adapters.scenario.demand_elements import NEVER_S, rate_of
from sim_adapters.scenario.scaled_demand import draw_phase

FILE = Path("flows.rou.xml")


def begins_s(attributes: dict[str, str], seeds: range) -> np.ndarray:
    drawn = []
    for seed in seeds:
        flow = ET.Element("flow", {"id": "f", "route": "r", **attributes})
        before = rate_of(FILE, flow, 0.0, NEVER_S)
        draw_phase(FILE, flow, seed)
        after = rate_of(FILE, flow, 0.0, NEVER_S)
        assert (after.vehps, after.is_regular) == (pytest.approx(before.vehps), before.is_regular)
        drawn.append(after.begin_s)
    return np.asarray(drawn)


@pytest.mark.parametrize(
    "attributes",
    [
        {"begin": "7", "end": "900", "vehsPerHour": "400"},
        {"begin": "7", "period": "9"},
        {"begin": "7", "end": "907", "number": "100"},
        {"begin": "7", "period": "9", "number": "40"},
    ],
)
def test_the_first_comes_anywhere_within_one_interval(attributes: dict[str, str]) -> None:
    shift_s = begins_s(attributes, range(300)) - 7.0
    assert (shift_s >= 0.0).all()
    assert (shift_s < 9.0001).all()
    np.testing.assert_allclose(np.quantile(shift_s, [0.25, 0.5, 0.75]), [2.25, 4.5, 6.75], atol=0.9)
    np.testing.assert_array_equal(shift_s[:9], begins_s(attributes, range(9)) - 7.0)


@pytest.mark.parametrize(
    "attributes",
    [
        {"begin": "7", "end": "900", "period": "exp(0.1)"},
        {"begin": "7", "end": "900", "probability": "0.1"},
        {"begin": "7", "end": "900", "vehsPerHour": "0"},
        {"begin": "7", "end": "7.01", "vehsPerHour": "1"},
    ],
)
def test_what_comes_at_random_or_hardly_at_all_stays(attributes: dict[str, str]) -> None:
    assert (begins_s(attributes, range(5)) == 7.0).all()


def test_flows_have_phases_of_their_own() -> None:
    flows = [ET.Element("flow", id=name, begin="0", vehsPerHour="360") for name in ("a", "b")]
    for flow in flows:
        draw_phase(FILE, flow, 3)
    assert flows[0].get("begin") != flows[1].get("begin")
