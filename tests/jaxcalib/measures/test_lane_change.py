"""Lane changes, cut-ins and overtaking, worked out by hand.

Row 0 is the right through lane, row 1 the left one, row 2 the auxiliary lane to the right of both.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.measures.measure import Measure, MeasureValue
from sim_adapters.frame_table import ObjectTable, SubjectTable, stack_frames
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], dict[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]


def merge() -> PerceptionFrame:
    """Track 2 comes from the auxiliary lane, 4 from the left; 0 and 1 drive on in row 0, the subject vehicle in 1."""
    return drive(
        instant(
            5.0,
            Car(EGO, 1, 400.0, 20.0),
            Car(0, 0, 440.0, 18.0),
            Car(1, 0, 390.0, 17.0),
            Car(2, 2, 412.0, 16.0),
            Car(4, 1, 460.0, 21.0),
        ),
        instant(
            5.5,
            Car(EGO, 1, 410.0, 20.0),
            Car(0, 0, 449.0, 18.0),
            Car(1, 0, 398.5, 17.0),
            Car(2, 0, 420.0, 16.0),
            Car(4, 0, 470.5, 21.0),
        ),
    )


def test_counts_and_directions(count: Count, measure: MeasureOf):
    tallies = count(merge())
    assert tallies["background_lane_changes"] == 2
    assert tallies["background_lane_changes_left"] == 1  # out of the auxiliary lane, although its row number is higher
    assert measure(merge(), "background_left_share").value == 0.5
    assert tallies["subject_lane_changes"] == 0
    distance_m = 0.5 * (18 + 17 + 16 + 21)
    assert tallies["tracked_distance_m"] == pytest.approx(distance_m)
    per_km = measure(merge(), "background_lane_changes_pkm")
    assert per_km.value == pytest.approx(2000 / distance_m)
    assert per_km.num_observations == 2
    # 4 and 2 are beyond the border of the sections at 400 m; so is everybody but 1
    assert (tallies["section_left[1]"], tallies["section_right[1]"]) == (1, 1)
    assert (tallies["section_left[0]"], tallies["section_right[0]"]) == (0, 0)
    assert tallies["section_distance_m[0]"] == pytest.approx(8.5)


def test_the_target_gap_reaches_from_the_new_leader_s_rear_to_the_new_follower_s_front(
    count: Count, measure: MeasureOf
):
    tallies = count(merge())
    gap = measure(merge(), "background_target_gap_m")
    assert gap.value == pytest.approx((449.0 - 4.5) - 398.5)
    assert (gap.num_observations, gap.num_censored) == (1, 1)  # 4 has nobody ahead in range
    assert tallies["background_target_gap_bin[3]"] == 1  # 40 to 50 m
    assert (tallies["background_lead_gaps"], tallies["background_lag_gaps"]) == (1, 2)
    assert measure(merge(), "background_lead_gap_m").value == pytest.approx(449.0 - 4.5 - 420.0)
    lag_m = (420.0 - 4.5 - 398.5), (470.5 - 4.5 - 449.0)
    assert measure(merge(), "background_lag_gap_m").value == pytest.approx(np.mean(lag_m))


@pytest.mark.parametrize(
    ("leader_m", "follower_m", "is_known"), [(90.0, -50.0, True), (110.0, -50.0, False), (90.0, -70.0, False)]
)
def test_a_gap_longer_than_the_range_is_censored_not_short(
    measure: MeasureOf, leader_m: float, follower_m: float, is_known: bool
):
    """The vehicle beyond the range is there, but the sensors, 100 m ahead and 60 m behind, do not see it."""
    one = np.ones(2)
    subject = SubjectTable(
        np.asarray([1.0, 1.5]), one * 500, one * 15.0, one * 0.0, np.ones(2, int), one * np.nan, one * 2
    )
    row = [0, 0, 1, 0, 0, 0]  # the third line is track 0 before its change, the last one after it
    table = ObjectTable(
        instant=np.asarray([0, 0, 0, 1, 1, 1]),
        track=np.asarray([1, 2, 0, 1, 2, 0]),
        row=np.asarray(row),
        offset_m=np.asarray([leader_m, follower_m, 20.0, leader_m, follower_m, 20.0]),
        speed_mps=np.full(6, 15.0),
        lateral_m=np.full(6, np.nan),
    )
    gap = measure(stack_frames(subject, table, 100.0, 60.0, least_places=8), "background_target_gap_m")
    assert (gap.num_observations, gap.num_censored) == ((1, 0) if is_known else (0, 1))
    assert gap.is_valid == is_known
    if is_known:
        assert gap.value == pytest.approx(90.0 - 4.5 + 50.0)


@pytest.mark.parametrize(
    ("leader_m", "follower_m", "seen_m"),
    [(90.0, -50.0, 135.5), (110.0, -30.0, 125.5), (90.0, -70.0, 145.5), (110.0, -70.0, 155.5), (22.0, 18.0, -0.5)],
)
@pytest.mark.parametrize("own_m", [20.0, 19.0])
def test_a_censored_gap_is_longer_than_what_is_seen_of_it(
    count: Count, measure: MeasureOf, leader_m: float, follower_m: float, seen_m: float, own_m: float
):
    """Sensors see 100 m ahead and 60 m behind: classes of 10 m reach to 50 m, where every gap beside them is seen."""
    one = np.ones(2)
    subject = SubjectTable(
        np.asarray([1.0, 1.5]), one * 500, one * 15.0, one * 0.0, np.ones(2, int), one * np.nan, one * 2
    )
    leader = [leader_m] if leader_m <= 100.0 else []
    follower = [follower_m] if follower_m >= -60.0 else []
    offsets = [*leader, *follower, own_m]
    tracks = [*[1] * len(leader), *[2] * len(follower), 0]
    rows = [*[0] * (len(offsets) - 1), 1, *[0] * len(offsets)]
    table = ObjectTable(
        instant=np.repeat([0, 1], len(offsets)),
        track=np.asarray(tracks * 2),
        row=np.asarray(rows),
        offset_m=np.asarray(offsets * 2),
        speed_mps=np.full(2 * len(offsets), 15.0),
        lateral_m=np.full(2 * len(offsets), np.nan),
    )
    frames = stack_frames(subject, table, 100.0, 60.0, least_places=8)
    tallies = count(frames)
    ended = [tallies[f"background_target_gap_class[{k}]"] for k in range(5)]
    censored = [tallies[f"background_target_gap_class_censored[{k}]"] for k in range(5)]
    is_known = bool(leader and follower)
    assert sum(censored) == 0  # all of them reach the limit
    assert ended == ([1, 0, 0, 0, 0] if seen_m < 0 else [0] * 5)
    restricted = measure(frames, "background_restricted_target_gap_m")
    assert (restricted.num_observations, restricted.num_censored) == (1, 0 if is_known else 1)
    assert restricted.value == pytest.approx(5.0 if seen_m < 0 else 50.0)


def test_a_change_at_the_edge_of_the_range_stays_at_risk_as_far_as_it_is_seen(measure: MeasureOf, count: Count):
    """Nobody is seen behind a vehicle 45 m behind, of 60 m: 15 m and 13.5 m to its leader's rear, 28.5 m at least."""
    frames = drive(
        instant(1.0, Car(EGO, 1, 400.0, 20.0), Car(0, 1, 355.0, 20.0), Car(1, 0, 373.0, 20.0)),
        instant(1.5, Car(EGO, 1, 410.0, 20.0), Car(0, 0, 365.0, 20.0), Car(1, 0, 383.0, 20.0)),
    )
    tallies = count(frames)
    assert [tallies[f"background_target_gap_class_censored[{k}]"] for k in range(5)] == [0, 0, 1, 0, 0]
    assert not any(tallies[f"background_target_gap_class[{k}]"] for k in range(5))
    assert measure(frames, "background_restricted_target_gap_m").value == pytest.approx(50.0)  # nobody's gap has ended


