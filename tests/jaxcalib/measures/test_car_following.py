"""Headways, gaps, spacing and episodes of following, worked out by hand."""

from collections.abc import Callable

import numpy as np
import pytest

from jaxcalib.measures.car_following import HEADWAY_BORDER_S
from jaxcalib.measures.measure import MeasureValue
from sim_adapters.frame_table import ObjectTable, SubjectTable, stack_frames
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], dict[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]

LENGTH_M = 4.5


def two_rows(time_s: float = 10.0) -> PerceptionFrame:
    """Track 3 leads the subject vehicle, 5 follows it; beside them 0 follows 1."""
    return instant(
        time_s,
        Car(5, 0, 476.0, 12.0),
        Car(EGO, 0, 500.0, 20.0),
        Car(3, 0, 530.0, 16.0),
        Car(0, 1, 470.0, 24.0),
        Car(1, 1, 545.0, 25.0),
    )


def test_a_time_headway_is_front_to_front_and_a_time_gap_rear_to_front(measure: MeasureOf):
    frames = drive(two_rows())
    assert measure(frames, "subject_time_headway_s").value == pytest.approx(30 / 20)
    assert measure(frames, "subject_time_gap_s").value == pytest.approx((30 - LENGTH_M) / 20)
    assert measure(frames, "subject_spacing_m").value == pytest.approx(30)
    assert measure(frames, "background_time_headway_s").value == pytest.approx((24 / 12 + 75 / 24) / 2)
    gap_s = (24 - LENGTH_M) / 12, (75 - LENGTH_M) / 24
    assert measure(frames, "background_time_gap_s").value == pytest.approx(np.mean(gap_s))
    assert measure(frames, "background_following_speed_mps").value == pytest.approx(18)


def test_a_vehicle_without_a_leader_in_range_is_censored(measure: MeasureOf):
    headway = measure(drive(two_rows()), "background_time_headway_s")
    assert (headway.num_observations, headway.num_censored) == (2, 2)  # 3 and 1 are the first of their rows
    assert measure(drive(two_rows()), "background_following_share").value == pytest.approx(
        2 / 4
    )  # the subject vehicle is none


def test_a_leader_beyond_the_range_makes_no_headway(count: Count, measure: MeasureOf):
    """At 95 m the leader of the subject vehicle's leader is seen, at 105 m it is not: its headway is censored."""

    def frames(leader_m: float, ahead_m: float) -> PerceptionFrame:
        one, nan = np.ones(1), np.full(1, np.nan)
        subject = SubjectTable(one * 7.0, one * 500.0, one * 20.0, one * 0.0, np.zeros(1, int), nan, one * 2)
        two = np.ones(2)
        offset_m, speed = np.asarray([leader_m, 40.0]), np.asarray([15.0, 16.0])
        table = ObjectTable(np.zeros(2, int), np.asarray([1, 0]), np.zeros(2, int), offset_m, speed, two * np.nan)
        return stack_frames(subject, table, ahead_m, 60.0, least_places=8)

    near, far = frames(95.0, 100.0), frames(105.0, 100.0)
    assert measure(near, "background_time_headway_s").value == pytest.approx(55 / 16)
    assert measure(near, "background_time_headway_s").num_censored == 1
    value = measure(far, "background_time_headway_s")
    assert (value.num_observations, value.num_censored, value.is_valid) == (0, 1, False)
    assert measure(frames(105.0, 110.0), "background_time_headway_s").value == pytest.approx(65 / 16)
    # 60 m are seen ahead of it, less than the 6 s * 16 m/s of a free vehicle: nothing is known of its headway
    assert count(far)["free_vehicles"] == 0


def test_a_leader_further_away_than_the_longest_headway_is_not_followed(count: Count):
    tallies = count(drive(instant(0.0, Car(EGO, 0, 100.0, 20.0), Car(0, 1, 50.0, 10.0), Car(1, 1, 111.0, 12.0))))
    assert tallies["background_following_frames"] == 0  # 6.1 s
    assert tallies["background_headways_censored"] == 2
    assert tallies["free_vehicles"] == 2  # 0 is known to be free; 1 sees 89 m, more than 6 s * 12 m/s
    assert tallies["free_speed"] == 22
    assert tallies["subject_headways_censored"] == 1


def test_below_the_least_speed_there_is_no_headway(count: Count):
    tallies = count(drive(instant(0.0, Car(EGO, 0, 100.0, 1.9), Car(0, 0, 105.0, 5.0), Car(1, 0, 92.0, 2.1))))
    assert tallies["subject_following_frames"] == 0
    assert tallies["background_following_frames"] == 1
    assert tallies["background_headway_s"] == pytest.approx(8 / 2.1)
    assert tallies["free_vehicles"] == 1  # the first; nobody is free who hardly moves


