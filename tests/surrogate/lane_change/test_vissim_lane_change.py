"""VISSIM's rules of lane changing with numbers worked out by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.idm import Idm
from surrogate.lane_change.free_model import Outlook
from surrogate.lane_change.gap_acceptance import Blocked
from surrogate.lane_change.motives import Wish
from surrogate.lane_change.old_follower import old_follower_of
from surrogate.lane_change.registry import lane_change_model
from surrogate.lane_change.strategy import Strategy
from surrogate.lane_change.surroundings import following_of
from surrogate.lane_change.vissim import Vissim
from surrogate.road.traffic_state import empty_vehicles
from surrogate.vehicle.lane_change_model import Reason
from surrogate.vehicle.vehicle_class import VehicleClass
from tests.surrogate.lane_change.lane_scene import Neighbour, lane_scene

CC0, CC1, LENGTH, DESIRED, SPEED = 1.7, 0.8, 4.6, 30.0, 20.0
NOBODY = None


def vissim(**values: float) -> Vissim:
    model = lane_change_model("vissim").build(values)
    assert isinstance(model, Vissim)
    return model


def driver(model: Vissim) -> VehicleClass:
    following = Idm(*(jnp.asarray(value) for value in (CC0, CC1, 1.4, 2.0, 9.0, 4.0)))
    return VehicleClass(following, model, jnp.asarray(LENGTH), jnp.asarray(50.0), jnp.asarray(1.0), jnp.asarray(0.1))


def in_the_way(
    model: Vissim, leader: Neighbour, follower: Neighbour, remaining_m: float = 900.0, is_necessary: bool = False
) -> tuple[bool, bool]:
    """Return whether the new leader and the new follower are."""
    ego, side, _ = lane_scene(SPEED, LENGTH, CC0, DESIRED, NOBODY, leader, follower, NOBODY, remaining_m)
    following = following_of(jnp.zeros(1, jnp.int32), (driver(model),))
    found = model.blocked(ego, side, following, jnp.asarray([is_necessary]))
    return bool(found.by_leader[0]), bool(found.by_follower[0])


@pytest.mark.parametrize("excess_m", [-0.01, 0.01])
def test_the_reduced_safety_distance_is_demanded_ahead_and_behind(excess_m: float) -> None:
    model = vissim(safety_distance_factor=0.55)
    # who is not closing in demands 0.55 (1.7 + 0.8 v) of the slower one's speed v
    ahead, behind = 0.55 * (1.7 + 0.8 * 20.0) + excess_m, 0.55 * (1.7 + 0.8 * 18.0) + excess_m
    assert in_the_way(model, (ahead, 23.0), NOBODY) == (excess_m < 0, False)
    assert in_the_way(model, NOBODY, (behind, 18.0)) == (False, excess_m < 0)
    assert in_the_way(model, NOBODY, NOBODY) == (False, False)


@pytest.mark.parametrize("excess_m", [-0.01, 0.01])
def test_the_clearance_counts_where_the_safety_distance_is_shorter(excess_m: float) -> None:
    model = vissim(safety_distance_factor=0.1, min_clearance_m=2.4)
    assert in_the_way(model, (2.4 + excess_m, 20.0), (2.4 + excess_m, 20.0)) == (excess_m < 0, excess_m < 0)


@pytest.mark.parametrize(
    ("is_necessary", "remaining_m", "own_mps2", "trailing_mps2"),
    [
        (False, 10.0, 1.1, 0.7),
        (True, 900.0, 1.1, 0.7),  # 4.2 - 900 / 150 is less
        (True, 300.0, 2.2, 1.4),  # 4.2 - 2 and 3.4 - 2
        (True, 0.0, 4.2, 3.4),
    ],
)
def test_accepted_braking_grows_towards_the_last_place_to_change(
    is_necessary: bool, remaining_m: float, own_mps2: float, trailing_mps2: float
) -> None:
    model = vissim(
        max_deceleration_own_mps2=4.2, max_deceleration_trailing_mps2=3.4, accepted_deceleration_own_mps2=1.1,
        accepted_deceleration_trailing_mps2=0.7, deceleration_reduction_distance_m=150.0,
    )  # fmt: skip
    # closing in at 5 m/s from 20 to 15 m/s, and at 6 m/s from 26 to 20 m/s
    ahead = 0.6 * (1.7 + 0.8 * 15.0) + 5.0**2 / (2.0 * own_mps2)
    behind = 0.6 * (1.7 + 0.8 * 20.0) + 6.0**2 / (2.0 * trailing_mps2)
    for excess_m in (-0.02, 0.02):
        found = in_the_way(model, (ahead + excess_m, 15.0), (behind + excess_m, 26.0), remaining_m, is_necessary)
        assert found == (excess_m < 0, excess_m < 0)


def wished(
    model: Vissim, own: Neighbour, right: Neighbour, left: Neighbour, asked: tuple[bool, bool] = (False, False),
    must: tuple[bool, bool] = (False, False), blocked: tuple[bool, bool] = (False, False),
) -> tuple[Wish, Wish]:  # fmt: skip
    """Return the wishes of a driver behind `own` with these leaders on both sides."""
    ego, right_side, _ = lane_scene(SPEED, LENGTH, CC0, DESIRED, own, right, NOBODY)
    _, left_side, _ = lane_scene(SPEED, LENGTH, CC0, DESIRED, own, left, NOBODY)
    no = jnp.zeros(1, bool)
    routes = [
        Strategy(
            must_change=jnp.asarray([one]), must_stay=no, to_best=no, serves_route=no,
            num_lanes_back=jnp.zeros(1, jnp.int32), look_ahead_m=jnp.full(1, 200.0),
        )
        for one in must
    ]  # fmt: skip
    gaps = tuple(Blocked(jnp.asarray([one]), no) for one in blocked)
    following = following_of(jnp.zeros(1, jnp.int32), (driver(model),))
    old_follower = old_follower_of(empty_vehicles(1, 1), following, ego.max_speed_mps)
    outlook = Outlook(
        ego, (right_side, left_side), (routes[0], routes[1]), (gaps[0], gaps[1]), jnp.zeros(1, jnp.int32),
        old_follower, following, 0.1,
    )  # fmt: skip
    return model.wishes(outlook, (gaps[0], gaps[1]), (jnp.asarray([asked[0]]), jnp.asarray([asked[1]])))


def goes(wishes: tuple[Wish, Wish]) -> tuple[Reason | None, Reason | None]:
    right, left = (Reason(int(one.reason[0])) if bool(one.change[0]) else None for one in wishes)
    return right, left


def test_a_driver_overtakes_where_he_can_keep_his_speed_for_three_seconds_longer() -> None:
    model = vissim(collision_time_s=10.0)
    # 40 m behind 22 m/s: (40 - 1.7 - 0.8 * 20) / (30 - 22) = 2.8 s; 5.8 s behind 25 m/s: 5.8 * 5 + 17.7 = 46.7 m
    own = (40.0, 22.0)
    assert goes(wished(model, own, (47.2, 25.0), (46.2, 25.0))) == (Reason.SPEED_GAIN, None)
    assert goes(wished(model, own, (46.2, 25.0), (47.2, 25.0))) == (None, Reason.SPEED_GAIN)
    assert goes(wished(model, own, (48.0, 25.0), (47.2, 25.0))) == (Reason.SPEED_GAIN, None)
    assert goes(wished(model, own, (46.2, 25.0), (47.2, 25.0), blocked=(False, True))) == (None, None)
    # a leader hardly slower than wished, or far away, is no reason
    assert goes(wished(model, (40.0, 28.1), (20.0, 20.0), NOBODY)) == (None, None)
    assert goes(wished(model, (98.2, 22.0), (20.0, 20.0), NOBODY)) == (None, None)
    assert goes(wished(model, (97.2, 22.0), (20.0, 20.0), NOBODY)) == (None, Reason.SPEED_GAIN)


def test_a_driver_goes_to_the_slower_lane_where_it_is_free_for_the_collision_time() -> None:
    # 12 s behind 26 m/s: 12 * 4 + 17.7 = 65.7 m
    model = vissim(collision_time_s=12.0)
    assert goes(wished(model, NOBODY, (66.2, 26.0), NOBODY)) == (Reason.KEEP_RIGHT, None)
    assert goes(wished(model, NOBODY, (65.2, 26.0), NOBODY)) == (None, None)


def test_a_driver_makes_room_if_that_costs_him_little_speed() -> None:
    model = vissim(cooperative_speed_difference_mps=3.5)
    for leader_mps, helps in ((16.4, False), (16.6, True)):
        found = goes(wished(model, NOBODY, (30.0, 20.0), (30.0, leader_mps), asked=(False, True)))
        assert found == (None, Reason.COOPERATIVE if helps else None)


def test_the_route_comes_first_and_may_wait_for_its_gap() -> None:
    found = wished(vissim(), (40.0, 22.0), (10.0, 10.0), NOBODY, must=(True, False), blocked=(True, False))
    assert goes(found)[0] is Reason.STRATEGIC
    assert bool(found[0].urgent[0])
    assert not bool(found[1].urgent[0])


def test_braking_for_others_ends_at_the_cooperative_deceleration() -> None:
    assert float(vissim(cooperative_deceleration_mps2=2.2).most_asked_mps2()) == np.float32(2.2)
