"""Drivers planted in leader-follower pairs are found, although some moments obey no model."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.following_fit import FollowingFit, fit_following, loss_of_pairs
from jaxcalib.initial_values.following_samples import FollowingSamples
from tests.jaxcalib.initial_values.followers import (
    FACTORS,
    LIMIT_MPS,
    LOWER,
    NAMES,
    STEP_S,
    TRUTH,
    UPPER,
    idm,
    samples,
)  # fmt: skip

DISOBEYING = 0.1  # share of the moments in which the driver brakes for something else
BRAKING_MPS2 = 0.6
NOISE_MPS2 = 0.02

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def given() -> FollowingSamples:
    true = samples()
    random = np.random.default_rng(8)
    disturbed_mps2 = NOISE_MPS2 * random.standard_normal(len(true))
    disturbed_mps2 -= BRAKING_MPS2 * (random.random(len(true)) < DISOBEYING)
    return dataclasses.replace(true, later_speed_mps=true.later_speed_mps + STEP_S * disturbed_mps2)


@pytest.fixture(scope="module")
def fit(given: FollowingSamples) -> FollowingFit:
    start = np.asarray([2.0, 0.9, 2.6, 4.5, 0.6])  # SUMO's defaults, far away
    return fit_following(given, np.full(len(given), LIMIT_MPS), idm, start, LOWER, UPPER, seed=3)


def test_the_parameters_are_found_within_two_per_cent_and_within_their_errors(fit: FollowingFit) -> None:
    np.testing.assert_allclose(fit.values[:4], TRUTH[:4], rtol=0.02)
    # a jackknife over three drives is uncertain itself by a half: four of its errors, and what the scan leaves
    assert (np.abs(fit.values - TRUTH)[:4] < 4.0 * fit.error[:4] + 0.002 * (UPPER - LOWER)[:4]).all()
    assert (fit.error[:4] < 0.05 * TRUTH[:4]).all()


def test_each_driver_s_desired_speed_is_found(fit: FollowingFit) -> None:
    np.testing.assert_allclose(fit.speed_factor, FACTORS, atol=0.015)
    assert (fit.speed_factor_error < 0.05).all()


def test_what_the_pairs_do_not_show_has_no_finite_error(fit: FollowingFit) -> None:
    assert NAMES[-1] == "nothing"
    assert np.isfinite(fit.error[:-1]).all()
    assert np.isinf(fit.error[-1])


def test_moments_that_obey_no_model_are_told_by_the_explained_share(fit: FollowingFit) -> None:
    assert fit.explained_share == pytest.approx(1.0 - DISOBEYING, abs=0.02)


def test_the_loss_of_the_pairs_is_least_at_the_fit(given: FollowingSamples, fit: FollowingFit) -> None:
    loss = loss_of_pairs(given, np.full(len(given), LIMIT_MPS), idm, fit)
    least = float(loss(jnp.asarray(fit.values, jnp.float32)))
    assert least == pytest.approx(fit.loss, abs=1e-3)
    for place in range(4):
        for factor in (0.9, 1.1):
            other = fit.values * np.where(np.arange(len(TRUTH)) == place, factor, 1.0)
            assert float(loss(jnp.asarray(other, jnp.float32))) > least
