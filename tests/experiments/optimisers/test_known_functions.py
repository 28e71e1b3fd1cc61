"""The functions: their optimum, their slopes, their noise and their failures."""

import numpy as np
import pytest

from experiments.optimisers.known_functions import FUNCTIONS, FunctionProblem


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_optimum_is_where_the_seed_says(name: str):
    problem = FunctionProblem(name, "exact", 4, 11)
    points = np.vstack([problem.optimum, np.random.default_rng(0).random((50, 4))])
    error = problem.measure(points)["error"]
    assert error[0] < 1e-12
    assert (error[1:] > 1e-3).all()
    assert problem.evaluate(points, 0).accuracy[0] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_slopes_are_those_of_the_sum_of_squares(name: str):
    problem = FunctionProblem(name, "exact", 4, 2)
    point = np.asarray([0.31, 0.83, 0.12, 0.57])
    step = 1e-6
    points = np.vstack([point, point + step * np.eye(4), point - step * np.eye(4)])
    told = problem.evaluate(points, 0)
    misfit = np.sum(told.residuals**2, axis=1)
    assert told.slopes is not None
    np.testing.assert_allclose(told.slopes[0], (misfit[1:5] - misfit[5:]) / (2 * step), rtol=1e-5)


def test_rastrigin_and_rosenbrock_are_the_usual_ones():
    z = np.asarray([[0.4, -1.3, 0.7]])
    usual = np.sum(z**2 - 10.0 * np.cos(2.0 * np.pi * z) + 10.0)
    assert np.sum(FUNCTIONS["rastrigin"][0](z)[0] ** 2) == pytest.approx(usual, rel=1e-12)
    x = z[0] + 1.0
    usual = np.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2)
    assert np.sum(FUNCTIONS["rosenbrock"][0](z)[0] ** 2) == pytest.approx(usual, rel=1e-12)


def test_noise_has_the_size_that_residuals_are_in_and_differs_by_evaluation():
    problem = FunctionProblem("sphere", "noisy", 3, 4)
    told = problem.evaluate(np.tile(problem.optimum, (400, 1)), 0)
    assert np.std(told.residuals) == pytest.approx(1.0, rel=0.1)
    again = problem.evaluate(problem.optimum[None], 7)
    np.testing.assert_array_equal(again.residuals[0], told.residuals[7])


def test_failing_candidates_lie_beyond_a_plane_and_here_and_there():
    problem = FunctionProblem("ackley", "failing", 3, 4)
    points = np.random.default_rng(1).random((500, 3))
    failed = ~problem.evaluate(points, 0).is_ok
    beyond = points[:, 0] > problem.optimum[0] + 0.15
    assert failed[beyond].all()
    assert 0.01 < failed[~beyond].mean() < 0.1
