"""Gauss-Newton on pairs: the step is that of all unknowns together, it ends at the truth and stays there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.following_loss import FollowingData, following_data, residual
from jaxcalib.initial_values.following_newton import (
    SPEED_FACTOR_PRIOR,
    NewtonStep,
    anneal,
    best_factors,
    newton_step,
)
from tests.jaxcalib.initial_values.followers import FACTORS, LIMIT_MPS, LOWER, TRUTH, UPPER, idm, samples

NUM = 4  # parameters that the model has
LOW, HIGH = (jnp.asarray(bound[:NUM], jnp.float32) for bound in (LOWER, UPPER))
AWAY = np.asarray([1.06, 0.95, 1.08, 0.93])
SCALE = 0.12


@pytest.fixture(scope="module")
def data() -> FollowingData:
    given = samples(every=5)
    return following_data(given, np.full(len(given), LIMIT_MPS))


@pytest.fixture(scope="module")
def step(data: FollowingData):
    return jax.jit(lambda theta, factor, scale: newton_step(theta, factor, data, LOW, HIGH, scale, idm))


def test_a_step_is_that_of_the_normal_equations_of_all_unknowns(data: FollowingData, step) -> None:
    """Parameters and desired speeds together, solved densely in double precision; but for the small damping."""
    theta, factor = jnp.asarray(TRUTH[:NUM] * AWAY, jnp.float32), jnp.asarray(FACTORS + 0.01, jnp.float32)
    moved: NewtonStep = step(theta, factor, jnp.asarray(SCALE, jnp.float32))

    def error_of(unknown: jax.Array) -> jax.Array:
        return residual(idm(unknown[:NUM]), unknown[NUM:][data.vehicle], data)

    at = jnp.concatenate([theta, factor])
    error, slope = (np.asarray(part, float) for part in (error_of(at), jax.jacfwd(error_of)(at)))
    weight = np.asarray(data.weight, float) * np.exp(-0.5 * (error / SCALE) ** 2)
    prior = np.concatenate([np.zeros(NUM), np.full(len(FACTORS), (SCALE / SPEED_FACTOR_PRIOR[1]) ** 2)])
    information = slope.T @ (weight[:, None] * slope) + np.diag(prior)
    gradient = slope.T @ (weight * error) + prior * (np.asarray(at, float) - SPEED_FACTOR_PRIOR[0])
    change = -np.linalg.solve(information, gradient)
    # the damping of 1e-4 and single precision
    np.testing.assert_allclose(np.asarray(moved.theta - theta), change[:NUM], rtol=0.02, atol=2e-3)
    np.testing.assert_allclose(np.asarray(moved.factor - factor), change[NUM:], rtol=0.02, atol=2e-3)
    np.testing.assert_allclose(moved.factor_information, np.diag(information)[NUM:] / SCALE**2, rtol=1e-3)


def test_steps_end_at_the_truth(step) -> None:
    moved = anneal(step, jnp.asarray(TRUTH[:NUM] * AWAY, jnp.float32), jnp.ones(len(FACTORS)), (0.25, 0.12, 0.06))
    np.testing.assert_allclose(moved.theta, TRUTH[:NUM], rtol=0.01)
    # the prior of 1.00 +- 0.25 draws by a thousandth
    np.testing.assert_allclose(moved.factor, FACTORS, atol=0.01)
    assert float(moved.explained_share) > 0.95  # one step before


def test_steps_stay_within_the_bounds(data: FollowingData) -> None:
    narrow = jnp.asarray(TRUTH[:NUM] * [1.1, 0.5, 0.5, 0.5], jnp.float32)  # the true gap at standstill is not within
    move = jax.jit(lambda theta, factor, scale: newton_step(theta, factor, data, narrow, HIGH, scale, idm))
    moved = anneal(move, narrow * 1.05, jnp.asarray(FACTORS, jnp.float32), (0.25, 0.12))
    assert float(moved.theta[0]) == pytest.approx(float(narrow[0]))


def test_of_a_grid_of_desired_speeds_the_nearest_is_taken(data: FollowingData) -> None:
    factor, loss = jax.jit(lambda theta: best_factors(theta, data, idm))(jnp.asarray(TRUTH[:NUM], jnp.float32))
    np.testing.assert_allclose(factor, FACTORS, atol=0.5 * 0.01 + 1e-3)  # the grid has steps of 0.01
    worse = jax.jit(lambda theta: best_factors(theta, data, idm)[1])(jnp.asarray(TRUTH[:NUM] * AWAY, jnp.float32))
    assert float(loss) < 0.1 * float(worse)
