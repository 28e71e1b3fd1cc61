"""Dense traffic on the corridor, looked at after every decision: nobody appears, vanishes or overlaps."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from sim_adapters.world.world_builder import WorldTemplate
from surrogate.inflow.inflow import ENTRANCE_STRIDE
from surrogate.loop.world import World
from surrogate.road.traffic_state import EMPTY, HEAD, TrafficState

LENGTH_M = 4.8  # of all vehicles of the corridor
DEPART_S = 42.0
NUM_DECISIONS = 260
SUBJECT = 2 * ENTRANCE_STRIDE  # identity of the subject vehicle where there are two entrances


@pytest.fixture(scope="module")
def world(corridor_world: Callable[..., World]) -> World:
    return corridor_world(19, DEPART_S, main=3300.0, on1=620.0)


@pytest.fixture(scope="module")
def states(world: World, drive_on: Callable[[World, int], list[TrafficState]]) -> list[TrafficState]:
    return drive_on(world, NUM_DECISIONS)


def on_road(state: TrafficState) -> dict[int, int]:
    """Return the entry of each vehicle by its identity."""
    entries = np.flatnonzero(state.vehicles.vehicle_class >= 0)
    found = {int(state.vehicles.identity[entry]): int(entry) for entry in entries}
    assert len(found) == len(entries), "an identity is there twice"
    return found


def test_whoever_is_on_the_road_has_entered_and_not_left(states: list[TrafficState], world: World) -> None:
    end_m = np.asarray(world.road.destination_end_m)
    num_left = 0
    for before, after in pairwise(states):
        old, new = on_road(before), on_road(after)
        at_destination = {
            i for i, e in old.items() if before.vehicles.position_m[e] >= end_m[before.vehicles.destination[e]]
        }
        assert old.keys() - new.keys() == at_destination
        num_left += len(at_destination - {SUBJECT})
        assert len(new.keys() - {SUBJECT}) == after.num_inserted.sum() - num_left
        entered = new.keys() - old.keys() - {SUBJECT}
        for entrance in (0, 1):
            arrivals = sorted(i % ENTRANCE_STRIDE for i in entered if i // ENTRANCE_STRIDE == entrance)
            first, last = before.num_inserted[entrance], after.num_inserted[entrance]
            assert arrivals == list(range(first, last))
    assert num_left > 50
    assert int(states[-1].num_lost) == 0


def test_entries_stay_sorted_by_row_and_position(states: list[TrafficState], world: World) -> None:
    num_rows = world.road.num_rows
    for state in states:
        v, head = state.vehicles, state.head
        kind = np.full(len(v.row), EMPTY)
        for row in range(num_rows):
            inside = slice(head[row], head[row + 1])
            assert (v.row[inside] == row).all()
            assert v.position_m[head[row]] == np.inf
            assert (np.diff(v.position_m[inside][1:]) < 0.0).all()
            kind[inside] = 0
        kind[head[:-1]] = HEAD
        np.testing.assert_array_equal(np.minimum(v.vehicle_class, 0), kind)


def test_no_vehicle_overlaps_its_leader(states: list[TrafficState], world: World) -> None:
    closest = np.inf
    for state in states:
        for row in range(world.road.num_rows):
            position = state.vehicles.position_m[state.head[row] + 1 : state.head[row + 1]].astype(np.float64)
            gaps = position[:-1] - LENGTH_M - position[1:]
            closest = min(closest, gaps.min(initial=np.inf))
    assert closest >= 0.0
    assert closest < 15.0  # it was dense enough to tell
    assert int(states[-1].num_collisions) == 0


def test_vehicles_go_forward_no_faster_than_they_want_and_stay_within_their_limits(
    states: list[TrafficState], template: WorldTemplate
) -> None:
    values = template.class_values[0]
    for before, after in pairwise(states):
        old, new = on_road(before), on_road(after)
        stayed = sorted(old.keys() & new.keys())
        was, now = [old[i] for i in stayed], [new[i] for i in stayed]
        b, a = before.vehicles, after.vehicles
        moved = a.position_m[now] - b.position_m[was]
        assert (moved >= 0.0).all()
        fastest = np.maximum(b.speed_mps[was], a.speed_factor[now] * a.speed_limit_mps[now])
        assert (moved <= fastest * 1.0 + 0.01).all()
        assert (a.speed_mps[now] >= 0.0).all()
        assert (a.acceleration_mps2[now] <= values["accel"] + 1e-3).all()
        assert (a.acceleration_mps2[now] >= -values["emergencyDecel"] - 1e-3).all()


def test_a_lane_change_leads_to_a_lane_beside_and_is_counted(states: list[TrafficState], world: World) -> None:
    left, right = np.asarray(world.road.left_row), np.asarray(world.road.right_row)
    ends = np.asarray(world.road.segment_end_m)
    num_changes = 0
    for before, after in pairwise(states):
        old, new = on_road(before), on_road(after)
        for identity in old.keys() & new.keys():
            was, now = before.vehicles.row[old[identity]], after.vehicles.row[new[identity]]
            if was != now:
                num_changes += 1
                segment = int(np.searchsorted(ends, before.vehicles.position_m[old[identity]], side="right"))
                assert now in (left[was, segment], right[was, segment])
        assert num_changes == after.num_lane_changes.sum()
    assert num_changes > 50
    assert (states[-1].num_lane_changes > 0).sum() >= 3  # for several reasons


def test_the_subject_vehicle_enters_once_when_it_departs_and_leaves_at_the_end(
    states: list[TrafficState], template: WorldTemplate
) -> None:
    is_there = np.asarray([SUBJECT in on_road(state) for state in states])
    present = np.flatnonzero(is_there)
    assert DEPART_S < present[0] <= DEPART_S + 10.0  # the state after decision n is that of second n
    assert (np.diff(present) == 1).all()
    subject_class = len(template.class_names) - 1
    for state in states:
        subject = np.flatnonzero(state.vehicles.vehicle_class == subject_class)
        assert [int(state.vehicles.identity[e]) for e in subject] == [i for i in on_road(state) if i == SUBJECT]
    assert [bool(s.subject_inserted) for s in states] == (np.arange(len(states)) >= present[0]).tolist()
    assert bool(states[-1].subject_left) == (present[-1] < len(states) - 1)
    assert bool(states[-1].subject_left)


def test_vehicles_of_the_off_ramp_leave_there_and_the_others_at_the_end(
    states: list[TrafficState], template: WorldTemplate, world: World
) -> None:
    for state in states:
        v = state.vehicles
        there = v.vehicle_class >= 0
        end_m = np.asarray(world.road.destination_end_m)[v.destination[there]]
        assert (v.position_m[there] < end_m + 45.0).all()  # nobody has driven past his exit for longer than a decision
    last_seen = {}
    for state in states:
        for identity, entry in on_road(state).items():
            last_seen[identity] = entry, state
    gone = [(e, s) for i, (e, s) in last_seen.items() if s is not states[-1]]
    for destination, end_m in enumerate(np.asarray(world.road.destination_end_m)):
        places = [s.vehicles.position_m[e] for e, s in gone if s.vehicles.destination[e] == destination]
        assert len(places) >= 5
        assert min(places) >= end_m
    assert template.serves.shape[1] == 2
