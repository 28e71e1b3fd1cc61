"""The IDM against the formulas of Treiber, Hennecke & Helbing (2000), written out in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.idm import Idm
from surrogate.vehicle.car_following_model import FollowingSituation

S0, T, A, B, DELTA = 2.2, 1.35, 1.4, 2.1, 3.7


def idm() -> Idm:
    return Idm(*(jnp.asarray(value) for value in (S0, T, A, B, 8.5, DELTA)))


def situation(
    speed: np.ndarray, gap: np.ndarray | float, leader_speed: np.ndarray, desired: np.ndarray | float
) -> FollowingSituation:
    values = np.broadcast_arrays(speed, gap, leader_speed, 0.7, -0.4, desired, 0.6)
    return FollowingSituation(*(jnp.asarray(value) for value in values))


def treiber(speed: np.ndarray, gap: np.ndarray, leader_speed: np.ndarray, desired: np.ndarray) -> np.ndarray:
    wanted_gap = S0 + np.maximum(0.0, speed * T + speed * (speed - leader_speed) / (2.0 * np.sqrt(A * B)))
    return A * (1.0 - (speed / desired) ** DELTA - (wanted_gap / gap) ** 2)


def random_situations() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(8)
    number = 3000
    gap = np.where(rng.random(number) < 0.1, np.inf, 0.3 + rng.gamma(1.2, 30.0, number))
    return rng.uniform(0.0, 36.0, number), gap, rng.uniform(0.0, 36.0, number), rng.uniform(6.0, 40.0, number)


def test_the_acceleration_is_treiber_s_with_the_dynamic_gap_floored_at_zero() -> None:
    speed, gap, leader_speed, desired = random_situations()
    floored = speed * T + speed * (speed - leader_speed) / (2.0 * np.sqrt(A * B)) < 0.0
    assert 0.05 < floored.mean() < 0.9  # both branches occur
    with jax.enable_x64():
        found = np.asarray(idm().acceleration(situation(speed, gap, leader_speed, desired), 0.1))
    np.testing.assert_allclose(found, treiber(speed, gap, leader_speed, desired), rtol=1e-11, atol=1e-11)


def test_single_precision_is_right_to_a_millionth_of_its_terms() -> None:
    speed, gap, leader_speed, desired = random_situations()
    found = np.asarray(idm().acceleration(situation(speed, gap, leader_speed, desired), 0.1))
    assert found.dtype == np.float32
    free, whole = A * (speed / desired) ** DELTA, treiber(speed, gap, leader_speed, desired)
    assert (np.abs(found - whole) <= 4e-6 * (A + free + np.abs(A - free - whole))).all()


@pytest.mark.parametrize("speed", [0.0, 3.1, 11.7, 24.3])
def test_at_the_equilibrium_gap_behind_an_equally_fast_leader_the_speed_is_kept(speed: float) -> None:
    desired = 27.0
    gap = (S0 + speed * T) / np.sqrt(1.0 - (speed / desired) ** DELTA)
    with jax.enable_x64():
        found = idm().acceleration(situation(np.asarray(speed), gap, np.asarray(speed), desired), 0.1)
        closer = idm().acceleration(situation(np.asarray(speed), 0.97 * gap, np.asarray(speed), desired), 0.1)
    assert abs(float(found)) < 1e-12
    assert float(closer) < -0.01


def test_a_leader_closer_than_a_millimetre_leaves_the_acceleration_finite() -> None:
    gap = np.asarray([1e-3, 1e-5, 0.0, -2.4])
    with jax.enable_x64():
        found = np.asarray(idm().acceleration(situation(np.full(4, 9.0), gap, np.full(4, 7.5), 25.0), 0.1))
    assert (found == found[0]).all()
    assert np.isfinite(found).all()
    assert found[0] < -1e6


def test_before_a_place_to_stand_no_jam_gap_is_kept() -> None:
    speed, distance = np.asarray([4.2, 13.0]), np.asarray([17.0, 61.0])
    with jax.enable_x64():
        here = situation(speed, np.asarray([5.0, np.inf]), np.asarray([3.0, 3.0]), 22.0)
        found = np.asarray(idm().stop_acceleration(here, jnp.asarray(distance), 0.1))
        no_place = np.asarray(idm().stop_acceleration(here, jnp.full(2, jnp.inf), 0.1))
        at_it = np.asarray(idm().stop_acceleration(here, jnp.full(2, 0.005), 0.1))
    free = A * (1.0 - (speed / 22.0) ** DELTA)
    wanted_gap = speed * T + speed**2 / (2.0 * np.sqrt(A * B))
    np.testing.assert_allclose(found, free - A * (wanted_gap / distance) ** 2, rtol=1e-12)
    np.testing.assert_allclose(no_place, free, rtol=1e-12)
    np.testing.assert_allclose(at_it, -speed / 0.1, rtol=1e-12)