def test_target_gaps_are_averaged_for_each_vehicle_first(measure: MeasureOf, count: Count):
    """Track 2 changes twice (gaps of 60.5 and 20.5 m), track 3 once (47.5 m)."""
    ego, wall = Car(EGO, 2, 400.0, 0.0), (Car(0, 0, 440.0, 0.0), Car(1, 0, 375.0, 0.0), Car(4, 1, 430.0, 0.0))
    behind_left = Car(5, 1, 405.0, 0.0)
    places = [(1, 1), (0, 1), (1, 1), (1, 0)]  # rows of 2 and 3 in each frame
    frames = [
        instant(0.5 * k, ego, *wall, behind_left, Car(2, row_2, 410.0, 0.0), Car(3, row_3, 392.5, 0.0))
        for k, (row_2, row_3) in enumerate(places)
    ]
    gaps_2, gap_3 = (440 - 4.5 - 375, 430 - 4.5 - 405), 440 - 4.5 - 375
    assert measure(drive(*frames), "background_target_gap_m").value == pytest.approx((sum(gaps_2) + gap_3) / 3)
    mean = measure(drive(*frames), "background_mean_target_gap_m")
    assert mean.value == pytest.approx((np.mean(gaps_2) + gap_3) / 2)
    assert mean.num_observations == 2
    tallies = count(drive(*frames))
    assert (tallies["background_lane_changes"], tallies["background_lane_changes_left"]) == (3, 1)


