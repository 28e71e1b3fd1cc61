"""How often the surrogate of a problem decides about lanes."""

from dataclasses import replace

import pytest

from jaxcalib.problem.engines import (
    DECISION_INTERVAL_S,
    FINER_DECISION_INTERVAL_S,
    finer_surrogate_engine,
    surrogate_engine,
)
from jaxcalib.problem.problem import CalibrationProblem
from surrogate.subject.registry import SubjectModel


@pytest.mark.parametrize(
    ("wanted_s", "got_s"), [(1.0, 1.0), (1.2, 1.0), (1.3, 1.5), (0.6, 0.5), (0.5, 0.5), (0.1, 0.1), (0.19, 0.1)]
)
def test_decisions_fall_on_frames_or_frames_on_decisions(
    small_problem: CalibrationProblem, wanted_s: float, got_s: float
) -> None:
    """Frames lie half a second apart, steps a tenth."""
    engine = surrogate_engine(small_problem, decision_interval_s=wanted_s)
    assert engine.decision_interval_s == pytest.approx(got_s)
    assert engine.with_effects().decision_interval_s == engine.decision_interval_s


def test_finer_decisions_are_for_vehicles_that_plan_nothing(small_problem: CalibrationProblem) -> None:
    finer = finer_surrogate_engine(small_problem)
    assert finer is not None
    assert finer.decision_interval_s == FINER_DECISION_INTERVAL_S < DECISION_INTERVAL_S
    template = replace(small_problem.template, subject_model=SubjectModel("planner"))
    assert finer_surrogate_engine(replace(small_problem, template=template)) is None
