"""What the subject vehicle detects on the corridor, against a search through all vehicles."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.loop.world import World
from surrogate.road.perception import NO_TRACK, PerceptionFrame, Sensor, perceive
from surrogate.road.traffic_state import TrafficState

AHEAD_M, BEHIND_M = 130.0, 85.0
SUBJECT_CLASS = 1
DEPART_S = 30.0
Frames = list[tuple[TrafficState, PerceptionFrame]]


@pytest.fixture(scope="module")
def world(corridor_world: Callable[..., World]) -> World:
    return corridor_world(9, DEPART_S, main=2900.0, on1=700.0)


@pytest.fixture(scope="module")
def frames(world: World, drive_on: Callable[[World, int], list[TrafficState]]) -> Frames:
    """A frame for each second; numbers given to vehicles are carried on by their identity."""
    sensor = Sensor(jnp.asarray(AHEAD_M, jnp.float32), jnp.asarray(BEHIND_M, jnp.float32), objects_per_row=24)
    look = jax.jit(lambda state, time_s: perceive(state, world.road, sensor, SUBJECT_CLASS, time_s)[:2])
    track_of: dict[int, int] = {}
    num_tracks, seen = 0, []
    for second, state in enumerate(drive_on(world, 130)):
        track = np.asarray([track_of.get(int(i), -1) for i in state.vehicles.identity], np.int32)
        track[state.vehicles.vehicle_class < 0] = -1
        state = eqx.tree_at(lambda s: (s.vehicles.track, s.num_tracks), state, (track, np.int32(num_tracks)))
        after, frame = jax.device_get(look(state, jnp.asarray(second, jnp.float32)))
        num_tracks = int(after.num_tracks)
        there = after.vehicles.vehicle_class >= 0
        track_of |= dict(
            zip(after.vehicles.identity[there].tolist(), after.vehicles.track[there].tolist(), strict=True)
        )
        seen.append((after, frame))
    return seen


def expected_objects(state: TrafficState, world: World) -> tuple[int, list[int]]:
    """Return the entry of the subject vehicle, -1 without one, and those of all that it detects, itself included."""
    v = state.vehicles
    ends = np.asarray(world.road.segment_end_m)
    arrived = v.position_m >= np.asarray(world.road.destination_end_m)[v.destination]
    subject = np.flatnonzero((v.vehicle_class == SUBJECT_CLASS) & ~arrived)
    if not len(subject):
        return -1, []
    here_m = v.position_m[subject[0]]
    found = []
    for entry in np.flatnonzero((v.vehicle_class >= 0) & ~arrived):
        segment = int(np.searchsorted(ends, v.position_m[entry], side="right"))
        in_range = -BEHIND_M <= v.position_m[entry] - here_m <= AHEAD_M
        if in_range and np.asarray(world.road.is_carriageway)[v.row[entry], segment]:
            found.append(int(entry))
    return int(subject[0]), found


def test_it_detects_all_vehicles_of_the_carriageway_in_range_and_no_others(frames: Frames, world: World) -> None:
    most = 0
    for state, frame in frames:
        subject, entries = expected_objects(state, world)
        assert bool(frame.valid) == (subject >= 0)
        if subject < 0:
            assert not frame.object_valid.any()
            continue
        v, seen = state.vehicles, frame.object_valid
        np.testing.assert_array_equal(frame.object_row[seen], v.row[entries])
        np.testing.assert_allclose(
            frame.object_offset_m[seen], v.position_m[entries] - v.position_m[subject], atol=1e-3
        )
        np.testing.assert_array_equal(frame.object_speed_mps[seen], v.speed_mps[entries])
        assert frame.object_is_subject[seen].tolist() == [entry == subject for entry in entries]
        assert float(frame.subject_position_m) == v.position_m[subject]
        assert float(frame.subject_speed_mps) == v.speed_mps[subject]
        most = max(most, len(entries))
    assert most > 8


def test_the_ramp_is_not_seen(frames: Frames, world: World) -> None:
    ends, carriageway = np.asarray(world.road.segment_end_m), np.asarray(world.road.is_carriageway)
    hidden = 0
    for state, _ in frames:
        subject, _ = expected_objects(state, world)
        v = state.vehicles
        for entry in np.flatnonzero(v.vehicle_class >= 0) if subject >= 0 else []:
            segment = int(np.searchsorted(ends, v.position_m[entry], side="right"))
            near = -BEHIND_M < v.position_m[entry] - v.position_m[subject] < AHEAD_M
            hidden += near and not carriageway[v.row[entry], segment]
    assert hidden > 0  # else the test above would say nothing about ramps


def test_each_vehicle_keeps_one_number_of_its_own(frames: Frames) -> None:
    number_of: dict[int, int] = {}
    for state, frame in frames:
        assert (frame.object_track[frame.object_is_subject] == NO_TRACK).all()
        others = frame.object_valid & ~frame.object_is_subject
        assert (frame.object_track[others] >= 0).all()
        v = state.vehicles
        for entry in np.flatnonzero((v.vehicle_class >= 0) & (v.track >= 0)):
            identity, track = int(v.identity[entry]), int(v.track[entry])
            assert number_of.setdefault(identity, track) == track
        assert set(frame.object_track[others].tolist()) <= set(v.track[v.vehicle_class >= 0].tolist())
    assert sorted(number_of.values()) == list(range(len(number_of)))
    assert len(number_of) == int(frames[-1][0].num_tracks) > 12
