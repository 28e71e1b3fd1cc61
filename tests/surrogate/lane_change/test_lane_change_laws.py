"""Laws that every lane-change model obeys on the corridor in dense traffic."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.inflow.inflow import ENTRANCE_STRIDE
from surrogate.lane_change.decide import decide
from surrogate.lane_change.registry import LANE_CHANGE_MODELS, lane_change_model
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.world import World
from surrogate.road.traffic_state import TrafficState
from surrogate.vehicle.lane_change_model import LaneChangeModel, Reason
from surrogate.vehicle.model_entry import ModelEntry, ParameterRangeError, UnknownModelError
from tests.jit_marked import jit_marked

pytestmark = pytest.mark.long

LENGTH_M = 4.8  # of all vehicles of the corridor
NUM_DECISIONS = 240
MODELS = {entry.name: entry for entry in LANE_CHANGE_MODELS}


def off_usual(entry: ModelEntry[LaneChangeModel]) -> LaneChangeModel:
    """Return a model whose parameters are not the usual ones, to one side or the other."""
    values = {}
    for place, one in enumerate(entry.parameters):
        room = one.upper - one.usual if place % 2 else one.lower - one.usual
        values[one.name] = jnp.asarray(one.usual + 0.06 * room, jnp.float32)
    return entry.build(values)


@pytest.fixture(scope="module", params=list(MODELS))
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def world(name: str, corridor_world: Callable[..., World]) -> World:
    """Return the corridor whose vehicles have the model, but for the subject vehicle, which keeps LC2013."""
    dense = corridor_world(23, 42.0, main=3300.0, on1=620.0)
    return eqx.tree_at(lambda w: w.classes[0].lane_change, dense, off_usual(MODELS[name]))


@pytest.fixture(scope="module")
def states(world: World, drive_on: Callable[[World, int], list[TrafficState]]) -> list[TrafficState]:
    return drive_on(world, NUM_DECISIONS)


def drivers(state: TrafficState) -> dict[int, int]:
    """Return the entry of each vehicle that has the model, by its identity."""
    return {int(state.vehicles.identity[e]): int(e) for e in np.flatnonzero(state.vehicles.vehicle_class == 0)}


def changes(states: list[TrafficState]) -> list[tuple[TrafficState, int, int]]:
    """Return each change of lane: the state at the decision, the vehicle's entry then, and the row it went to."""
    found = []
    for before, after in pairwise(states):
        old, new = drivers(before), drivers(after)
        for identity in old.keys() & new.keys():
            row = int(after.vehicles.row[new[identity]])
            if row != before.vehicles.row[old[identity]]:
                found.append((before, old[identity], row))
    return found


def test_nobody_overlaps_and_rows_stay_sorted(states: list[TrafficState], world: World) -> None:
    closest = np.inf
    for state in states:
        v, head = state.vehicles, state.head
        for row in range(world.road.num_rows):
            inside = slice(head[row], head[row + 1])
            assert (v.row[inside] == row).all()
            position = v.position_m[inside][1:].astype(np.float64)
            closest = min(closest, (position[:-1] - LENGTH_M - position[1:]).min(initial=np.inf))
    assert 0.0 <= closest < 15.0  # it was dense enough to tell
    assert int(states[-1].num_collisions) == 0
    assert int(states[-1].num_lost) == 0


def test_drivers_change_for_speed_and_for_their_route_to_a_lane_beside(
    states: list[TrafficState], world: World
) -> None:
    num_changes = np.asarray(states[-1].num_lane_changes)
    assert num_changes[Reason.SPEED_GAIN] > 10
    assert num_changes[Reason.STRATEGIC] > 30
    left, right = np.asarray(world.road.left_row), np.asarray(world.road.right_row)
    ends = np.asarray(world.road.segment_end_m)
    found = changes(states)
    for state, entry, row in found:
        segment = int(np.searchsorted(ends, state.vehicles.position_m[entry], side="right"))
        was = state.vehicles.row[entry]
        assert row in (left[was, segment], right[was, segment])
    assert len(found) > 60


def test_nobody_changes_into_an_occupied_gap(states: list[TrafficState]) -> None:
    for state, entry, row in changes(states):
        place = float(state.vehicles.position_m[entry])
        inside = slice(state.head[row] + 1, state.head[row + 1])
        distance = np.abs(state.vehicles.position_m[inside].astype(np.float64) - place)
        assert distance.min(initial=np.inf) > LENGTH_M


def test_vehicles_keep_their_route_and_those_from_the_ramp_get_in(states: list[TrafficState], world: World) -> None:
    end_m = np.asarray(world.road.destination_end_m)
    last_seen: dict[int, tuple[int, TrafficState]] = {}
    for state in states:
        there = state.vehicles.vehicle_class >= 0
        assert (state.vehicles.position_m[there] < end_m[state.vehicles.destination[there]] + 45.0).all()
        last_seen |= {identity: (entry, state) for identity, entry in drivers(state).items()}
    gone = {i: (e, s) for i, (e, s) in last_seen.items() if s is not states[-1]}
    for destination, end in enumerate(end_m):
        places = [s.vehicles.position_m[e] for e, s in gone.values() if s.vehicles.destination[e] == destination]
        assert len(places) >= 5
        assert min(places) >= end
    assert sum(identity // ENTRANCE_STRIDE == 1 for identity in gone) >= 10  # the on-ramp's
    standing = states[-1].vehicles.speed_mps[states[-1].vehicles.vehicle_class >= 0] < 0.5
    assert standing.mean() < 0.1


def test_derivatives_of_a_decision_are_finite(states: list[TrafficState], world: World) -> None:
    model = world.classes[0].lane_change

    def numbers(model: LaneChangeModel, state: TrafficState) -> list[jax.Array]:
        changed = eqx.tree_at(lambda w: w.classes[0].lane_change, world, model)
        found: Any = decide(VehiclesOnRoad(state.vehicles, world.road, state.head), changed.classes, 1.0, 0.1)
        return [
            jnp.where(jnp.isfinite(leaf), leaf, 0.0) for leaf in jax.tree.leaves(found) if leaf.dtype == jnp.float32
        ]

    @jit_marked
    def slopes(state: TrafficState, direction: LaneChangeModel) -> list[jax.Array]:
        return jax.jvp(lambda one: numbers(one, state), (model,), (direction,))[1]

    random = np.random.default_rng(2)
    for state in states[60::60]:
        direction = jax.tree.map(lambda leaf: jnp.asarray(random.normal(), leaf.dtype), model)
        assert all(np.isfinite(np.asarray(leaf)).all() for leaf in slopes(state, direction))


def test_an_unknown_model_or_a_value_out_of_range_is_refused_with_what_is_known() -> None:
    with pytest.raises(UnknownModelError, match=r"no lane-change model 'gipps'; known are lc2013, mobil, vissim\."):
        lane_change_model("gipps")
    with pytest.raises(UnknownModelError, match=r"vissim has no parameter 'tau'; it has safety_distance_factor"):
        lane_change_model("VISSIM").build({"tau": 1.0})
    with pytest.raises(ParameterRangeError, match=r"vissim: safety_distance_factor is 1\.2; expected 0\.1 to 1"):
        lane_change_model("vissim").build({"safety_distance_factor": 1.2})
