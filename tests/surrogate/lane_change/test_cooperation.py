"""What a driver who must change lane asks of the follower there, with numbers worked out by hand."""

import jax.numpy as jnp
import pytest

from surrogate.car_following.idm import Idm
from surrogate.lane_change.cooperation import requests
from surrogate.lane_change.gap_acceptance import Blocked
from surrogate.lane_change.keep_clear import keep_clear_mps2
from surrogate.lane_change.registry import lane_change_model
from surrogate.lane_change.surroundings import following_of
from surrogate.road.neighbours import Neighbour
from surrogate.vehicle.vehicle_class import VehicleClass
from tests.surrogate.lane_change.lane_scene import lane_scene

LENGTH, JAM_GAP, TIME_GAP, ACCELERATION, DECELERATION, DESIRED, STEP_S = 4.8, 1.6, 1.1, 1.7, 3.1, 21.0, 0.1


def asked_mps2(speed_mps: float, follower_mps: float, gap_m: float, interval_s: float = STEP_S) -> float:
    """Return the acceleration asked of a follower in the way, who is `gap_m` behind with his jam gap kept."""
    return min(asked_and_clear_mps2(speed_mps, follower_mps, gap_m, interval_s))


def asked_and_clear_mps2(
    speed_mps: float, follower_mps: float, gap_m: float, interval_s: float = STEP_S
) -> tuple[float, float]:
    """Return what such a follower is asked for, and the acceleration that keeps him clear if he creeps."""
    values = (JAM_GAP, TIME_GAP, ACCELERATION, DECELERATION, 9.0, 4.0)
    following = Idm(*(jnp.asarray(value) for value in values))
    model = lane_change_model("lc2013").build({})
    driver = VehicleClass(following, model, *(jnp.asarray(value) for value in (LENGTH, 50.0, 1.0, 0.1)))
    ego, side, _ = lane_scene(
        speed_mps, LENGTH, JAM_GAP, DESIRED, None, None, (gap_m + JAM_GAP, follower_mps), None, 260.0
    )
    yes, no = jnp.asarray([True]), jnp.asarray([False])
    everybody = following_of(jnp.zeros(1, jnp.int32), (driver,))
    found = requests(ego, side, Blocked(no, yes), everybody, jnp.asarray([9.0]), no, interval_s, STEP_S)
    behind = Neighbour(side.follower_entry, yes, -side.follower_gap_m, side.follower_speed_mps, jnp.zeros(1), no * 0)
    clear = keep_clear_mps2(ego, behind, side.follower_gap_m, side.follower_max_speed_mps, everybody, STEP_S)
    return float(found.follower_advice_mps2[0]), float(clear[0])


def idm_mps2(speed_mps: float, leader_mps: float, gap_m: float) -> float:
    """Return the acceleration behind a gap without the jam gap."""
    braking = 2.0 * (ACCELERATION * DECELERATION) ** 0.5
    wanted_m = JAM_GAP + max(0.0, speed_mps * TIME_GAP + speed_mps * (speed_mps - leader_mps) / braking)
    return ACCELERATION * (1.0 - (speed_mps / DESIRED) ** 4 - (wanted_m / (gap_m + JAM_GAP)) ** 2)


@pytest.mark.parametrize(("speed_mps", "follower_mps", "gap_m"), [(2.2, 2.1, 2.3), (0.9, 1.2, 1.1), (2.9, 3.0, 3.2)])
def test_a_follower_who_could_stand_within_a_second_keeps_a_little_more_than_the_gap(
    speed_mps: float, follower_mps: float, gap_m: float
) -> None:
    expected = idm_mps2(follower_mps, speed_mps, gap_m - 0.1)
    assert asked_mps2(speed_mps, follower_mps, gap_m) == pytest.approx(expected, abs=2e-4)


def test_if_the_gap_shrinks_faster_than_that_in_one_step_he_keeps_what_will_be_left() -> None:
    speed_mps, follower_mps, gap_m = 0.4, 2.9, 3.4
    asked = asked_mps2(speed_mps, follower_mps, gap_m)
    assert asked < idm_mps2(follower_mps, speed_mps, gap_m - 0.1) - 0.05
    assert asked == pytest.approx(idm_mps2(follower_mps, speed_mps, gap_m - 0.25), abs=0.06)


def test_a_faster_follower_is_asked_for_the_speed_behind_the_gap_after_the_step() -> None:
    speed_mps, follower_mps, gap_m = 14.3, 13.4, 14.4
    first = follower_mps + STEP_S * idm_mps2(follower_mps, speed_mps, gap_m + STEP_S * speed_mps)
    expected = idm_mps2(follower_mps, speed_mps, gap_m + STEP_S * (speed_mps - first))
    assert asked_mps2(speed_mps, follower_mps, gap_m) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("follower_mps", "interval_s", "expected"), [
    (12.0, STEP_S, -DECELERATION), (12.0, 1.0, -DECELERATION), (7.0, STEP_S, -DECELERATION),
    (7.0, 1.0, 3.0 + 10.0 / 3.6 - 7.0), (7.0, 0.5, (3.0 + 10.0 / 3.6 - 7.0) / 0.5),
])  # fmt: skip
def test_who_passes_a_waiting_merger_brakes_until_he_is_slow_enough_whatever_the_interval(
    follower_mps: float, interval_s: float, expected: float
) -> None:
    """SUMO asks at each step for a step of braking, down to 10 km/h more than the merger drives."""
    assert asked_mps2(3.0, follower_mps, 1.0, interval_s) == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize(("follower_mps", "gap_m"), [(DECELERATION, 4.0), (9.0, 4.0), (1.0, 0.1), (1.0, -3.0)])
def test_only_those_who_creep_behind_keep_clear(follower_mps: float, gap_m: float) -> None:
    """Source: `slowDownForBlocked`: slower than a second of braking, and more than 0.1 m behind."""
    assert asked_and_clear_mps2(0.5, follower_mps, gap_m)[1] == float("inf")
    assert asked_and_clear_mps2(0.5, 0.9 * DECELERATION, 0.2)[1] < 0.0
