"""Effects on frames: the same code for the simulator's frames and for any others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.effects.apply import sense_drive
from surrogate.effects.base import EffectSetting
from surrogate.effects.lane_change_duration import LANE_CHANGE_DURATION, LANE_WIDTH_M
from surrogate.road.perception import NO_TRACK, PerceptionFrame, in_order
from tests.jit_marked import jit_as_users_do
from tests.surrogate.effects.effects_stage import SEED, effects_of, frame_of

SPEEDS = {3: 17.0, 8: 22.5, 5: 19.0, 1: 25.0}
START = {3: 61.0, 8: -20.0, 5: 4.0, 1: -95.0}
ROW = {3: 0, 8: 1, 5: 2, 1: 2}
OWN_MPS, OWN_ROW = 20.0, 1


def frame_at(time_s: float) -> PerceptionFrame:
    """Everybody at a constant speed; a place of the arrays may belong to somebody else in the next frame."""
    offset = {track: START[track] + (SPEEDS[track] - OWN_MPS) * time_s for track in SPEEDS}
    objects = [(ROW[t], offset[t], SPEEDS[t], t) for t in SPEEDS] + [(OWN_ROW, 0.0, OWN_MPS, NO_TRACK)]
    objects.sort(key=lambda one: (one[0], -one[1]))
    row, offsets, speeds, tracks = (list(column) for column in zip(*objects, strict=True))
    return frame_of(time_s, row, offsets, speeds, tracks, tracks.index(NO_TRACK))


def drive(times_s: np.ndarray) -> PerceptionFrame:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *(frame_at(float(time_s)) for time_s in times_s))


def sensed(frames: PerceptionFrame, **strengths: float) -> PerceptionFrame:
    settings = {name: EffectSetting(strength) for name, strength in strengths.items()}
    return jax.device_get(jit_as_users_do(sense_drive)(frames, effects_of(settings), jnp.asarray(SEED)))


TIMES_S = 40.0 + 0.5 * np.arange(30)


def of_track(frames: PerceptionFrame, track: int, field: str) -> np.ndarray:
    there = np.asarray(frames.object_track) == track
    assert (there.sum(axis=1) == 1).all()
    return np.asarray(getattr(frames, field))[there]


def test_without_effects_frames_stay_as_they_are() -> None:
    frames = drive(TIMES_S)
    for before, after in zip(jax.tree.leaves(frames), jax.tree.leaves(sensed(frames)), strict=True):
        assert np.asarray(before).tobytes() == after.tobytes()


def test_a_drive_is_the_same_whatever_sensors_see_the_others_of_its_batch() -> None:
    frames, several = drive(TIMES_S), [{}, {"sensor_latency": 0.55}, {"sensor_noise": 0.4}]
    settings = [effects_of({name: EffectSetting(strength) for name, strength in one.items()}) for one in several]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *settings)
    of_all = jit_as_users_do(jax.vmap(sense_drive, (None, 0, None)))
    together = jax.device_get(of_all(frames, stacked, jnp.asarray(SEED)))
    for place, one in enumerate(several):
        mine, alone = jax.tree.map(lambda leaf, place=place: leaf[place], together), sensed(frames, **one)
        for here, there in zip(jax.tree.leaves(mine), jax.tree.leaves(alone), strict=True):
            np.testing.assert_array_equal(here, there)


def test_bias_scales_every_distance_and_nothing_else() -> None:
    frames = drive(TIMES_S)
    after = sensed(frames, gap_sensor_bias=0.05)
    np.testing.assert_array_equal(after.object_offset_m, np.asarray(frames.object_offset_m) * np.float32(1.05))
    np.testing.assert_array_equal(after.object_speed_mps, frames.object_speed_mps)


@pytest.mark.parametrize("latency_s", [0.3, 0.5, 0.85])
def test_latency_reports_objects_as_they_were_and_the_subject_as_it_is(latency_s: float) -> None:
    frames = drive(TIMES_S)
    after = sensed(frames, sensor_latency=latency_s)
    for track in SPEEDS:
        expected = START[track] + (SPEEDS[track] - OWN_MPS) * (TIMES_S - latency_s)
        np.testing.assert_allclose(of_track(after, track, "object_offset_m")[3:], expected[3:], atol=2e-4)
        np.testing.assert_allclose(of_track(after, track, "object_speed_mps"), SPEEDS[track], rtol=1e-6)
    np.testing.assert_array_equal(after.object_offset_m[after.object_is_subject], 0.0)
    np.testing.assert_array_equal(after.subject_position_m, frames.subject_position_m)


def test_noise_has_its_deviation_and_grows_with_the_strength() -> None:
    times_s = 30.0 + 0.05 * np.arange(600)
    frames = drive(times_s)
    one, two = sensed(frames, sensor_noise=0.3), sensed(frames, sensor_noise=0.6)
    of_distance, of_speed = [], []
    for track in SPEEDS:
        true = of_track(frames, track, "object_offset_m")
        error = of_track(one, track, "object_offset_m") - true
        np.testing.assert_allclose(of_track(two, track, "object_offset_m") - true, 2.0 * error, atol=2e-4)
        of_distance.append(error)
        of_speed.append(of_track(one, track, "object_speed_mps") - SPEEDS[track])
    errors = np.concatenate([*of_distance, *of_speed])
    assert errors.std() == pytest.approx(0.3, rel=4.0 / np.sqrt(2 * len(errors)))
    together = np.corrcoef(np.concatenate(of_distance), np.concatenate(of_speed))[0, 1]
    assert abs(together) < 4.0 / np.sqrt(len(errors) / 2)
    assert (np.asarray(one.object_offset_m)[one.object_is_subject] == 0.0).all()


def test_shorter_range_loses_the_far_and_some_of_the_near() -> None:
    times_s = 30.0 + 0.05 * np.arange(1200)
    frames = drive(times_s)
    after = sensed(frames, sensor_range=0.6)
    is_far = (np.asarray(frames.object_offset_m) > 0.4 * 140.0) | (np.asarray(frames.object_offset_m) < -0.4 * 110.0)
    near = np.asarray(frames.object_valid & ~frames.object_is_subject) & ~is_far
    kept = np.asarray(after.object_valid & ~after.object_is_subject).sum()
    assert kept / near.sum() == pytest.approx(0.94, abs=4.0 * np.sqrt(0.06 * 0.94 / near.sum()))
    offset = after.object_offset_m[after.object_valid]
    assert offset.max() <= 0.4 * 140.0
    assert offset.min() >= -0.4 * 110.0
    assert after.object_is_subject.sum() == len(times_s)
    assert (after.object_track[~after.object_valid] == NO_TRACK).all()


def test_frames_come_in_order_whatever_the_sensor_does() -> None:
    after = sensed(drive(TIMES_S), sensor_noise=6.0, sensor_range=0.3, sensor_latency=0.4, gap_sensor_bias=-0.1)
    for time in range(len(TIMES_S)):
        there = after.object_valid[time]
        assert not there[int(there.sum()) :].any()  # empty places come last
        keys = list(zip(after.object_row[time][there], -after.object_offset_m[time][there], strict=True))
        assert keys == sorted(keys)


def test_order_keeps_every_object_once() -> None:
    order = np.random.default_rng(3).permutation(7)
    frame = frame_of(3.0, [2, 0, 1, 0], [5.0, -4.0, 0.0, 30.0], [1.0, 2.0, 3.0, 4.0], [7, 8, 9, 4], 2)
    shuffled = jax.tree.map(lambda leaf: leaf[order] if leaf.ndim else leaf, frame)
    after = in_order(jax.tree.map(jnp.asarray, shuffled))
    assert sorted(np.asarray(after.object_track)) == sorted(np.asarray(shuffled.object_track))
    assert after.object_valid.sum() == shuffled.object_valid.sum()


def test_a_vehicle_between_two_lanes_is_reported_off_the_middle_of_the_one_it_joins() -> None:
    """A change to the left that takes 4 s, with 3.0, 1.0 and 0 s of it left."""
    assert LANE_CHANGE_DURATION.appear is not None
    dial = effects_of({"lane_change_duration": EffectSetting(4.0)}).dial("lane_change_duration")
    frame = frame_of(50.0, [1, 1, 1], [40.0, 20.0, 0.0], [20.0, 20.0, 20.0], [4, 6, 0], 2)
    spare = [0.0] * 3
    memory = {
        "remaining_s": jnp.asarray([3.0, 1.0, 0.0, *spare]),
        "direction": jnp.asarray([1, 1, 1, 0, 0, 0]),
    }
    after = LANE_CHANGE_DURATION.appear(dial, jax.tree.map(jnp.asarray, frame), memory)
    np.testing.assert_array_equal(after.object_row[:3], [1, 1, 1])
    np.testing.assert_allclose(after.object_lateral_m[:3], [-0.5 * LANE_WIDTH_M, -0.25 * LANE_WIDTH_M, 0.0], atol=1e-6)
