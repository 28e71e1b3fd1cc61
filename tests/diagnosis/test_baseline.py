"""Baselines are made again until no feature would move a parameter far; the simulators are made up."""

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.diagnosis.atlas import parameter_steps
from jaxcalib.diagnosis.baseline import LONGEST_STEPS, MOST_ROUNDS, Baseline, BaselineMaker
from jaxcalib.diagnosis.investigation import NotTestableError
from jaxcalib.diagnosis.trials import TrialRunner
from jaxcalib.problem import CalibrationProblem
from sim_adapters.interface import ParameterLayout

LAYOUT = ParameterLayout(("main",), (("f",),), ("car",), ("tau", "accel"))
PROBLEM = cast(CalibrationProblem, SimpleNamespace(layout=LAYOUT))
BEGIN = np.asarray([3000.0, 1.1, 1.4])
SIZES = parameter_steps(LAYOUT, BEGIN)
BOUNDS = np.asarray([0.0, 0.4, 0.3]), np.asarray([np.inf, 3.0, 5.0])


@dataclass(frozen=True)
class Made(BaselineMaker):
    """Makes baselines of which only shift and misfit are known; keeps the values that were asked for."""

    tell: Callable[[np.ndarray], tuple[np.ndarray, float]] = lambda values: (np.zeros(3), 0.0)
    asked: list[np.ndarray] = field(default_factory=list)
    completed: list[np.ndarray] = field(default_factory=list)

    def at(self, values: np.ndarray, runner: TrialRunner | None) -> Baseline:
        """Return what is told of some values."""
        assert (runner is None) == (not self.asked)
        self.asked.append(values)
        shift, misfit = self.tell(values)
        return cast(Baseline, SimpleNamespace(values=values, shift=shift, misfit=misfit, runner="program"))

    def whole(self, first: Baseline) -> Baseline:
        """Keep which one is made in full."""
        self.completed.append(first.values)
        return first


def made(tell: Callable[[np.ndarray], tuple[np.ndarray, float]]) -> Made:
    nothing: Any = None
    return Made(PROBLEM, nothing, nothing, 0, 0, (), nothing, BOUNDS, tell)


def towards(goal: np.ndarray, share: float = 1.0) -> Callable[[np.ndarray], tuple[np.ndarray, float]]:
    """Return what tells a share of the way to a goal, and how far it is."""

    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        way = (goal - values) / SIZES
        return share * way, float(way @ way)

    return tell


def test_what_has_converged_is_made_once():
    maker = made(towards(BEGIN + SIZES * [2.9, -1.0, 0.5]))
    baseline, number = maker.converged(BEGIN)
    assert number == len(maker.asked) == 1
    np.testing.assert_array_equal(baseline.values, BEGIN)
    np.testing.assert_array_equal(maker.completed, [BEGIN])


def test_only_the_baseline_that_is_kept_is_made_in_full():
    maker = made(towards(BEGIN + SIZES * [40.0, 0.0, 0.0]))
    baseline, _ = maker.converged(BEGIN)
    np.testing.assert_array_equal(maker.completed, [baseline.values])


def test_a_parameter_that_all_features_would_move_far_is_moved():
    goal = BEGIN + SIZES * [-4.0, 1.0, 0.0]
    maker = made(towards(goal))
    baseline, number = maker.converged(BEGIN)
    assert number == len(maker.asked) == 2
    np.testing.assert_allclose(baseline.values, goal)


def test_steps_are_bounded_and_so_is_their_number():
    maker = made(towards(BEGIN + SIZES * [40.0, 0.0, 0.0]))
    baseline, number = maker.converged(BEGIN)
    assert number == len(maker.asked) == MOST_ROUNDS
    first = maker.asked[1]
    np.testing.assert_allclose(first, BEGIN + SIZES * [LONGEST_STEPS, 0.0, 0.0])
    np.testing.assert_array_equal(baseline.values, maker.asked[-1])


def test_nothing_is_moved_beyond_its_range():
    maker = made(towards(BEGIN + SIZES * [-4.0, 60.0, -50.0]))
    baseline, _ = maker.converged(np.asarray([3000.0, 2.9, 0.35]))
    assert maker.asked[1][0] < 3000.0
    np.testing.assert_allclose(maker.asked[1][1:], [3.0, 0.3])
    np.testing.assert_array_equal(baseline.values[1:], [3.0, 0.3])


def test_a_move_that_agrees_worse_is_taken_back():
    maker = made(towards(BEGIN + SIZES * [4.0, 0.0, 0.0], share=-1.0))
    baseline, number = maker.converged(BEGIN)
    assert number == 2
    np.testing.assert_array_equal(baseline.values, BEGIN)


def test_a_move_to_where_nothing_is_seen_is_taken_back():
    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        if not np.array_equal(values, BEGIN):
            raise NotTestableError("3 features")
        return np.asarray([4.0, 0.0, 0.0]), 9.0

    baseline, number = made(tell).converged(BEGIN)
    assert number == 2
    np.testing.assert_array_equal(baseline.values, BEGIN)


def test_drives_that_show_too_little_are_told_at_once():
    def tell(values: np.ndarray) -> tuple[np.ndarray, float]:
        raise NotTestableError("3 features")

    with pytest.raises(NotTestableError):
        made(tell).converged(BEGIN)
