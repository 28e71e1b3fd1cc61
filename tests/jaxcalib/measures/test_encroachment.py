"""Post-encroachment times and what follows a cut-in, worked out by hand."""

from collections.abc import Callable, Mapping

import pytest

from jaxcalib.measures.measure import MeasureValue
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], Mapping[str, float]]
MeasureOf = Callable[[PerceptionFrame, str], MeasureValue]
LENGTH_M = 4.5


def change(ahead_m: float, behind_m: float) -> PerceptionFrame:
    """Track 0 moves at 20 m/s into the row of track 1, of 16 m/s, ahead, and of track 2, of 25 m/s, behind."""
    before = (Car(EGO, 2, 400.0, 20.0), Car(0, 0, 400.0, 20.0))
    at_m = 410.0
    return drive(
        instant(1.0, *before, Car(1, 1, at_m + ahead_m + LENGTH_M - 8.0, 16.0),
                Car(2, 1, at_m - behind_m - LENGTH_M - 12.5, 25.0)),
        instant(1.5, Car(EGO, 2, 410.0, 20.0), Car(0, 1, at_m, 20.0), Car(1, 1, at_m + ahead_m + LENGTH_M, 16.0),
                Car(2, 1, at_m - behind_m - LENGTH_M, 25.0)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("ahead_m", "behind_m", "conflicts"), [(30.0, 30.0, 0.0), (18.0, 40.0, 1.0), (30.0, 24.0, 1.0)]
)
def test_the_nearer_neighbour_in_time_tells_the_encroachment(
    measure: MeasureOf, ahead_m: float, behind_m: float, conflicts: float
):
    """To the leader at one's own speed, from the follower at its speed: 18 / 20 and 24 / 25 are below 1 s."""
    found = measure(change(ahead_m, behind_m), "lane_change_conflict_share")
    assert (found.value, found.num_observations) == (conflicts, 1.0)


def test_its_percentile_lies_in_its_class(measure: MeasureOf):
    # 18 / 20 s in the class from 0.75 to 1 s: 15 % of the way through it
    assert measure(change(18.0, 40.0), "lane_change_pet_p15_s").value == pytest.approx(0.75 + 0.15 * 0.25)


@pytest.mark.parametrize(
    ("offset_m", "is_seen"), [(0.0, True), (74.0, True), (77.0, False), (-34.0, True), (-37.0, False)]
)
def test_a_change_with_nobody_in_range_is_none_if_a_conflict_would_be_seen(
    count: Count, offset_m: float, is_seen: bool
):
    """A second at 20 m/s and a vehicle's length reach 24.5 m; sensors reach 100 m ahead and 60 m behind."""
    frames = drive(
        instant(1.0, Car(EGO, 2, 400.0, 20.0), Car(0, 0, 400.0 + offset_m, 20.0)),
        instant(1.5, Car(EGO, 2, 410.0, 20.0), Car(0, 1, 410.0 + offset_m, 20.0)),
    )
    counted = count(frames)
    assert (counted["encroaching_changes"], counted["close_changes"]) == (float(is_seen), 0.0)


@pytest.mark.parametrize("gap_m", [6.0, 60.0])
def test_near_the_edge_of_the_range_a_change_is_left_out_whatever_is_seen_of_it(count: Count, gap_m: float):
    """Conflicts alone would be left, were those kept in which somebody is near."""
    frames = drive(
        instant(1.0, Car(EGO, 2, 400.0, 20.0), Car(0, 0, 360.0, 20.0), Car(1, 1, 360.0 + gap_m + LENGTH_M, 20.0)),
        instant(1.5, Car(EGO, 2, 410.0, 20.0), Car(0, 1, 370.0, 20.0), Car(1, 1, 370.0 + gap_m + LENGTH_M, 20.0)),
    )
    assert count(frames)["encroaching_changes"] == 0.0


def cut_in(speeds_mps: list[float], moves: bool = False) -> PerceptionFrame:
    """Track 0 cuts in before the subject vehicle in the second frame; the subject vehicle's speeds from then on."""
    frames = [
        instant(1.0, Car(EGO, 1, 400.0, speeds_mps[0]), Car(0, 0, 430.0, 20.0)),
        *(
            instant(
                1.5 + 0.5 * number,
                Car(EGO, 2 if moves and number > 2 else 1, 410.0 + 10.0 * number, speed),
                Car(0, 1, 440.0 + 10.0 * number, 20.0),
            )
            for number, speed in enumerate(speeds_mps)
        ),
    ]
    return drive(*frames)


def test_what_follows_a_cut_in_counts_for_three_seconds(measure: MeasureOf, count: Count):
    # 3.2 m/s^2 in the first step after it, then 1 m/s^2; what is later than 3 s does not count
    speeds = [24.0, 22.4, 21.9, 21.4, 20.9, 20.4, 19.9, 10.0, 5.0]
    frames = cut_in(speeds)
    counted = count(frames)
    assert counted["after_cut_in_s"] == 3.0
    assert counted["after_cut_in_speed_loss_mps"] == pytest.approx(24.0 - 19.9, rel=1e-5)
    assert measure(frames, "after_cut_in_deceleration_mps2").value == pytest.approx(4.1 / 3.0, rel=1e-5)
    assert measure(frames, "after_cut_in_hard_braking_share").value == pytest.approx(0.5 / 3.0)
    assert measure(frames, "after_cut_in_deceleration_mps2").num_observations == 1.0


def test_nothing_counts_without_a_cut_in_or_once_the_subject_vehicle_moves_away(count: Count):
    quiet = drive(*(instant(1.0 + 0.5 * k, Car(EGO, 1, 400.0 + k, 20.0 - k), Car(0, 1, 430.0, 20.0)) for k in range(4)))
    assert count(quiet)["after_cut_in_s"] == 0.0
    leaves = count(cut_in([24.0, 23.0, 22.0, 21.0, 20.0], moves=True))
    assert leaves["after_cut_in_s"] == 1.5  # but for the frame in which it changes lane itself
