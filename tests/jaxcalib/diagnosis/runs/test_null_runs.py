"""SUMO's null runs: how often drives are looked at."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.diagnosis.runs.explained_runs import LARGEST_FALL, least_values
from jaxcalib.diagnosis.runs.null_runs import fine_interval_s
from jaxcalib.problem.problem import frame_interval_s


@pytest.mark.parametrize(
    ("step_s", "sampled_s", "expected_s"),
    [
        (0.1, 0.1, 0.1),
        (0.1, 0.3, 0.5),  # no whole part of half a second
        (0.2, 0.2, 0.2),
        (0.2, 1.0, 0.4),  # two steps are nearest to half a second
        (0.4, 0.4, 0.4),
        (0.5, 0.1, 0.5),
        (1.0, 0.2, 1.0),
    ],
)
def test_drives_are_looked_at_every_few_whole_steps(step_s: float, sampled_s: float, expected_s: float):
    time_s = np.arange(0.0, 20.0, sampled_s)
    problem = SimpleNamespace(
        parts=SimpleNamespace(scenario=SimpleNamespace(step_s=step_s)),
        drives=[SimpleNamespace(subject=SimpleNamespace(time_s=time_s))],
        frame_interval_s=frame_interval_s(step_s),
    )
    found_s = fine_interval_s(cast(Any, problem))
    assert found_s == pytest.approx(expected_s)
    assert found_s / step_s == pytest.approx(round(found_s / step_s))
    assert problem.frame_interval_s / found_s == pytest.approx(round(problem.frame_interval_s / found_s))


def test_negative_values_may_fall_as_far_as_positive_ones():
    values = np.asarray([2.0, -1.0, 0.0])
    assert least_values(values) == pytest.approx([2.0 * (1.0 - LARGEST_FALL), -1.0 - LARGEST_FALL, 0.0])
    assert np.all(least_values(values) <= values)
