"""Lane changes that take time, in dense traffic on the corridor."""

from collections.abc import Callable
from itertools import pairwise

import jax
import numpy as np
import pytest

from surrogate.lane_change.manoeuvre import ChangeTiming, change_timing
from surrogate.loop.moving import move_on
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import TrafficState
from surrogate.vehicle.lane_change_model import STAY
from tests.jit_marked import jit_marked

LENGTH_M = 4.8  # of all vehicles of the corridor
CAPACITY = 288
CLOCK = Clock(step_s=0.1, steps_per_decision=10)
SLOW = Clock(step_s=0.1, steps_per_decision=10, lane_change_duration_s=3.0)
NUM_DECISIONS = 240


@pytest.fixture(scope="module")
def world(corridor_world: Callable[..., World]) -> World:
    return corridor_world(19, 42.0, main=3300.0, on1=620.0)


@pytest.fixture(scope="module")
def states(world: World) -> list[TrafficState]:
    @jit_marked
    def advance(state: TrafficState, world: World) -> TrafficState:
        return move_on(settle_lanes(state, world, SLOW), world, SLOW.step_s, SLOW.steps_per_decision)

    states = [jax.jit(lambda world: initial_state(world, CAPACITY, SLOW))(world)]
    for _ in range(NUM_DECISIONS):
        states.append(advance(states[-1], world))
    return [jax.device_get(state) for state in states]


def changing(state: TrafficState) -> dict[int, int]:
    """Return the entry of each vehicle that is changing, by its identity."""
    assert state.manoeuvres is not None
    return {
        int(state.vehicles.identity[e]): int(e)
        for e in np.flatnonzero((state.manoeuvres.direction != STAY) & (state.vehicles.vehicle_class >= 0))
    }


def test_the_timing_is_sumo_s_rounded_to_decisions_and_none_where_changes_are_over_at_once() -> None:
    assert change_timing(0.0, 0.1, 1.0) is None
    assert change_timing(0.1, 0.1, 0.1) is None
    assert change_timing(0.9, 0.1, 1.0) is None
    assert change_timing(3.0, 0.1, 0.1) == ChangeTiming(switches=15, leaves=23, ends=30)
    assert change_timing(3.0, 0.1, 1.0) == ChangeTiming(switches=2, leaves=2, ends=3)
    assert CLOCK.change_timing is None


def test_without_a_duration_the_state_carries_nothing_for_it(world: World) -> None:
    assert initial_state(world, CAPACITY, CLOCK).manoeuvres is None
    assert initial_state(world, CAPACITY).manoeuvres is None


def test_each_change_takes_its_time_once_and_ends_in_the_lane_beside(states: list[TrafficState], world: World) -> None:
    left, right = np.asarray(world.road.left_row), np.asarray(world.road.right_row)
    begun, num_switched = 0, 0
    for before, after in pairwise(states):
        assert before.manoeuvres is not None
        assert after.manoeuvres is not None
        old, new = changing(before), changing(after)
        for identity, entry in new.items():
            manoeuvre = jax.tree.map(lambda leaf, e=entry: int(leaf[e]), after.manoeuvres)
            assert 0 <= manoeuvre.age <= 2
            row = int(after.vehicles.row[entry])
            assert manoeuvre.shadow_row in (*left[row], *right[row])
            if manoeuvre.age == 0:
                begun += 1
            else:
                assert int(before.manoeuvres.age[old[identity]]) == manoeuvre.age - 1
            if manoeuvre.has_switched and not before.manoeuvres.has_switched[old[identity]]:
                num_switched += 1
                assert manoeuvre.age == 2
                assert int(before.manoeuvres.shadow_row[old[identity]]) == row
    assert begun > 100
    assert 0.9 * begun - 20 < num_switched <= begun
    assert num_switched <= states[-1].num_lane_changes.sum() <= begun


def test_nobody_overlaps_a_vehicle_or_the_shadow_of_one(states: list[TrafficState], world: World) -> None:
    num_shadows = 0
    for state in states:
        position = state.vehicles.position_m.astype(np.float64)
        for row in range(world.road.num_rows):
            inside = slice(state.head[row] + 1, state.head[row + 1])
            assert (-np.diff(position[inside]) >= LENGTH_M).all()
        assert state.manoeuvres is not None
        for entry in changing(state).values():
            if state.manoeuvres.age[entry] < 2:
                row = state.manoeuvres.shadow_row[entry]
                beside = position[state.head[row] + 1 : state.head[row + 1]]
                assert np.abs(beside - position[entry]).min(initial=np.inf) >= LENGTH_M
                num_shadows += 1
    assert num_shadows > 100
    assert int(states[-1].num_collisions) == 0
    assert int(states[-1].num_lost) == 0


def test_vehicles_reach_their_exits(states: list[TrafficState], world: World) -> None:
    end_m = np.asarray(world.road.destination_end_m)
    for state in states:
        there = state.vehicles.vehicle_class >= 0
        assert (state.vehicles.position_m[there] < end_m[state.vehicles.destination[there]] + 45.0).all()
    assert states[-1].num_inserted.sum() - (states[-1].vehicles.vehicle_class >= 0).sum() > 50
