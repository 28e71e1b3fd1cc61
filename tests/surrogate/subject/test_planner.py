"""The planner's closed forms and laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.subject import rollout
from surrogate.subject.planner import ACCELERATIONS_MPS2, FORBIDDEN, MANOEUVRES
from surrogate.subject.registry import SubjectModel
from surrogate.vehicle.lane_change_model import LEFT, RIGHT, STAY
from tests.surrogate.subject.straight_road import (
    LENGTH_M,
    LIMIT_MPS,
    STEP_S,
    TRACED,
    classes_of,
    followed,
    merged,
    planned,
)

PLANNER = SubjectModel("planner")


def steady(speed_mps: float, seconds: float) -> np.ndarray:
    return np.full(round(seconds / STEP_S), speed_mps, np.float32)


@pytest.mark.parametrize(("acceleration", "speed", "top"), [(1.3, 7.0, 12.5), (-2.1, 7.0, 12.5), (0.0, 9.5, 12.5)])
def test_the_own_path_is_that_of_a_fine_integration(acceleration: float, speed: float, top: float) -> None:
    times = np.arange(1, 15, dtype=np.float32) * 0.4
    found_m, found_mps = rollout.with_constant_acceleration(
        jnp.asarray(speed), jnp.asarray(acceleration), jnp.asarray(top), jnp.asarray(times)
    )
    fine = 1e-4
    speeds = np.clip(speed + acceleration * fine * np.arange(round(times[-1] / fine) + 1), 0.0, top)
    way = np.concatenate([[0.0], np.cumsum(0.5 * fine * (speeds[1:] + speeds[:-1]))])
    places = np.rint(times / fine).astype(int)
    np.testing.assert_allclose(found_mps, speeds[places], atol=1e-3)
    np.testing.assert_allclose(found_m, way[places], atol=5e-3)


def test_a_braking_leader_is_expected_to_lose_what_a_second_of_it_takes() -> None:
    times = jnp.asarray([0.5, 1.0, 4.0])
    _, speed = rollout.of_leader(jnp.asarray(14.0), jnp.asarray(-3.0), times)
    np.testing.assert_allclose(speed, 14.0 - 3.0 * (1.0 - np.exp(-np.asarray(times))), rtol=1e-5)
    way, speed = rollout.of_leader(jnp.asarray(1.2), jnp.asarray(-6.0), times)
    assert float(speed[-1]) == 0.0
    assert float(way[-1]) == pytest.approx(float(way[-2]), abs=1e-6)


def test_the_desired_gap_is_the_idm_s() -> None:
    # 2.2 + 14 * 1.1 + 14 * 3 / (2 sqrt(1.4 * 2.5)) = 2.2 + 15.4 + 11.2250
    found = rollout.desired_gap_m(14.0, 11.0, 2.2, 1.1, np.sqrt(1.4 * 2.5))
    assert float(found) == pytest.approx(28.8250, abs=1e-3)
    assert float(rollout.risk(jnp.asarray(57.65), found)) == pytest.approx(0.25, rel=1e-3)


@pytest.mark.parametrize("speed", [0.0, 6.0, 20.9, 24.0])
def test_it_returns_to_the_desired_speed_and_stays_there(speed: float) -> None:
    told = followed(PLANNER, np.inf, speed, steady(10.0, 60.0))
    assert told["speed_mps"][-200:] == pytest.approx(LIMIT_MPS, abs=0.02)
    assert np.abs(told["acceleration_mps2"][-200:]).max() < 0.1


@pytest.mark.parametrize("deceleration", [1.5, 4.0, 8.0])
@pytest.mark.parametrize(("gap", "speed"), [(11.0, 17.0), (24.0, 20.0), (60.0, 21.0)])
def test_it_does_not_hit_a_leader_who_brakes_to_a_standstill(gap: float, speed: float, deceleration: float) -> None:
    before = steady(17.0, 8.0)
    braking = np.maximum(17.0 - deceleration * STEP_S * np.arange(1, 250), 0.0)
    told = followed(PLANNER, gap, speed, np.concatenate([before, braking]).astype(np.float32))
    assert told["gap_m"].min() > 0.3
    assert told["speed_mps"][-1] < 0.2
    assert told["gap_m"][-1] < 8.0  # and does not stay far behind either


def test_it_follows_a_slower_leader_smoothly() -> None:
    told = followed(PLANNER, 90.0, 21.0, steady(15.0, 90.0))
    assert told["speed_mps"][-300:] == pytest.approx(15.0, abs=0.25)
    assert 10.0 < told["gap_m"][-300:].mean() < 30.0
    assert told["acceleration_mps2"].min() > -2.0


def followed_gap_m(**weights: float) -> float:
    return float(followed(SubjectModel("planner", weights), 40.0, 15.0, steady(15.0, 90.0))["gap_m"][-300:].mean())


def test_weights_mean_what_they_say() -> None:
    usual = followed_gap_m()
    assert followed_gap_m(safety_weight=3.0) > usual + 2.0
    assert followed_gap_m(efficiency_weight=3.0) < usual - 1.0
    calm, hasty = (
        followed(SubjectModel("planner", {"comfort_weight": weight}), np.inf, 5.0, steady(12.0, 90.0))
        for weight in (3.0, 0.1)
    )
    assert calm["acceleration_mps2"].max() < hasty["acceleration_mps2"].max() - 0.5
    assert calm["speed_mps"][-1] == pytest.approx(LIMIT_MPS, abs=0.1)


def test_only_the_ratios_of_the_weights_count() -> None:
    names = ("safety_weight", "efficiency_weight", "comfort_weight")
    traffic = [(0, 540.0, 15.0), (1, 470.0, 19.0), (1, 580.0, 18.5)]
    one = planned((0, 500.0, 19.0, -0.2), traffic, **dict(zip(names, (1.3, 0.7, 0.4), strict=True)))
    twice = planned((0, 500.0, 19.0, -0.2), traffic, **dict(zip(names, (2.6, 1.4, 0.8), strict=True)))
    assert int(one.direction) == int(twice.direction)
    assert float(one.acceleration_mps2) == float(twice.acceleration_mps2)


BEHIND_SLOW = [(0, 526.0, 12.0), (1, 482.0, 17.5), (1, 560.0, 18.0)]
SUBJECT = (0, 500.0, 17.0, 0.0)


def test_it_claims_a_gap_for_which_idm_drivers_wait() -> None:
    chosen = planned(SUBJECT, BEHIND_SLOW)
    assert int(chosen.direction) == LEFT
    assert int(chosen.target_row) == 1
    car, _ = classes_of(PLANNER)
    speeds = [jnp.asarray(v) for v in (17.5, 17.0)]
    secure_m = float(car.car_following.secure_gap_m(*speeds, car.car_following.max_deceleration_mps2, STEP_S))
    gap_m = 500.0 - LENGTH_M - 482.0
    assert gap_m - 2.2 < secure_m  # LC2013's gap acceptance, which takes the jam gap off
    # and not where the follower would have to brake harder than may be asked of him
    fast = [BEHIND_SLOW[0], (1, 482.0, 23.0), BEHIND_SLOW[2]]
    assert int(planned(SUBJECT, fast).direction) == STAY
    assert int(planned(SUBJECT, BEHIND_SLOW, yield_deceleration_mps2=0.1, claim_time_gap_s=0.9).direction) == STAY


def test_it_stays_where_nobody_holds_it_up_and_where_there_is_no_lane() -> None:
    assert int(planned((0, 500.0, LIMIT_MPS, 0.0), []).direction) == STAY
    alone = planned(SUBJECT, BEHIND_SLOW[:1], num_rows=1)
    assert int(alone.direction) == STAY
    assert float(alone.acceleration_mps2) < 0.0
    side = np.asarray([lane != 1 for lane, _ in MANOEUVRES])
    assert np.all(np.asarray(alone.cost)[side] >= FORBIDDEN)


def test_left_and_right_are_alike() -> None:
    mirrored = [(1 - row, position, speed) for row, position, speed in BEHIND_SLOW]
    left, right = planned(SUBJECT, BEHIND_SLOW), planned((1, *SUBJECT[1:]), mirrored)
    assert (int(left.direction), int(right.direction)) == (LEFT, RIGHT)
    assert float(left.acceleration_mps2) == float(right.acceleration_mps2)


def test_it_makes_the_gap_that_it_needs_before_its_lane_ends() -> None:
    """Somebody drives beside it, another close behind him: it has to fall back or go ahead first."""
    beside = [(1, 497.0, 15.0), (1, 481.0, 15.0), (1, 512.0, 15.0)]
    assert int(planned((0, 495.0, 15.0, 0.0), beside, end_of_row_0_m=800.0).direction) == STAY
    rows = merged((0, 495.0, 15.0, 0.0), beside, 800.0, 25)
    assert rows[0] == 0
    assert rows[-1] == 1


def test_it_stands_before_the_end_of_its_lane_if_nobody_lets_it_in() -> None:
    wall = [(1, float(place), 8.0) for place in np.arange(200.0, 900.0, 7.6)]
    rows = merged((0, 590.0, 8.0, 0.0), wall, 700.0, 20)
    assert set(rows) == {0}


def test_all_values_share_one_trace() -> None:
    before = len(TRACED)
    planned(SUBJECT, BEHIND_SLOW, safety_weight=1.7)
    known = len(TRACED)
    planned(SUBJECT, BEHIND_SLOW[::-1], comfort_weight=0.3, reaction_s=0.4)
    assert len(TRACED) == known <= before + 1


def test_accelerations_end_at_what_the_vehicle_may_do() -> None:
    chosen = planned((0, 500.0, 0.0, 0.0), [], max_acceleration_mps2=0.8)
    assert float(chosen.acceleration_mps2) == pytest.approx(0.8)
    assert max(ACCELERATIONS_MPS2) > 0.8
    assert jax.tree.all(jax.tree.map(lambda leaf: bool(jnp.isfinite(leaf).all()), chosen.cost))
