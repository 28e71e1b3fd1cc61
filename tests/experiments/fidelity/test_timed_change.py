"""Lane changes that take time: one step by step against SUMO."""

import pytest

from experiments.fidelity.timed_change import timed_change_table

MOST_DIFFERENCE_M = 0.01  # in the first step SUMO sees the second leader where it was before


def test_who_changes_and_his_four_neighbours_are_where_sumo_s_are() -> None:
    rows = timed_change_table((0.0, 0.5, 2.0, 3.0))
    assert [row["duration_s"] for row in rows] == [0.0, 0.5, 2.0, 3.0]
    for row in rows:
        assert row["largest_difference_m"] < MOST_DIFFERENCE_M
        assert row["lane_differs_steps"] == 0
    assert rows[-1]["old_lane_until_s"] == pytest.approx(1.5)