def three_frames() -> PerceptionFrame:
    """Track 5 follows the subject vehicle for three frames; 0 follows 1 in the first, then 1 is out of sight."""
    return drive(
        two_rows(10.0),
        instant(10.5, Car(5, 0, 482.0, 12.5), Car(EGO, 0, 510.0, 20.0), Car(3, 0, 538.0, 16.0), Car(0, 1, 482.0, 24.0)),
        instant(11.0, Car(5, 0, 488.0, 13.0), Car(EGO, 0, 520.0, 19.0), Car(3, 0, 546.0, 15.5), Car(0, 1, 494.0, 24.0)),
    )


def test_means_are_taken_for_each_vehicle_first(measure: MeasureOf):
    of_5, of_0 = np.mean([24 / 12, 28 / 12.5, 32 / 13]), 75 / 24
    mean = measure(three_frames(), "background_mean_time_headway_s")
    assert mean.value == pytest.approx((of_5 + of_0) / 2)
    assert mean.num_observations == 2
    assert measure(three_frames(), "background_time_headway_s").value == pytest.approx((3 * of_5 + of_0) / 4)
    gap_of_5 = np.mean([19.5 / 12, 23.5 / 12.5, 27.5 / 13])
    expected = (gap_of_5 + 70.5 / 24) / 2
    assert measure(three_frames(), "background_mean_time_gap_s").value == pytest.approx(expected)


def test_deviation_and_bins_are_those_of_numpy(count: Count, measure: MeasureOf):
    headways = [24 / 12, 28 / 12.5, 32 / 13, 75 / 24]
    deviation = measure(three_frames(), "background_time_headway_deviation_s")
    assert deviation.value == pytest.approx(np.std(headways, ddof=1), rel=1e-4)
    tallies = count(three_frames())
    bins = [tallies[f"background_headway_bin[{k}]"] for k in range(len(HEADWAY_BORDER_S) - 1)]
    assert bins == np.histogram(headways, HEADWAY_BORDER_S)[0].tolist()


def test_following_lasts_as_long_as_it_is_seen(count: Count, measure: MeasureOf):
    tallies = count(three_frames())
    assert tallies["background_following_episodes"] == 2  # that of 0 lasts one frame: no time, no distance
    assert tallies["background_following_time_s"] == pytest.approx(1.0)
    assert tallies["background_following_distance_m"] == pytest.approx(0.5 * 12.5 + 0.5 * 13.0)
    assert measure(three_frames(), "background_following_duration_s").value == pytest.approx(0.5)
    assert tallies["subject_following_episodes"] == 1
    assert tallies["subject_following_distance_m"] == pytest.approx(0.5 * (20 + 19))


def test_following_that_is_interrupted_is_two_episodes(count: Count):
    ego, leader = Car(EGO, 0, 500.0, 10.0), Car(4, 0, 530.0, 10.0)
    alone, followed = (ego,), (ego, leader)
    frames = [instant(0.5 * k, *cars) for k, cars in enumerate([followed, followed, alone, followed, followed])]
    tallies = count(drive(*frames))
    assert tallies["subject_following_episodes"] == 2
    assert tallies["subject_following_time_s"] == pytest.approx(1.0)
    assert tallies["subject_headways_censored"] == 1


def test_time_gaps_are_kept_by_speed(measure: MeasureOf):
    assert measure(drive(two_rows()), "background_time_gap_above_12_mps_s").value == pytest.approx(19.5 / 12)
    assert measure(drive(two_rows()), "background_time_gap_above_24_mps_s").value == pytest.approx(70.5 / 24)
    assert not measure(drive(two_rows()), "background_time_gap_above_28_mps_s").is_valid
    fast = instant(0.0, Car(EGO, 0, 100.0, 20.0), Car(0, 1, 90.0, 34.0), Car(1, 1, 158.0, 30.0))
    assert measure(drive(fast), "background_time_gap_above_28_mps_s").value == pytest.approx(63.5 / 34)


def test_acceleration_is_the_change_of_speed_between_frames(count: Count, measure: MeasureOf):
    tallies = count(three_frames())
    assert tallies["acceleration_frames"] == 6  # 1 is seen once; 5, 3 and 0 have two changes each
    # 5 gains 0.5 m/s twice, 3 keeps its speed and then loses 0.5 m/s, 0 keeps its speed
    assert tallies["acceleration_squared"] == pytest.approx(3 * (0.5 / 0.5) ** 2)
    assert measure(three_frames(), "acceleration_square_m2ps4").value == pytest.approx(0.5)
