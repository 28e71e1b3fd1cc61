"""Who of those who wait may try to enter which lane, and who waits on."""

import jax.numpy as jnp
import numpy as np

from surrogate.inflow.asking import still_waiting
from surrogate.inflow.lane_choice import first_of_each_lane, wants_less_than_someone_right
from surrogate.inflow.newcomers import Entrants
from surrogate.road.traffic_state import empty_vehicles

NOT = -np.inf


def lanes_of(preference: list[list[float]]) -> list[int]:
    (chosen,) = np.asarray(first_of_each_lane(jnp.asarray([preference], jnp.float32)))
    return chosen.tolist()


def test_each_in_turn_takes_the_lane_he_likes_best_of_those_left() -> None:
    assert lanes_of([[40.0, 90.0, 70.0], [40.0, 90.0, 70.0], [40.0, 90.0, 70.0], [40.0, 90.0, 70.0]]) == [2, 0, 1]


def test_of_equal_lanes_the_right_one_is_taken() -> None:
    assert lanes_of([[80.0, 80.0], [NOT, NOT]]) == [0, -1]


def test_nobody_waits_for_one_who_wants_another_lane() -> None:
    only_right, only_left = [12.0, NOT, NOT], [NOT, NOT, 33.0]
    assert lanes_of([only_right, only_right, only_right, only_left]) == [0, -1, 3]


def test_who_is_not_there_takes_no_lane() -> None:
    assert lanes_of([[NOT, NOT], [NOT, 5.0], [NOT, NOT]]) == [-1, 1]


def test_slow_drivers_do_not_enter_left_of_one_who_wants_to_be_faster() -> None:
    """SUMO 1.28's "best_prob"; measured there with three lanes whose last vehicles want 28, 24 and 40 m/s."""
    wants, last_wants = jnp.asarray([[30.0, 26.0, 41.0]]), jnp.asarray([[28.0, 24.0, 40.0]])
    serves = jnp.ones((1, 3, 3), bool)
    assert np.asarray(wants_less_than_someone_right(wants, last_wants, serves))[0].tolist() == [
        [False, False, False],  # all further right want less
        [False, True, True],  # 28 on the right lane
        [False, False, False],
    ]
    not_right = serves.at[:, :, 0].set(False)
    assert not np.asarray(wants_less_than_someone_right(wants, last_wants, not_right))[0, 1].any()


def test_who_has_entered_waits_no_longer_and_the_others_keep_their_order() -> None:
    waiting = jnp.asarray([[4, 5, 7, 9], [2, -1, -1, -1]])
    slot = jnp.asarray([[1, 3, 4], [0, 1, 2]])  # 4 is the subject vehicle, which is on no list
    has_entered = jnp.asarray([True, False, True, False, False, True])[:, None]
    each = jnp.zeros((6, 1))
    candidates = Entrants(
        empty_vehicles(1, 6), each.astype(int), has_entered, each.astype(int), each.astype(bool), waiting, slot
    )
    left = still_waiting(candidates, has_entered)
    assert left is not None
    assert left.tolist() == [[4, 7, 9, -1], [2, -1, -1, -1]]