def test_a_vehicle_that_was_out_of_sight_in_between_has_not_changed_lane(count: Count):
    ego = Car(EGO, 0, 300.0, 10.0)
    frames = drive(
        instant(0.0, ego, Car(0, 0, 340.0, 10.0)), instant(0.5, ego), instant(1.0, ego, Car(0, 1, 345.0, 9.0))
    )
    tallies = count(frames)
    assert tallies["background_lane_changes"] == 0
    assert tallies["tracked_distance_m"] == 0
    assert tallies["observed_vehicles"] == 1


def test_the_subject_vehicle_s_own_change(count: Count, measure: MeasureOf):
    ahead, behind = Car(0, 1, 460.0, 20.0), Car(1, 1, 380.0, 20.0)
    frames = drive(
        instant(0.0, Car(EGO, 0, 400.0, 20.0), ahead, behind), instant(0.5, Car(EGO, 1, 410.0, 20.0), ahead, behind)
    )
    tallies = count(frames)
    assert (tallies["subject_lane_changes"], tallies["subject_lane_changes_left"]) == (1, 1)
    assert tallies["background_lane_changes"] == 0
    assert measure(frames, "subject_target_gap_m").value == pytest.approx(460.0 - 4.5 - 380.0)
    assert measure(frames, "subject_lead_gap_m").value == pytest.approx(45.5)
    assert measure(frames, "subject_lag_gap_m").value == pytest.approx(25.5)
    assert measure(frames, "subject_lane_changes_pkm").value == pytest.approx(1000 / 10)
    assert tallies["cut_ins"] == 0


def test_a_cut_in_and_its_gap(count: Count, measure: MeasureOf):
    frames = drive(
        instant(0.0, Car(EGO, 0, 600.0, 20.0), Car(0, 0, 650.0, 19.0), Car(3, 1, 619.0, 18.0), Car(4, 1, 580.0, 17.0)),
        instant(0.5, Car(EGO, 0, 610.0, 20.0), Car(0, 0, 659.5, 19.0), Car(3, 0, 628.0, 18.0), Car(4, 0, 588.0, 17.0)),
    )
    tallies = count(frames)
    assert tallies["background_lane_changes"] == 2
    assert tallies["cut_ins"] == 1  # 3; 4 goes behind the subject vehicle
    assert measure(frames, "cut_in_gap_m").value == pytest.approx(18.0 - 4.5)
    assert measure(frames, "cut_in_speed_difference_mps").value == pytest.approx(2.0)
    assert measure(frames, "cut_ins_per_drive").value == 1
    assert measure(frames, "cut_ins_pkm").value == pytest.approx(1000 / 10)


def test_who_comes_in_ahead_of_the_leader_does_not_cut_in(count: Count):
    before = instant(0.0, Car(EGO, 0, 600.0, 20.0), Car(0, 0, 630.0, 19.0), Car(3, 1, 650.0, 18.0))
    after = instant(0.5, Car(EGO, 0, 610.0, 20.0), Car(0, 0, 639.5, 19.0), Car(3, 0, 659.0, 18.0))
    tallies = count(drive(before, after))
    assert (tallies["background_lane_changes"], tallies["cut_ins"]) == (1, 0)


def test_it_is_no_cut_in_if_the_subject_vehicle_changes_lane_itself(count: Count):
    before = instant(0.0, Car(EGO, 0, 600.0, 20.0), Car(3, 1, 630.0, 18.0))
    stays = instant(0.5, Car(EGO, 1, 610.0, 20.0), Car(3, 1, 639.0, 18.0))
    assert count(drive(before, stays))["cut_ins"] == 0
    # both go to the same lane at once: the leader is new to both
    three_lanes = instant(0.0, Car(EGO, 2, 400.0, 20.0), Car(3, 1, 430.0, 18.0))
    together = instant(0.5, Car(EGO, 0, 410.0, 20.0), Car(3, 0, 439.0, 18.0))
    tallies = count(drive(three_lanes, together))
    assert (tallies["subject_lane_changes"], tallies["background_lane_changes"], tallies["cut_ins"]) == (1, 1, 0)


def test_a_newcomer_that_was_not_seen_before_does_not_cut_in(count: Count):
    ego = Car(EGO, 0, 600.0, 20.0)
    assert count(drive(instant(0.0, ego), instant(0.5, ego, Car(3, 0, 620.0, 18.0))))["cut_ins"] == 0


