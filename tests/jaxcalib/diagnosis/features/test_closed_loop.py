"""Features of traffic against what was planted: speeds, time gaps, lane changes, cut-ins, standing vehicles."""

import numpy as np
import pytest

from jaxcalib.diagnosis.features.closed_loop import CHANNEL, count_closed_loop
from jaxcalib.diagnosis.features.features import Cell, TallyBook
from tests.jaxcalib.diagnosis.features.planted_traffic import (
    INTERVAL_S,
    LEFT,
    LENGTH_M,
    RIGHT,
    SUBJECT,
    Motion,
    steady,
    table_of,
    tallies,
    value,
)  # fmt: skip
from tests.jaxcalib.diagnosis.synthetic import ROAD

NUM = 81  # 40 s
FAST_MPS, SLOW_MPS = 20.0, 10.0  # of a limit of 25 m/s: dense, and slow
TIME_GAP_S, SUBJECT_GAP_S = 1.4, 2.5


def counted(*motions: Motion) -> TallyBook:
    book = TallyBook()
    count_closed_loop(table_of(motions), ROAD, book)
    return book


def traffic(change_at: int | None = None) -> list[Motion]:
    """Return a fast pair in the left lane and, in the right one, a slow vehicle behind the subject vehicle.

    The follower of the pair moves to the right lane at an instant, far ahead of the subject vehicle.
    """
    gap_m = TIME_GAP_S * FAST_MPS + LENGTH_M
    rows = np.where(np.arange(NUM) < (NUM if change_at is None else change_at), LEFT, RIGHT)
    return [
        steady(1, LEFT, 700.0, FAST_MPS, NUM),
        steady(2, rows, 700.0 - gap_m, FAST_MPS, NUM),
        steady(SUBJECT, RIGHT, 500.0, SLOW_MPS, NUM),
        steady(3, RIGHT, 500.0 - SUBJECT_GAP_S * SLOW_MPS - LENGTH_M, SLOW_MPS, NUM),
    ]


def test_speeds_are_means_over_the_background_in_all_in_each_lane_and_where_it_is() -> None:
    book = counted(*traffic())
    assert value(book, Cell(CHANNEL, "speed_mps", lane=1)) == pytest.approx(FAST_MPS)  # 1 is the leftmost
    assert value(book, Cell(CHANNEL, "speed_mps", lane=2)) == pytest.approx(SLOW_MPS)
    assert value(book, Cell(CHANNEL, "speed_mps", role="subject")) == pytest.approx(SLOW_MPS)
    # the pair is between 1000 and 1200 m; the slow ones never come so far
    assert value(book, Cell(CHANNEL, "speed_mps").within(1000.0, 1200.0)) == pytest.approx(FAST_MPS)
    # between 600 and 800 m both are at times, and each half second is a row
    within = [np.sum((one.position_m >= 600.0) & (one.position_m < 800.0)) for one in traffic()]
    slow_rows, fast_rows = within[3], within[0] + within[1]
    expected = (slow_rows * SLOW_MPS + fast_rows * FAST_MPS) / (slow_rows + fast_rows)
    assert value(book, Cell(CHANNEL, "speed_mps").within(600.0, 800.0)) == pytest.approx(expected)


def test_shares_of_regimes_are_those_of_speed_over_limit() -> None:
    book = counted(*traffic())
    shares = {name: value(book, Cell(CHANNEL, "share", name)) for name in ("jam", "slow", "dense", "free flow")}
    assert shares == pytest.approx({"jam": 0.0, "slow": 1 / 3, "dense": 2 / 3, "free flow": 0.0})


