"""The closed forms against vehicles that are moved step by step: first the speed changes, then the place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.safe_speed import (
    SMALLEST_DISTANCE_M,
    brake_gap_m,
    emergency_follow_speed_mps,
    krauss_secure_gap_m,
    late_braking_speed_mps,
    safe_follow_speed_mps,
    safe_stop_speed_mps,
)

STEPS_S = [0.1, 0.25, 1.0]
RNG = np.random.default_rng(11)


def braking_path(speed: float, deceleration: float, reaction: float, step_s: float) -> float:
    """Return the distance until standstill: `reaction` seconds at `speed`, then braking step by step."""
    distance = speed * reaction
    while speed > 0.0:
        speed = max(0.0, speed - deceleration * step_s)
        distance += speed * step_s
    return distance


def highest_stop_speed(gap: float, deceleration: float, reaction: float, step_s: float) -> float:
    """Return by bisection the highest speed whose path until standstill fits in the gap."""
    low, high = 0.0, 200.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        if braking_path(middle, deceleration, reaction, step_s) <= gap:
            low = middle
        else:
            high = middle
    return low


@pytest.mark.parametrize("step_s", STEPS_S)
def test_the_brake_gap_is_the_path_of_a_vehicle_braked_step_by_step(step_s: float) -> None:
    speed, deceleration = RNG.uniform(0.0, 45.0, 60), RNG.uniform(0.7, 9.3, 60)
    reaction = RNG.uniform(0.0, 2.3, 60)
    path = [braking_path(*case, step_s) for case in zip(speed, deceleration, reaction, strict=True)]
    with jax.enable_x64():
        gap = np.asarray(brake_gap_m(jnp.asarray(speed), jnp.asarray(deceleration), jnp.asarray(reaction), step_s))
    np.testing.assert_allclose(gap, path, rtol=1e-10, atol=1e-10)


def test_a_single_precision_brake_gap_is_right_to_a_millimetre() -> None:
    speed, deceleration = RNG.uniform(0.0, 35.0, 60), RNG.uniform(0.7, 9.3, 60)
    path = [braking_path(v, b, 1.1, 0.1) for v, b in zip(speed, deceleration, strict=True)]
    gap = brake_gap_m(jnp.asarray(speed, jnp.float32), jnp.asarray(deceleration, jnp.float32), 1.1, 0.1)
    np.testing.assert_allclose(np.asarray(gap), path, rtol=2e-6, atol=1e-3)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_the_safe_stop_speed_is_the_highest_that_stands_in_time(step_s: float) -> None:
    gap, deceleration = RNG.uniform(0.05, 300.0, 40), RNG.uniform(0.7, 9.3, 40)
    reaction = RNG.uniform(step_s, 2.5, 40)
    room = np.maximum(gap - SMALLEST_DISTANCE_M, 0.0)
    highest = [highest_stop_speed(*case, step_s) for case in zip(room, deceleration, reaction, strict=True)]
    with jax.enable_x64():
        speed = safe_stop_speed_mps(jnp.asarray(gap), jnp.asarray(deceleration), jnp.asarray(reaction), step_s)
        speed = np.asarray(speed)
    np.testing.assert_allclose(speed, highest, rtol=1e-9)


def test_a_single_precision_stop_speed_neither_overruns_nor_wastes_a_centimetre() -> None:
    gap, deceleration = RNG.uniform(0.5, 250.0, 60), RNG.uniform(0.7, 9.3, 60)
    speed = safe_stop_speed_mps(
        jnp.asarray(gap, jnp.float32), jnp.asarray(deceleration, jnp.float32), jnp.asarray(0.9), 0.1
    )
    for v, b, room in zip(np.asarray(speed, np.float64), deceleration, gap, strict=True):
        assert abs(braking_path(v, b, 0.9, 0.1) - room) < 0.01


@pytest.mark.parametrize("gap", [0.0, -0.3, -40.0])
def test_without_room_the_stop_speed_is_zero(gap: float) -> None:
    assert float(safe_stop_speed_mps(jnp.asarray(gap), jnp.asarray(4.5), jnp.asarray(1.3), 0.1)) == 0.0


def test_without_an_obstacle_any_speed_stands_in_time() -> None:
    assert float(safe_stop_speed_mps(jnp.asarray(jnp.inf), jnp.asarray(4.5), jnp.asarray(1.3), 0.1)) == np.inf


@pytest.mark.parametrize("step_s", STEPS_S)
def test_the_safe_follow_speed_never_hits_a_leader_who_brakes_to_a_standstill(step_s: float) -> None:
    gap, leader_speed = RNG.uniform(0.2, 90.0, 60), RNG.uniform(0.0, 33.0, 60)
    own, leaders = RNG.uniform(1.0, 7.0, 60), RNG.uniform(1.0, 7.0, 60)
    reaction_steps = RNG.integers(1, 4, 60)
    with jax.enable_x64():
        speeds = safe_follow_speed_mps(
            *(jnp.asarray(x) for x in (gap, leader_speed, own, leaders, reaction_steps * step_s)), step_s
        )
        speeds = np.asarray(speeds)
    for i, speed in enumerate(speeds):
        v, leader_v, left, hardest = speed, leader_speed[i], gap[i], max(own[i], leaders[i])
        for step in range(2000):
            if step >= reaction_steps[i]:
                v = max(0.0, v - own[i] * step_s)
            leader_v = max(0.0, leader_v - hardest * step_s)
            left += step_s * (leader_v - v)
            assert left > -1e-9
            if v == 0.0 and leader_v == 0.0:
                break
        assert left < SMALLEST_DISTANCE_M + 1e-6  # no slower than it has to be


def test_behind_the_secure_gap_both_can_brake_to_a_standstill() -> None:
    speed, leader_speed = RNG.uniform(2.0, 35.0, 60), RNG.uniform(0.0, 35.0, 60)
    own, leaders = RNG.uniform(1.0, 7.0, 60), RNG.uniform(1.0, 7.0, 60)
    with jax.enable_x64():
        gap = np.asarray(
            krauss_secure_gap_m(*(jnp.asarray(x) for x in (speed, leader_speed, own, leaders)), jnp.asarray(1.2), 0.1)
        )
    cases = zip(speed, leader_speed, own, leaders, strict=True)
    needed = [braking_path(v, b, 1.2, 0.1) - braking_path(vl, max(b, bl), 0.0, 0.1) for v, vl, b, bl in cases]
    np.testing.assert_allclose(gap, np.maximum(needed, 0.0), rtol=1e-9, atol=1e-9)
    assert (gap == 0.0).any()
    assert (gap > 50.0).any()


@pytest.mark.parametrize("step_s", [0.1, 0.5])
def test_from_the_late_braking_speed_a_lower_limit_is_met_in_time_and_no_two_steps_too_early(step_s: float) -> None:
    distance, target, deceleration = RNG.uniform(1.0, 200.0, 60), RNG.uniform(3.0, 20.0, 60), RNG.uniform(0.7, 6.0, 60)
    with jax.enable_x64():
        bounds = np.asarray(late_braking_speed_mps(*(jnp.asarray(x) for x in (distance, target, deceleration)), step_s))
    for room, lowest, b, bound in zip(distance, target, deceleration, bounds, strict=True):
        assert bound >= lowest
        v, covered = bound, 0.0
        while v > lowest + 1e-9:
            covered += v * step_s
            v = max(lowest, v - b * step_s)
        assert covered <= room
        if bound > lowest:
            assert covered > room - 2.0 * bound * step_s


def test_in_an_emergency_a_driver_brakes_as_the_distance_demands_and_a_fifth_more() -> None:
    """At 20 m/s, 35 m before a standing vehicle: 20^2 / 70 = 5.71 m/s^2 would just do, the usual 3 would not."""
    speed, gap, usual = jnp.asarray(20.0), jnp.asarray(35.0), jnp.asarray(3.0)
    standing, hardest = jnp.asarray(0.0), jnp.asarray(9.0)
    safe = safe_follow_speed_mps(gap, standing, usual, usual, jnp.asarray(1.2), 0.1)
    found = emergency_follow_speed_mps(safe, speed, gap, standing, usual, usual, hardest, 0.1)
    # as the leader is thought to brake with 3 m/s^2 as well, what counts is the difference in squares over the gap
    assert float(found) == pytest.approx(20.0 - 0.1 * 1.2 * 20.0**2 / 70.0, abs=1e-4)
    assert float(safe) < float(found)
    # no emergency: the safe speed stays
    far = jnp.asarray(120.0)
    calm = safe_follow_speed_mps(far, standing, usual, usual, jnp.asarray(1.2), 0.1)
    assert float(emergency_follow_speed_mps(calm, speed, far, standing, usual, usual, hardest, 0.1)) == float(calm)
    # nor is there one for who can brake no harder than usual
    assert float(emergency_follow_speed_mps(safe, speed, gap, standing, usual, usual, usual, 0.1)) == float(safe)
