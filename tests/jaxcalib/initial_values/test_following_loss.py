"""The loss of leader-follower pairs: closed forms, and what counts how much."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.following_loss import (
    CHANGE_BORDERS_MPS2,
    FollowingData,
    following_data,
    forgiving,
    mean_loss,
    residual,
)
from tests.jaxcalib.initial_values.followers import FACTORS, LIMIT_MPS, STEP_S, TRUTH, idm, samples

MODEL = idm(jnp.asarray(TRUTH, jnp.float32))


@pytest.fixture(scope="module")
def data() -> FollowingData:
    given = samples()
    return following_data(given, np.full(len(given), LIMIT_MPS))


def test_the_loss_of_an_error_is_welsch_s() -> None:
    errors = jnp.asarray([0.0, 0.07, -0.07, 0.14, 9.0])
    expected = [0.0, 1.0 - np.exp(-0.5), 1.0 - np.exp(-0.5), 1.0 - np.exp(-2.0), 1.0]
    np.testing.assert_allclose(forgiving(errors, 0.07), expected, rtol=1e-6)


def test_the_drivers_themselves_leave_no_residual(data: FollowingData) -> None:
    # speeds of up to 25 m/s in single precision are right to 2e-6 m/s, over a tenth of a second
    error = residual(MODEL, jnp.asarray(FACTORS, jnp.float32)[data.vehicle], data)
    assert float(jnp.abs(error).max()) < 1e-4


def test_a_residual_is_an_acceleration() -> None:
    given = samples()
    slower = dataclasses.replace(given, later_speed_mps=given.later_speed_mps - 0.03)
    data = following_data(slower, np.full(len(given), LIMIT_MPS))
    error = residual(MODEL, jnp.asarray(FACTORS, jnp.float32)[data.vehicle], data)
    np.testing.assert_allclose(error, 0.03 / STEP_S, atol=1e-4)


def test_vehicles_are_numbered_in_order_and_sums_are_theirs(data: FollowingData) -> None:
    assert data.num_vehicles == len(FACTORS)
    count = data.per_vehicle(jnp.ones_like(data.limit_mps))
    np.testing.assert_array_equal(count, len(data.limit_mps) / len(FACTORS))
    np.testing.assert_allclose(data.per_vehicle(data.weight).sum(), data.weight.sum(), rtol=1e-5)


def test_steady_and_changing_moments_count_alike(data: FollowingData) -> None:
    """Kinds with a hundredth of all moments and more have the same weight together; all weigh 1 on average."""
    weight = np.asarray(data.weight)
    assert weight.mean() == pytest.approx(1.0, rel=1e-5)
    given = samples()
    kind = np.digitize(np.abs(given.later_speed_mps - given.speed_mps) / STEP_S, CHANGE_BORDERS_MPS2)
    count = np.bincount(kind, minlength=len(CHANGE_BORDERS_MPS2) + 1)
    together = np.bincount(kind, weight)[count > len(kind) / 100]
    assert len(together) >= 4
    np.testing.assert_allclose(together, together[0], rtol=1e-4)


def test_few_are_evenly_chosen(data: FollowingData) -> None:
    few = data.thin(220, 6)
    assert set(np.asarray(few.vehicle)) == set(range(0, len(FACTORS), 2))
    assert 220 <= len(few.limit_mps) < 440
    assert few.leader_speed_mps.shape == (1, len(few.limit_mps))
    assert set(np.asarray(data.thin(10**6, data.num_vehicles).weight)) == set(np.asarray(data.weight))


def test_the_mean_loss_is_that_of_the_weighted_samples(data: FollowingData) -> None:
    other = idm(jnp.asarray(TRUTH * [1.0, 1.15, 1.0, 1.0, 1.0], jnp.float32))
    factor = jnp.asarray(FACTORS, jnp.float32)
    error = np.asarray(residual(other, factor[data.vehicle], data), float)
    weight = np.asarray(data.weight, float)
    expected = np.sum(weight * (1.0 - np.exp(-0.5 * (error / 0.06) ** 2))) / weight.sum()
    assert float(mean_loss(other, factor, data, data.weight, 0.06)) == pytest.approx(expected, rel=1e-4)
    assert float(mean_loss(MODEL, factor, data, data.weight, 0.06)) < 1e-5 < expected
