"""Steps towards runs that agree, on made-up features of which the answer is known."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.inference.descent import FIRST_LONGEST, Descent, Target, descend, linear_step
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRuns

SIZE = 12
SLOPES = 3.0 * np.random.default_rng(0).standard_normal((SIZE, 3))
FREE = np.full(3, np.inf)
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"speed_mps_{place}", "following") for place in range(SIZE))
RUNS = ExplainedRuns(DriveTallies(CELLS, np.ones((4, SIZE)), np.ones((4, SIZE)), np.zeros(4)))
Features = Callable[[np.ndarray], np.ndarray | None]


def target(drives: np.ndarray, low=-FREE, high=FREE, center=(0.0, 0.0, 0.0)) -> Target:
    return Target(drives, lambda runs, error: np.eye(SIZE) + np.diag(error**2), low, high, np.asarray(center))


def reach(features: Features, goal: Target, slopes: np.ndarray, most: int = 8, start=(0.0, 0.0, 0.0)) -> Descent | None:
    def run(at: np.ndarray) -> tuple[ExplainedRuns, np.ndarray, np.ndarray] | None:
        there = features(at)
        return None if there is None else (RUNS, there, np.full(SIZE, 0.01))

    def measure(at: np.ndarray, known: np.ndarray) -> np.ndarray:
        sides = []
        for step in 1e-4 * np.eye(3):
            up, down = features(at + step), features(at - step)
            assert up is not None
            assert down is not None
            sides.append((up - down) / 2e-4)
        return np.stack(sides, axis=1)

    return descend(goal, np.asarray(start), slopes, run, measure, most)


NUMBERS = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3)


@given(NUMBERS, NUMBERS)
def test_a_linear_problem_ends_at_the_ridge_solution_around_the_prior(where: list[float], center: list[float]):
    drives = SLOPES @ np.asarray(where)
    found = reach(lambda at: SLOPES @ at, target(drives, center=center), SLOPES)
    ridge = np.linalg.solve(SLOPES.T @ SLOPES / 1.0001 + np.eye(3), SLOPES.T @ drives / 1.0001 + np.asarray(center))
    assert found is not None
    np.testing.assert_allclose(found.nearest.at + found.step, ridge, atol=1e-6)


def test_a_curved_problem_is_met_from_slopes_that_mislead():
    def curved(at: np.ndarray) -> np.ndarray:
        return SLOPES @ at + 0.8 * (SLOPES[:, ::-1] @ at**2)

    goal = np.asarray([1.4, 0.9, 1.1])
    found = reach(curved, target(curved(goal)), -0.3 * SLOPES, most=20)
    assert found is not None
    np.testing.assert_allclose(found.nearest.at, goal, atol=0.2)  # the prior pulls, 1 in 20 of the drives' weight
    assert found.nearest.loss == pytest.approx(found.nearest.square + np.linalg.slogdet(found.nearest.noise)[1])
    assert found.num_runs % 4 == 0


def test_a_step_is_no_longer_than_trusted_and_stays_inside_bounds():
    low, high = np.asarray([-np.inf, -0.5, -np.inf]), np.asarray([np.inf, np.inf, 0.2])
    drives = SLOPES @ np.asarray([9.0, -9.0, 9.0])
    first = linear_step(np.eye(SIZE), SLOPES, drives, low, high)
    assert np.linalg.norm(first) <= FIRST_LONGEST + 1e-9
    found = reach(lambda at: SLOPES @ at, target(drives, low, high), SLOPES, start=first)
    assert found is not None
    for at in (first, found.nearest.at, found.nearest.at + found.step):
        assert np.all(at >= low - 1e-9)
        assert np.all(at <= high + 1e-9)


def test_points_whose_runs_fail_are_stepped_back_from():
    def cliff(at: np.ndarray) -> np.ndarray | None:
        return SLOPES @ at if at[0] < 1.0 else None

    found = reach(cliff, target(SLOPES @ np.asarray([3.0, 0.0, 0.0])), SLOPES)
    assert found is not None
    assert 0.3 < found.nearest.at[0] < 1.0
    assert reach(cliff, target(np.zeros(SIZE)), SLOPES, start=(2.0, 0.0, 0.0)) is None


def test_runs_that_already_agree_are_asked_no_more():
    found = reach(lambda at: SLOPES @ at + 0.1, target(np.zeros(SIZE)), SLOPES)
    assert found is not None
    assert found.num_runs == len(RUNS.with_effect)
