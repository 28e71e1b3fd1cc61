"""Fundamental diagrams of a validation: a point for each level of service that a side shows."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.measures.fundamental_diagram import LEVELS
from jaxcalib.validation.diagrams import diagrams_figure, diagrams_of


def validation(shown: dict[tuple[int, str], tuple[float, float]], num_sections: int = 2) -> Any:
    """Return a result whose field shows volumes and speeds at some (section, level), the simulation twice both."""
    measures: dict[str, dict[str, float | None]] = {}
    for section in range(num_sections):
        for level in LEVELS:
            values = shown.get((section, level), (None, None))
            for what, value in zip(("volume_vehph", "speed_mps"), values, strict=True):
                twice = None if value is None else 2.0 * value
                measures[f"section_{section}_level_{level}_{what}"] = {"field": value, "simulated": twice}
    return SimpleNamespace(measures=measures)


def test_a_point_is_density_and_volume():
    """1440 veh/h at 20 m/s, 72 km/h, are 20 vehicles per km; twice both are as many at twice the volume."""
    found = diagrams_of(validation({(1, "cd"): (1440.0, 20.0), (1, "f"): (1080.0, 5.0)}))
    assert found[0] == {"field": [], "simulated": []}
    assert np.asarray(found[1]["field"]) == pytest.approx(np.asarray([(20.0, 1440.0), (60.0, 1080.0)]))
    assert np.asarray(found[1]["simulated"]) == pytest.approx(np.asarray([(20.0, 2880.0), (60.0, 2160.0)]))


def test_one_point_is_no_diagram():
    assert diagrams_figure(validation({(0, "cd"): (1440.0, 20.0)})) == ""
    figure = diagrams_figure(validation({(1, "cd"): (1440.0, 20.0), (1, "f"): (1080.0, 5.0)}))
    assert figure.startswith("<svg")
    assert "section 1" in figure
    assert "section 0" not in figure
