"""Dawdling is told from how speeds tremble, whatever else the drivers do and however noisy the logs are."""

import itertools
from typing import cast

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from jaxcalib.initial_values.dawdling import dawdling_mps2, fit_beside_dawdling
from jaxcalib.initial_values.following_fit import FollowingFit
from jaxcalib.initial_values.following_loss import ModelOf, following_data
from jaxcalib.initial_values.following_samples import FollowingSamples
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.replay import LeaderMotion, ReplayState, follow
from tests.jaxcalib.initial_values.followers import FACTORS, LIMIT_MPS, STEP_S, leaders_mps

ACCEL_MPS2 = 2.3
NUM_STEPS = 700


def krauss(imperfection: float, time_gap_s: float = 1.2, accel_mps2: float = ACCEL_MPS2) -> Krauss:
    values = (2.1, time_gap_s, accel_mps2, 3.9, 9.0, imperfection)
    return Krauss(*(jnp.asarray(value, jnp.float32) for value in values))


def dawdlers(sigma: float, noise_mps: float, seed: int) -> FollowingSamples:
    """Followers who dawdle anew in each step behind leaders who stop and go, with noise in their logged speeds."""
    leader, random = leaders_mps(NUM_STEPS + 1), np.random.default_rng(seed)
    model, desired = krauss(sigma), jnp.asarray(FACTORS * LIMIT_MPS, jnp.float32)
    state = ReplayState(jnp.asarray(leader[0]), jnp.zeros(len(FACTORS)), jnp.asarray(6.0 + 1.6 * leader[0]))
    step = eqx.filter_jit(follow)
    speed, gap = [np.asarray(state.speed_mps)], [np.asarray(state.gap_m)]
    for now, later in itertools.pairwise(leader):
        motion = LeaderMotion(jnp.asarray(now), jnp.zeros(len(FACTORS)), jnp.asarray(STEP_S * later))
        uniform = jnp.asarray(random.random(len(FACTORS)), jnp.float32)
        state = step(model, state, motion, desired, uniform, STEP_S)
        speed.append(np.asarray(state.speed_mps))
        gap.append(np.asarray(state.gap_m))
    seen = np.asarray(speed, float) + noise_mps * random.standard_normal(np.shape(speed))
    at, who = (part.ravel() for part in np.mgrid[30:NUM_STEPS, : len(FACTORS)])
    return FollowingSamples(
        vehicle=3 * who + 5, drive=who // 4, row=np.zeros(len(at), int), position_m=np.zeros(len(at)),
        speed_mps=seen[at, who], acceleration_mps2=(seen[at, who] - seen[at - 1, who]) / STEP_S,
        gap_m=np.asarray(gap, float)[at, who], leader_speed_mps=leader[at, who][:, None].astype(float),
        leader_acceleration_mps2=np.zeros(len(at)), later_speed_mps=seen[at + 1, who], step_s=STEP_S,
    )  # fmt: skip


def told(samples: FollowingSamples, model: Krauss) -> float | None:
    return dawdling_mps2(samples, following_data(samples, np.full(len(samples), LIMIT_MPS)), model, FACTORS)


@pytest.mark.parametrize(
    ("sigma", "noise_mps", "tolerance"),
    [(0.15, 0.0, 0.04), (0.4, 0.0, 0.04), (0.8, 0.0, 0.04), (0.4, 0.01, 0.15), (0.8, 0.01, 0.08)],
)
def test_what_dawdling_takes_is_found_under_noise(sigma: float, noise_mps: float, tolerance: float) -> None:
    found = told(dawdlers(sigma, noise_mps, seed=4), krauss(0.0))
    assert found == pytest.approx(sigma * ACCEL_MPS2, rel=tolerance)


def test_the_model_s_other_values_may_be_wrong() -> None:
    found = told(dawdlers(0.45, 0.0, seed=9), krauss(0.0, time_gap_s=1.25, accel_mps2=2.9))
    assert found == pytest.approx(0.45 * ACCEL_MPS2, rel=0.12)


def test_noise_counts_as_no_more_than_dawdling_that_scatters_as_much() -> None:
    found = told(dawdlers(0.0, 0.02, seed=2), krauss(0.0))
    assert found is None or found < 1.01 * np.sqrt(12.0) * 0.02 / STEP_S


def test_moments_that_do_not_follow_each_other_say_nothing() -> None:
    assert told(dawdlers(0.5, 0.0, seed=1).thin(300), krauss(0.0)) is None


NAMES = ("tau", "accel", "sigma", "decel")


def fit_of(names: tuple[str, ...], values: list[float], errors: list[float]) -> FollowingFit:
    """What a fit finds that is tied by sigma; the model it is given is asked for its values there."""
    seen: list[Array] = []

    def fit(model_of, others: list[int]) -> FollowingFit:
        assert [names[index] for index in others] == [name for name in names if name != "sigma"]
        seen.append(model_of(jnp.asarray(values)))
        return FollowingFit(np.asarray(values), np.asarray(errors), np.ones(2), np.ones(2), np.ones(2), 0.9, 0.1)

    values_as_model = cast(ModelOf, lambda theta: theta)
    found = fit_beside_dawdling(fit, values_as_model, names, 0.9, 1.5)
    np.testing.assert_allclose(seen[0], found.values, rtol=1e-6)
    return found


def test_sigma_is_what_accel_leaves_of_the_dawdling() -> None:
    found = fit_of(NAMES, [1.1, 1.8, 4.0], [0.01, 0.09, 0.2])
    np.testing.assert_allclose(found.values, [1.1, 1.8, 0.5, 4.0])
    np.testing.assert_allclose(found.error, [0.01, 0.09, 0.025, 0.2])


def test_sigma_is_no_more_than_everything() -> None:
    assert fit_of(NAMES, [1.1, 0.6, 4.0], [0.0, 0.0, 0.0]).values[2] == 1.0


def test_where_accel_is_given_sigma_is_known() -> None:
    found = fit_of(("sigma", "tau"), [1.2], [0.1])
    np.testing.assert_allclose(found.values, [0.6, 1.2])
    assert found.error[0] == 0.0