def test_who_leaves_the_lane_ahead_cuts_out(count: Count):
    ego = Car(EGO, 0, 600.0, 20.0)
    before = instant(0.0, ego, Car(0, 0, 640.0, 19.0), Car(1, 0, 570.0, 19.0))
    after = instant(0.5, ego, Car(0, 1, 640.0, 19.0), Car(1, 1, 570.0, 19.0))
    assert count(drive(before, after))["cut_outs"] == 1  # the one behind does not count
    itself = instant(0.5, replace(ego, row=1), Car(0, 0, 640.0, 19.0), Car(1, 0, 570.0, 19.0))
    assert count(drive(before, itself))["cut_outs"] == 0


def test_overtaking_both_ways(count: Count, measure: MeasureOf):
    """Track 1 passes on the left, 2 on the right, in the auxiliary lane; 3 is passed on its left."""
    frames = drive(
        instant(
            0.0,
            Car(EGO, 0, 400.0, 16.0),
            Car(1, 1, 398.0, 24.0),
            Car(2, 2, 399.5, 18.0),
            Car(3, 1, 403.0, 8.0),
            Car(4, 1, 370.0, 20.0),
        ),
        instant(
            0.5,
            Car(EGO, 0, 408.0, 16.0),
            Car(1, 1, 410.0, 24.0),
            Car(2, 2, 408.5, 18.0),
            Car(3, 1, 407.0, 8.0),
            Car(4, 1, 380.0, 20.0),
        ),
    )
    tallies = count(frames)
    assert (tallies["overtaken"], tallies["overtaken_left"], tallies["overtakes"]) == (2, 1, 1)
    assert measure(frames, "overtaken_left_share").value == 0.5
    assert measure(frames, "overtaken_speed_difference_mps").value == pytest.approx((8 + 2) / 2)
    assert measure(frames, "overtakes_speed_difference_mps").value == pytest.approx(8)
    assert measure(frames, "overtaken_per_drive").value == 2
    assert measure(frames, "overtakes_per_drive").value == 1
    assert tallies["overtaking_lateral"] == 3


def test_who_appears_ahead_has_not_overtaken(count: Count):
    ego = Car(EGO, 0, 600.0, 16.0)
    unseen_between = [
        instant(0.0, ego, Car(1, 1, 590.0, 24.0)),
        instant(0.5, ego),
        instant(1.0, ego, Car(1, 1, 610.0, 24.0)),
    ]
    assert count(drive(*unseen_between))["overtaken"] == 0


def off_centre(rows: list[int], laterals: list[float]) -> PerceptionFrame:
    return drive(
        *(
            instant(0.5 * k, Car(EGO, 0, 500.0 + 5 * k, 10.0), Car(0, row, 540.0 + 5 * k, 10.0, lateral))
            for k, (row, lateral) in enumerate(zip(rows, laterals, strict=True))
        )
    )


def test_a_lane_change_lasts_from_leaving_the_centre_of_the_lane_to_reaching_the_next(measure: MeasureOf, count: Count):
    frames = off_centre([0, 0, 0, 1, 1, 1, 1], [0.1, 0.6, 1.5, -1.6, -0.7, -0.2, 0.0])
    duration = measure(frames, "background_lane_change_duration_s")
    assert (duration.value, duration.num_observations) == (pytest.approx(2.0), 1)
    assert count(frames)["background_lane_changes"] == 1


def test_a_lane_change_that_is_given_up_has_no_duration(measure: MeasureOf):
    given_up = off_centre([0, 0, 0, 0, 0], [0.0, 0.6, 1.1, 0.6, 0.1])
    assert measure(given_up, "background_lane_change_duration_s").reason == "never observed"


def test_a_lane_change_that_is_not_seen_to_its_end_has_no_duration(measure: MeasureOf):
    unfinished = off_centre([0, 0, 0, 1, 1], [0.0, 0.6, 1.1, -1.6, -1.0])
    assert measure(unfinished, "background_lane_change_duration_s").reason == "never observed"


def test_a_change_from_centre_to_centre_was_not_seen_to_take_any_time(measure: MeasureOf, count: Count):
    frames = off_centre([0, 0, 1, 1], [0.0, 0.1, 0.1, 0.0])
    assert count(frames)["background_lane_changes"] == 1
    assert not measure(frames, "background_lane_change_duration_s").is_valid


def test_without_offsets_the_change_counts_but_has_no_duration(measure: MeasureOf, count: Count):
    frames = off_centre([0, 0, 1, 1], [float("nan")] * 4)
    assert count(frames)["background_lane_changes"] == 1
    assert not measure(frames, "background_lane_change_duration_s").is_valid


def test_shares_of_target_gaps_add_up(measures: Mapping[str, Measure], count: Count):
    tallies = count(merge())
    shares = [m.value(tallies).value for name, m in measures.items() if name.startswith("background_target_gap_share_")]
    assert sum(shares) == pytest.approx(1.0)
