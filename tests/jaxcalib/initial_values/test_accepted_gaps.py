"""Edges of accepted gaps, planted and found; assertiveness from gaps that a known rule accepted."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.acceptance_edge import acceptance_edge
from jaxcalib.initial_values.accepted_gaps import LEAST_LOGARITHMIC_ERROR, AcceptedGaps, assertiveness
from surrogate.car_following.idm import Idm

STEP_S = 0.1
ASSERTIVE = 1.35
MODEL = Idm(*(jnp.asarray(value) for value in (2.1, 1.3, 1.2, 1.9, 9.0, 4.0)))


def shares(num: int, edge: float, strays: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return shares from an edge on, a fifth of them close to it, a part anywhere, and their errors."""
    rng = np.random.default_rng(seed)
    error = rng.uniform(0.01, 0.08, num)
    beyond = np.where(rng.random(num) < 0.2, 0.02, 0.7) * rng.exponential(size=num)
    share = edge * (1.0 + beyond) + error * rng.standard_normal(num)
    is_stray = rng.random(num) < strays
    return np.where(is_stray, rng.uniform(-1.0, 3.0, num), share), error


@pytest.mark.parametrize("strays", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("edge", [0.55, 0.85])
def test_a_planted_edge_is_found_however_many_shares_are_strays(edge: float, strays: float) -> None:
    found = [acceptance_edge(*shares(60, edge, strays, seed)) for seed in range(12)]
    off = np.asarray([np.log(one.share / edge) for one in found])
    error = np.asarray([one.logarithmic_error for one in found])
    assert abs(np.median(off)) < LEAST_LOGARITHMIC_ERROR
    assert np.sqrt(np.mean((off / error) ** 2)) < 1.7
    assert error.max() < 0.25


def test_fewer_shares_say_less() -> None:
    def error_of(num: int) -> float:
        return float(np.mean([acceptance_edge(*shares(num, 0.8, 0.1, seed)).logarithmic_error for seed in range(6)]))

    assert error_of(300) < 0.5 * error_of(20)


def accepted(num: int, cut_tracks: int) -> AcceptedGaps:
    """Return changes made as soon as both gaps reach the secure gap over ASSERTIVE; some tracks are cut."""
    rng = np.random.default_rng(3)
    speed, leader, follower = rng.uniform(12.0, 22.0, (3, num))

    def needed(rear: np.ndarray, front: np.ndarray) -> np.ndarray:
        secure = MODEL.secure_gap_m(jnp.asarray(rear), jnp.asarray(front), MODEL.max_deceleration_mps2, STEP_S)
        return float(MODEL.jam_gap_m) + np.asarray(secure, float) / ASSERTIVE

    ahead = needed(speed, leader) * (1.0 + rng.exponential(0.5, num)) + 0.1
    behind = needed(follower, speed) * (1.0 + rng.exponential(0.5, num)) + 0.1
    ahead[:cut_tracks] = rng.uniform(-5.0, 0.0, cut_tracks)
    behind[num // 2 :] = np.inf
    return AcceptedGaps(speed, ahead, leader, behind, follower)


@pytest.mark.parametrize("cut_tracks", [0, 12])
def test_assertiveness_is_read_from_gaps(cut_tracks: int) -> None:
    gaps = accepted(90, cut_tracks)
    found = assertiveness(gaps, MODEL, STEP_S)
    assert np.log(found.value / ASSERTIVE) == pytest.approx(0.0, abs=2.5 * found.logarithmic_error)
    assert 0.05 <= found.logarithmic_error < 0.15


def test_too_few_gaps_say_nothing() -> None:
    found = assertiveness(accepted(15, 0), MODEL, STEP_S)
    assert np.isnan(found.value)
    assert np.isinf(found.logarithmic_error)
