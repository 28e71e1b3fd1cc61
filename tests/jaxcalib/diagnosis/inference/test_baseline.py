"""Baselines are made again until no feature would move a parameter far; the simulators are made up."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.inference.baseline import (
    LEAST_OPEN_STEPS,
    LONGEST_STEPS,
    MOST_MOVES,
    MOST_OPEN_STEPS,
    MOST_ROUNDS,
    Baseline,
    BaselineMaker,
)
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.runs.explained_runs import least_values
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.diagnosis.runs.plan import plan_diagnosis
from jaxcalib.diagnosis.runs.trials import TrialRunner
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import ParameterLayout
from tests.jaxcalib.diagnosis.synthetic import one_feature_each

LAYOUT = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "accel"))
PROBLEM = cast(CalibrationProblem, SimpleNamespace(layout=LAYOUT))
BEGIN = np.asarray([3000.0, 1.1, 1.4])
SIZES = parameter_steps(LAYOUT, BEGIN)
NULL = one_feature_each(LAYOUT.names)
ERROR = np.asarray([600.0, 0.001, np.inf])
BOUNDS = np.asarray([0.0, 0.4, 0.3]), np.asarray([np.inf, 3.0, 5.0])


@dataclass(frozen=True)
class Made(BaselineMaker):
    """Makes baselines of which only shift and misfit are known; keeps the values that were asked for."""

    tell: Callable[[np.ndarray], tuple[np.ndarray, float]] = lambda values: (np.zeros(3), 0.0)
    change: Callable[[np.ndarray], np.ndarray | None] = lambda steps: steps
    asked: list[np.ndarray] = field(default_factory=list)
    completed: list[np.ndarray] = field(default_factory=list)

    def at(self, values: np.ndarray, runner: TrialRunner | None) -> Baseline:
        """Return what is told of some values."""
        assert (runner is None) == (not self.asked)
        self.asked.append(values)
        shift, misfit = self.tell(values)
        fitted = SimpleNamespace(difference=shift, null=NULL)
        return cast(
            Baseline,
            SimpleNamespace(
                values=values, shift=shift, misfit=misfit, runner="program", fitted=fitted, difference=shift
            ),
        )

    def _change(self, best: Baseline, values: np.ndarray) -> np.ndarray | None:
        """Return what the surrogate says of a move; each feature is one parameter, in steps."""
        return self.change((values - best.values) / parameter_steps(LAYOUT, best.values))

    def whole(self, first: Baseline) -> Baseline:
        """Keep which one is made in full."""
        self.completed.append(first.values)
        return first


def made(
    tell: Callable[[np.ndarray], tuple[np.ndarray, float]],
    change: Callable[[np.ndarray], np.ndarray | None] = lambda steps: steps,
) -> Made:
    nothing: Any = None
    return Made(
        PROBLEM, plan_diagnosis(1.0), nothing, 0, 0, (), nothing, BEGIN, ERROR, BOUNDS, tell=tell, change=change
    )


def towards(goal: np.ndarray, share: float = 1.0) -> Callable[[np.ndarray], tuple[np.ndarray, float]]:
    """Return what tells a share of the way to a goal, and how far it is."""

    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        way = (goal - values) / SIZES
        return share * way, float(way @ way)

    return tell


def test_what_has_converged_is_made_once():
    maker = made(towards(BEGIN + SIZES * [2.9, -1.0, 0.5]))
    found = maker.converged()
    baseline, number = found.baseline, found.num_baselines
    assert number == len(maker.asked) == 1
    np.testing.assert_array_equal(baseline.values, BEGIN)
    np.testing.assert_array_equal(maker.completed, [BEGIN])


def test_what_drives_show_is_open_by_their_error_and_what_they_do_not_as_far_as_slopes_reach():
    maker = made(towards(BEGIN))
    np.testing.assert_array_equal(SIZES[:1], [150.0])
    shown = maker.prior_steps(BEGIN)
    assert shown[0] == MOST_OPEN_STEPS  # four steps of error
    assert shown[1] == pytest.approx(LEAST_OPEN_STEPS, abs=0.01)
    assert shown[2] == MOST_OPEN_STEPS
    half = replace(maker, error=np.asarray([150.0, 0.001, np.inf]))
    assert half.prior_steps(BEGIN)[0] == pytest.approx(np.hypot(1.0, LEAST_OPEN_STEPS))
    np.testing.assert_array_equal(maker.prior_steps(1.1 * BEGIN), np.full(3, MOST_OPEN_STEPS))


def test_only_the_baseline_that_is_kept_is_made_in_full():
    maker = made(towards(BEGIN + SIZES * [90.0, 0.0, 0.0]))
    baseline = maker.converged().baseline
    np.testing.assert_array_equal(maker.completed, [baseline.values])


def test_a_parameter_that_all_features_would_move_far_is_moved():
    goal = BEGIN + SIZES * [-4.0, 1.0, 0.0]
    maker = made(towards(goal))
    found = maker.converged()
    baseline, number = found.baseline, found.num_baselines
    assert number == len(maker.asked) == 2
    np.testing.assert_allclose(baseline.values, goal, rtol=1e-6)


def test_steps_are_bounded_and_so_is_their_number():
    maker = made(towards(BEGIN + SIZES * [90.0, 0.0, 0.0]))
    found = maker.converged()
    baseline, number = found.baseline, found.num_baselines
    assert number == len(maker.asked) == MOST_ROUNDS
    first = maker.asked[1]
    np.testing.assert_allclose(first, BEGIN + SIZES * [MOST_MOVES * LONGEST_STEPS, 0.0, 0.0], rtol=1e-6)
    np.testing.assert_array_equal(baseline.values, maker.asked[-1])


def test_nothing_is_moved_beyond_its_range():
    maker = made(towards(BEGIN + SIZES * [-4.0, 60.0, -50.0]))
    baseline = replace(maker, begin=np.asarray([3000.0, 2.9, 0.35])).converged().baseline
    assert maker.asked[1][0] < 3000.0
    np.testing.assert_allclose(maker.asked[1][1:], [3.0, 0.3])
    np.testing.assert_array_equal(baseline.values[1:], [3.0, 0.3])


def test_a_move_that_agrees_worse_is_taken_back():
    maker = made(towards(BEGIN + SIZES * [4.0, 0.0, 0.0], share=-1.0))
    found = maker.converged()
    baseline, number = found.baseline, found.num_baselines
    assert number == len(maker.asked) == 2
    np.testing.assert_array_equal(baseline.values, BEGIN)


def test_a_move_to_where_nothing_is_seen_is_taken_back():
    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        if not np.array_equal(values, BEGIN):
            raise NotTestableError("3 features")
        return np.asarray([4.0, 0.0, 0.0]), 9.0

    found = made(tell).converged()
    baseline, number = found.baseline, found.num_baselines
    assert number == 2
    np.testing.assert_array_equal(baseline.values, BEGIN)


def test_drives_that_show_too_little_are_told_at_once():
    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        raise NotTestableError("3 features")

    with pytest.raises(NotTestableError):
        made(tell).converged()


@pytest.mark.parametrize(("sensitivity", "steps"), [(2.0, 5.0), (0.5, 10.0), (0.7, 9.5)])
def test_the_surrogate_says_how_far_to_go(sensitivity: float, steps: float):
    """What a move changes there counts, not what the slopes had promised; within three steps it is near enough."""
    maker = made(towards(BEGIN + SIZES * [8.0, 0.0, 0.0]), change=lambda moved: sensitivity * moved)
    way, num_tried = maker.moved(maker.at(BEGIN, None))
    np.testing.assert_allclose(way[-1], BEGIN + SIZES * [steps, 0.0, 0.0], rtol=1e-6)
    assert num_tried == len(way) == math.ceil(steps / LONGEST_STEPS)


@pytest.mark.parametrize("change", [lambda steps: -steps, lambda steps: None, lambda steps: 3.0 * steps])
def test_a_move_that_comes_no_nearer_in_the_surrogate_is_not_made(change: Callable):
    maker = made(towards(BEGIN + SIZES * [4.0, 0.0, 0.0]), change=change)
    found = maker.converged()
    assert found.num_baselines == len(maker.asked) == 1
    assert found.num_surrogate_runs == 2 * plan_diagnosis(1.0).slope_runs
    np.testing.assert_array_equal(found.baseline.values, BEGIN)


def test_where_the_surrogate_leads_too_far_its_first_step_is_tried():
    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        steps = (values - BEGIN) / SIZES
        if steps[0] > 6.0:
            raise AllRunsFailedError("the calibrated values failed in SUMO", "")
        return np.asarray([0.0 if steps[0] > 1.0 else 12.0, 0.0, 0.0]), 10.0 - steps[0]

    found = (maker := made(tell)).converged()
    np.testing.assert_allclose([(one[0] - BEGIN[0]) / SIZES[0] for one in maker.asked], [0.0, 10.0, 5.0], rtol=1e-6)
    assert found.num_baselines == 3
    np.testing.assert_array_equal(found.baseline.values, maker.asked[-1])


def test_steps_together_leave_a_share_of_a_value():
    maker = made(towards(BEGIN - SIZES * [90.0, 0.0, 0.0]))
    way, _ = maker.moved(maker.at(BEGIN, None))
    assert np.all(way[-1] >= least_values(BEGIN))
