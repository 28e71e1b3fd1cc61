"""Effects put into recorded drives: frame by frame as in the simulator, or by code for whole drives."""

import numpy as np
import pytest

from surrogate.effects.base import Effect
from surrogate.effects.recorded_drives import alter_drive, sense_table
from surrogate.effects.registry import EFFECTS, effect_named
from surrogate.road.drive_table import DriveTable, LogFormat, as_logged
from surrogate.road.perception import NO_TRACK

LOG = LogFormat(ahead_m=150.0, behind_m=120.0, place_step_m=0.01, speed_step_mps=0.01 / 3.6)
STEP_S, NUM_INSTANTS, NUM_VEHICLES = 0.2, 60, 9
SENSORS = [effect for effect in EFFECTS if effect.is_sensor_s]


def some_drive() -> DriveTable:
    """Return a drive among eight other vehicles of three lanes, as its log holds it."""
    random = np.random.default_rng(5)
    time_s = 300.0 + STEP_S * np.arange(NUM_INSTANTS)
    speed_mps = random.uniform(12.0, 20.0, NUM_VEHICLES) + 0.5 * np.sin(0.9 * time_s)[:, None]
    start_m = np.where(np.arange(NUM_VEHICLES) == 0, 400.0, random.uniform(300.0, 510.0, NUM_VEHICLES))
    position_m = start_m + STEP_S * np.cumsum(speed_mps, axis=0)
    offset_m = position_m - position_m[:, :1]
    instant, vehicle = np.nonzero((offset_m <= LOG.ahead_m) & (offset_m >= -LOG.behind_m))
    table = DriveTable(
        interval_s=STEP_S,
        time_s=time_s,
        is_valid=np.ones(NUM_INSTANTS, bool),
        subject_acceleration_mps2=np.gradient(speed_mps[:, 0], STEP_S),
        subject_speed_mps=speed_mps[:, 0],
        instant=instant,
        track=np.where(vehicle == 0, NO_TRACK, vehicle),
        lane=vehicle % 3,
        offset_m=offset_m[instant, vehicle],
        position_m=position_m[instant, vehicle],
        speed_mps=speed_mps[instant, vehicle],
        lateral_m=np.zeros(len(instant)),
    )
    return as_logged(table.sorted(), LOG)


@pytest.mark.parametrize("effect", SENSORS, ids=lambda effect: effect.name)
def test_a_sensor_of_strength_0_reports_what_there_is(effect: Effect) -> None:
    table = some_drive()
    seen = sense_table(table, effect, 0.0, LOG, seed=7)
    for name in ("time_s", "subject_speed_mps", "subject_acceleration_mps2", "instant", "track", "lane", "offset_m"):
        np.testing.assert_array_equal(getattr(seen, name), getattr(table, name))
    np.testing.assert_allclose(seen.speed_mps, table.speed_mps, rtol=1e-12)
    np.testing.assert_allclose(seen.position_m, table.position_m, rtol=1e-12)


@pytest.mark.parametrize("bias", [-0.07, 0.04])
def test_distances_too_long_frame_by_frame_are_those_of_whole_drives(bias: float) -> None:
    table, effect = some_drive(), effect_named("gap_sensor_bias")
    whole = alter_drive(table, effect, bias, LOG, np.random.default_rng(1))
    by_frame = sense_table(table, effect, bias, LOG, seed=1)
    assert len(whole.instant) == len(by_frame.instant)
    np.testing.assert_array_equal(whole.track, by_frame.track)
    np.testing.assert_allclose(by_frame.offset_m, whole.offset_m, atol=1.01 * LOG.place_step_m)
    np.testing.assert_allclose(by_frame.position_m, whole.position_m, atol=1.01 * LOG.place_step_m)


def test_lateness_of_whole_steps_frame_by_frame_is_that_of_whole_drives() -> None:
    table, effect = some_drive(), effect_named("sensor_latency")
    whole = alter_drive(table, effect, 2 * STEP_S, LOG, np.random.default_rng(1))
    by_frame = sense_table(table, effect, 2 * STEP_S, LOG, seed=1)
    late = {(i, t): x for i, t, x in zip(whole.instant, whole.track, whole.offset_m, strict=True) if i >= 2}
    seen = {(i, t): x for i, t, x in zip(by_frame.instant, by_frame.track, by_frame.offset_m, strict=True) if i >= 2}
    assert late.keys() == seen.keys()
    np.testing.assert_allclose([seen[key] for key in late], list(late.values()), atol=1.01 * LOG.place_step_m)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_what_has_a_rhythm_can_be_put_into_a_drive(effect: Effect) -> None:
    if effect.rhythms_s:
        assert effect.alter is not None
        assert not effect.is_sensor_s
    assert not effect.lasts_as_strength or effect.has_time
    assert not effect.is_whole_steps or effect.is_sensor_s
