"""What the surrogate's runs record is the table that the same frames give at once."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.diagnosis.features.frame_recorder import PLACE_STEP_M, SPEED_STEP_MPS, FrameRecorder
from surrogate.road.drive_table import DriveTable, drive_table
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, NUM_PLACES, Car, drive, instant

INTERVAL_S, BEGIN_S = 0.5, 3600.5
RECORDER = FrameRecorder(num_frames=16, num_objects=NUM_PLACES)


def driven(is_valid: list[bool]) -> PerceptionFrame:
    """Three vehicles, of which the last comes later and changes lane."""
    frames = []
    for number, valid in enumerate(is_valid):
        cars = [Car(EGO, 0, 500.0 + 10.0 * number, 20.0), Car(4, 0, 530.0 + 9.0 * number, 18.0, 0.5)]
        if number > 1:
            cars.append(Car(7, int(number > 3), 480.0 + 11.0 * number, 22.25, -0.5))
        frames.append(instant(BEGIN_S + INTERVAL_S * number, *cars, valid=valid, acceleration_mps2=0.125 * number))
    return drive(*frames)


def recorded(frames: PerceptionFrame) -> DriveTable:
    state, _ = jax.lax.scan(lambda state, frame: (RECORDER.update(state, frame), None), RECORDER.start(), frames)
    return RECORDER.table(np.asarray(RECORDER.finish(state)), INTERVAL_S)


@pytest.mark.parametrize(
    "is_valid",
    [[True] * 7, [True, True, False, False, True, True, True], [True, False, True, True, False, True, True]],
    ids=["whole", "a gap", "two gaps"],
)
def test_a_recorded_drive_is_the_one_that_was_seen(is_valid: list[bool]):
    frames = jax.tree.map(jnp.asarray, driven(is_valid))
    found, expected = recorded(frames), drive_table(frames, INTERVAL_S)
    np.testing.assert_array_equal(found.is_valid, is_valid)
    seen = {"instant": 0.0, "track": 0.0, "lane": 0.0, "offset_m": PLACE_STEP_M, "position_m": PLACE_STEP_M,
            "speed_mps": SPEED_STEP_MPS, "lateral_m": 0.02, "time_s": 1e-3}  # fmt: skip
    for name, step in seen.items():
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=step / 2, err_msg=name)
    for name in ("subject_speed_mps", "subject_acceleration_mps2"):
        np.testing.assert_allclose(getattr(found, name)[is_valid], getattr(expected, name)[is_valid], atol=1e-6)
    for name in ("leader", "before", "after"):  # nobody is the same across a gap
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_drive_that_is_not_seen_has_no_rows():
    table = recorded(jax.tree.map(jnp.asarray, driven([False] * 3)))
    assert (len(table.time_s), len(table.instant)) == (0, 0)


def test_what_does_not_fit_is_left_out():
    small = dataclasses.replace(RECORDER, num_frames=2)
    frames = jax.tree.map(jnp.asarray, driven([True] * 5))
    state, _ = jax.lax.scan(lambda state, frame: (small.update(state, frame), None), small.start(), frames)
    assert len(small.table(np.asarray(small.finish(state)), INTERVAL_S).time_s) == 2
