"""Samples brought to an even clock, checked by hand and by laws."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from jaxcalib.field.even_clock import EvenDrive, to_even_clock
from sim_adapters.frame_table import ObjectTable, SubjectTable

LONGEST_GAP_S = 1.05


def subject_table(
    time_s: ArrayLike,
    position_m: ArrayLike,
    speed_mps: ArrayLike = 20.0,
    row: ArrayLike = 0,
    num_lanes: ArrayLike = 3,
    lateral_m: ArrayLike = 0.0,
) -> SubjectTable:
    time_s = np.asarray(time_s, float)

    def column(values: ArrayLike, dtype: type = float) -> np.ndarray:
        return np.broadcast_to(np.asarray(values, dtype), time_s.shape).copy()

    return SubjectTable(
        time_s=time_s,
        position_m=column(position_m),
        speed_mps=column(speed_mps),
        acceleration_mps2=column(0.5),
        row=column(row, int),
        lateral_m=column(lateral_m),
        num_lanes=column(num_lanes, int),
    )


def object_table(
    instant: ArrayLike,
    offset_m: ArrayLike,
    track: ArrayLike = 0,
    row: ArrayLike = 0,
    speed_mps: ArrayLike = 20.0,
    lateral_m: ArrayLike = 0.0,
) -> ObjectTable:
    instant = np.asarray(instant, int)

    def column(values: ArrayLike, dtype: type = float) -> np.ndarray:
        return np.broadcast_to(np.asarray(values, dtype), instant.shape).copy()

    return ObjectTable(
        instant=instant,
        track=column(track, int),
        row=column(row, int),
        offset_m=column(offset_m),
        speed_mps=column(speed_mps),
        lateral_m=column(lateral_m),
    )


NOBODY = object_table([], [])


def even(subject: SubjectTable, objects: ObjectTable = NOBODY, interval_s: float = 0.5, episode=None) -> EvenDrive:
    episode = objects.track if episode is None else np.asarray(episode)
    return to_even_clock(subject, objects, episode, interval_s, LONGEST_GAP_S)


def test_samples_on_the_clock_are_taken_as_they_are():
    drive = even(subject_table([1.0, 1.5004, 2.0], [10.0, 23.0, 31.0], [20.0, 19.0, 18.0]))
    np.testing.assert_array_equal(drive.subject.time_s, [1.0, 1.5, 2.0])
    np.testing.assert_array_equal(drive.subject.position_m, [10.0, 23.0, 31.0])
    np.testing.assert_array_equal(drive.subject.speed_mps, [20.0, 19.0, 18.0])
    assert drive.valid.all()


def test_between_samples_values_are_interpolated_and_nothing_is_extrapolated():
    drive = even(
        subject_table([1.2, 1.7, 2.2], [0.0, 10.0, 30.0], [20.0, 22.0, 26.0], row=[0, 1, 1], num_lanes=[3, 3, 4])
    )
    np.testing.assert_array_equal(drive.subject.time_s, [1.5, 2.0])
    np.testing.assert_allclose(drive.subject.position_m, [6.0, 22.0], rtol=1e-12)
    np.testing.assert_allclose(drive.subject.speed_mps, [21.2, 24.4], rtol=1e-12)
    np.testing.assert_array_equal(drive.subject.row, [1, 1])  # 0.3 s after one sample, 0.2 s before the next
    np.testing.assert_array_equal(drive.subject.num_lanes, [3, 4])


def test_a_gap_of_the_subject_vehicle_is_not_valid():
    drive = even(subject_table([0.0, 0.5, 1.0, 2.5, 3.0], [0, 10, 20, 50, 60]), object_table([0, 1, 2, 3, 4], 5.0))
    np.testing.assert_array_equal(drive.valid, [True, True, True, False, False, True, True])
    np.testing.assert_array_equal(np.sort(drive.objects.instant), [0, 1, 2, 5, 6])


def test_a_gap_of_an_object_is_bridged_up_to_a_second():
    subject = subject_table(np.arange(7) * 0.5, np.arange(7) * 10.0)
    drive = even(subject, object_table([0, 2, 6], [10.0, 14.0, 30.0]), episode=[0, 0, 1])
    np.testing.assert_array_equal(drive.objects.instant, [0, 1, 2, 6])
    np.testing.assert_allclose(drive.objects.offset_m, [10.0, 12.0, 14.0, 30.0], rtol=1e-12)


def test_an_object_is_interpolated_on_the_road_not_against_the_subject_vehicle():
    # The subject vehicle stops between two samples of an object that drives on evenly.
    subject = subject_table([0.0, 0.5, 1.0], [0.0, 10.0, 10.0])
    drive = even(subject, object_table([0, 2], [20.0, 30.0]))
    np.testing.assert_allclose(drive.objects.offset_m, [20.0, 20.0, 30.0], rtol=1e-12)  # 20, 30 and 40 m on the road


def test_lanes_are_those_of_the_nearest_sample_and_offsets_stay_within_one_lane():
    subject = subject_table([0.2, 0.6, 1.2], [0, 8, 20])
    drive = even(subject, object_table([0, 1, 2], 5.0, row=[0, 1, 1], lateral_m=[1.8, -1.8, -0.6]))
    np.testing.assert_array_equal(drive.objects.row, [1, 1])
    np.testing.assert_allclose(drive.objects.lateral_m, [-1.8, -1.0], rtol=1e-12)


def test_tracks_are_never_mixed():
    subject = subject_table([0.0, 0.2, 0.4, 0.6], [0, 4, 8, 12])
    drive = even(subject, object_table([0, 1, 2, 3], [0.0, 0.0, 50.0, 50.0], track=[0, 0, 1, 1]))
    np.testing.assert_array_equal(drive.objects.instant, [0, 1])
    np.testing.assert_array_equal(drive.objects.track, [0, 1])
    np.testing.assert_array_equal(drive.objects.offset_m, [0.0, 50.0])


def test_two_samples_near_one_instant_give_one_row():
    drive = even(subject_table([0.9, 0.9995, 1.0004, 1.1], [0, 2, 2.02, 4]))
    np.testing.assert_array_equal(drive.subject.time_s, [1.0])
    np.testing.assert_array_equal(drive.subject.position_m, [2.0])


def test_a_value_beside_a_missing_one_stays_where_it_lies_on_the_clock():
    drive = even(subject_table([0.0, 0.5, 0.7], [0, 10, 14], lateral_m=[0.1, 0.2, np.nan]))
    np.testing.assert_array_equal(drive.subject.lateral_m, [0.1, 0.2])


def test_a_drive_between_two_instants_gives_no_frame():
    drive = even(subject_table([0.6, 0.7, 0.8], [0, 2, 4]), object_table([0, 1, 2], 5.0))
    assert len(drive.subject.time_s) == 0
    assert len(drive.objects.instant) == 0


@pytest.mark.parametrize("interval_s", [0.1, 0.5])
def test_instants_are_multiples_of_the_interval(interval_s: float):
    drive = even(subject_table(300.2 + np.arange(100) * 0.1, np.arange(100)), interval_s=interval_s)
    ratio = drive.subject.time_s / interval_s
    np.testing.assert_allclose(ratio, np.round(ratio), atol=1e-6)
    np.testing.assert_allclose(np.diff(drive.subject.time_s), interval_s, atol=1e-9)


@given(
    steps=st.lists(st.floats(0.04, 1.0), min_size=2, max_size=40),
    start=st.floats(0.0, 1000.0),
    speed=st.floats(0.0, 40.0),
    relative=st.floats(-10.0, 10.0),
    interval_s=st.sampled_from([0.1, 0.2, 0.5, 1.0]),
)
@example(steps=[0.999, 1.0], start=0.0, speed=1.0, relative=0.0, interval_s=0.1)  # 1 ms and a rounding error off
def test_a_linear_motion_is_kept_exactly(steps, start, speed, relative, interval_s):
    time_s = start + np.cumsum(steps)
    objects = object_table(np.arange(len(time_s)), 10.0 + relative * (time_s - start), speed_mps=speed + relative)
    drive = even(subject_table(time_s, speed * (time_s - start), speed), objects, interval_s)
    now = drive.subject.time_s
    # A sample within 1 ms of an instant is taken as it is: up to 1 ms of motion.
    np.testing.assert_allclose(drive.subject.position_m, speed * (now - start), atol=1e-3 * speed + 1e-6)
    np.testing.assert_array_equal(np.sort(drive.objects.instant), np.arange(len(now)))
    order = np.argsort(drive.objects.instant)
    expected = 10.0 + relative * (now - start)
    np.testing.assert_allclose(drive.objects.offset_m[order], expected, atol=1e-3 * abs(relative) + 1e-6)
    np.testing.assert_allclose(drive.objects.speed_mps, speed + relative, atol=1e-9)
    assert drive.valid.all()
