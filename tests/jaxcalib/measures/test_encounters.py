"""Encounters of the subject vehicle, one by one."""

from collections.abc import Callable, Mapping

import pytest

from jaxcalib.measures.encounters import KINDS, SEVERITIES, encounter_tally
from surrogate.road.perception import PerceptionFrame
from tests.jaxcalib.measures.hand_made import EGO, Car, drive, instant

Count = Callable[[PerceptionFrame], Mapping[str, float]]
LENGTH_M = 4.5


def encounters(counted: Mapping[str, float]) -> dict[str, list[float]]:
    """Counts by kind, from mild to severe; kinds that were not met are left out."""
    by_kind = {kind: [counted[encounter_tally(kind, severity)] for severity in SEVERITIES] for kind in KINDS}
    return {kind: counts for kind, counts in by_kind.items() if any(counts)}


def subject(step: int, speed_mps: float = 20.0) -> Car:
    return Car(EGO, 1, 400.0 + 10.0 * step, speed_mps)


@pytest.mark.parametrize(("gap_m", "severity"), [(41.0, 0), (39.0, 1), (19.0, 2)])
def test_a_cut_in_is_as_severe_as_the_time_gap_that_it_leaves(count: Count, gap_m: float, severity: int):
    at_m = 410.0 + gap_m + LENGTH_M
    frames = drive(
        instant(1.0, subject(0), Car(0, 0, at_m - 9.0, 18.0)), instant(1.5, subject(1), Car(0, 1, at_m, 18.0))
    )
    assert encounters(count(frames)) == {"cut_in": [float(severity == k) for k in range(3)]}


def test_only_the_leader_cuts_out_and_what_it_shows_tells_how_severely(count: Count):
    behind_it = Car(1, 1, 445.0, 12.0), Car(1, 1, 451.0, 12.0)  # 36.5 m less than 2 s ahead
    leaves = drive(
        instant(1.0, subject(0), Car(0, 1, 420.0, 20.0), behind_it[0]),
        instant(1.5, subject(1), Car(0, 2, 430.0, 20.0), behind_it[1]),
    )
    assert encounters(count(leaves)) == {"cut_out": [0.0, 1.0, 0.0]}
    shows_nobody = drive(
        instant(1.0, subject(0), Car(0, 1, 420.0, 20.0)), instant(1.5, subject(1), Car(0, 2, 430.0, 20.0))
    )
    assert encounters(count(shows_nobody)) == {"cut_out": [1.0, 0.0, 0.0]}
    other_leaves = drive(
        instant(1.0, subject(0), Car(0, 1, 420.0, 20.0), behind_it[0]),
        instant(1.5, subject(1), Car(0, 1, 430.0, 20.0), Car(1, 2, 451.0, 12.0)),
    )
    assert encounters(count(other_leaves)) == {}


@pytest.mark.parametrize(
    ("speeds_mps", "counts"),
    [
        ((20.0, 19.6, 19.2, 18.8), None),  # 0.8 m/s^2
        ((20.0, 19.3, 18.6, 18.6), [1.0, 0.0, 0.0]),
        ((20.0, 19.3, 18.0, 17.4), [0.0, 1.0, 0.0]),  # 1.4, then 2.6 m/s^2, then less: one event
        ((20.0, 18.0, 18.0, 17.3), [1.0, 0.0, 1.0]),  # 4 m/s^2, none, 1.4 m/s^2: two events
    ],
)
def test_braking_is_one_event_of_its_hardest_moment(
    count: Count, speeds_mps: tuple[float, ...], counts: list[float] | None
):
    frames = drive(
        *(
            instant(1.0 + 0.5 * k, subject(k), Car(0, 1, 440.0 + 9.5 * k, speed), Car(1, 1, 480.0 + 9.0 * k, 9.0 - k))
            for k, speed in enumerate(speeds_mps)
        )
    )
    assert encounters(count(frames)) == ({} if counts is None else {"braking_leader": counts})


def test_who_joins_behind_counts_by_its_gap_and_who_follows_already_does_not(count: Count):
    follows = Car(1, 1, 380.0, 20.0), Car(1, 1, 390.0, 20.0)
    joins = drive(
        instant(1.0, subject(0), Car(0, 2, 380.0, 20.0)), instant(1.5, subject(1), Car(0, 1, 390.0, 20.0))
    )  # 15.5 m
    assert encounters(count(joins)) == {"joining_follower": [0.0, 0.0, 1.0]}
    there = drive(instant(1.0, subject(0), follows[0]), instant(1.5, subject(1), follows[1]))
    assert encounters(count(there)) == {}


def test_a_subject_vehicle_that_changes_lane_itself_meets_nobody(count: Count):
    frames = drive(
        instant(1.0, subject(0), Car(0, 2, 430.0, 20.0), Car(1, 2, 380.0, 20.0)),
        instant(1.5, Car(EGO, 2, 410.0, 20.0), Car(0, 2, 440.0, 18.0), Car(1, 2, 390.0, 20.0)),
    )
    assert encounters(count(frames)) == {}