def test_time_gaps_are_bumper_to_bumper_over_the_follower_s_speed() -> None:
    book = counted(*traffic())
    assert value(book, Cell(CHANNEL, "time_gap_s", "following", lane=1)) == pytest.approx(TIME_GAP_S)
    assert value(book, Cell(CHANNEL, "time_gap_s", "following", lane=2)) == pytest.approx(SUBJECT_GAP_S)
    # of the pair, the one ahead has nobody within the range of the sensors, and a gap that nobody knows
    for border, share in ((1.2, 0.0), (1.6, 1.0)):
        cell = Cell(CHANNEL, f"time_gap_share_below_{border:g}_s", "dense")
        above, below = tallies(book, cell)
        assert above == pytest.approx(share * NUM)
        assert below >= NUM
    assert value(book, Cell(CHANNEL, "time_gap_share_below_2.2_s", "slow")) == 0.0
    assert value(book, Cell(CHANNEL, "time_gap_share_below_3.5_s", "slow")) == 1.0


def test_lane_changes_count_per_kilometre_that_the_background_drove() -> None:
    book = counted(*traffic(change_at=30))
    km = (2 * FAST_MPS + SLOW_MPS) * INTERVAL_S * (NUM - 1) / 1000.0
    assert value(book, Cell(CHANNEL, "lane_changes_pkm", "to the right")) == pytest.approx(1.0 / km)
    assert value(book, Cell(CHANNEL, "lane_changes_pkm", "to the left")) == 0.0
    assert value(book, Cell(CHANNEL, "lane_changes", role="subject")) == 0.0


def test_gaps_are_those_that_whoever_changes_lane_accepts() -> None:
    """Between the subject vehicle, 22 m behind him then, and another 35 m ahead."""
    behind_m = 22.0
    rows = np.where(np.arange(NUM) < 40, LEFT, RIGHT)
    newcomer = steady(5, rows, 500.0 + LENGTH_M + behind_m, SLOW_MPS, NUM)
    ahead = steady(6, RIGHT, newcomer.position_m[0] + 35.0 + LENGTH_M, SLOW_MPS, NUM)
    book = counted(steady(SUBJECT, RIGHT, 500.0, SLOW_MPS, NUM), newcomer, ahead)
    assert value(book, Cell(CHANNEL, "accepted_gap_behind_m")) == pytest.approx(behind_m)
    assert value(book, Cell(CHANNEL, "accepted_gap_behind_share_below_10_m")) == 0.0
    assert value(book, Cell(CHANNEL, "accepted_gap_ahead_m")) == pytest.approx(35.0)
    assert value(book, Cell(CHANNEL, "cut_ins", role="subject")) == 1.0


def test_lane_shares_are_those_of_vehicles_well_within_range() -> None:
    near = [steady(1, LEFT, 540.0, SLOW_MPS, NUM), steady(2, LEFT, 450.0, SLOW_MPS, NUM)]
    near += [steady(3, RIGHT, 560.0, SLOW_MPS, NUM), steady(SUBJECT, RIGHT, 500.0, SLOW_MPS, NUM)]
    far = steady(4, RIGHT, 500.0 + ROAD.log.behind_m - 29.0, SLOW_MPS, NUM)  # the shorter range less 30 m
    book = counted(*near, far)
    assert value(book, Cell(CHANNEL, "lane_share", lane=1)) == pytest.approx(2 / 3)
    assert value(book, Cell(CHANNEL, "lane_share", lane=2)) == pytest.approx(1 / 3)
    assert value(book, Cell(CHANNEL, "vehicles_near")) == pytest.approx(3.0)


def test_who_stands_without_a_leader_beside_traffic_that_flows_is_told_from_who_queues() -> None:
    flowing = [steady(SUBJECT, LEFT, 500.0, SLOW_MPS, NUM), steady(1, LEFT, 560.0, SLOW_MPS, NUM)]
    blocking, queueing = steady(2, RIGHT, 700.0, 0.0, NUM), steady(3, RIGHT, 692.0, 0.0, NUM)
    book = counted(*flowing, blocking, queueing)
    assert value(book, Cell(CHANNEL, "standing_without_leader_share")) == pytest.approx(1 / 3)  # of three humans
    assert value(book, Cell(CHANNEL, "standing_gap_m")) == pytest.approx(8.0 - LENGTH_M)
    alone = counted(steady(SUBJECT, LEFT, 500.0, 0.0, NUM), blocking, queueing)
    assert value(alone, Cell(CHANNEL, "standing_without_leader_share")) == 0.0  # where nothing flows, it is a jam
