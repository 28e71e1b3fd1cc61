"""Eq. 37 by hand, and what chance shows."""

import itertools

import numpy as np
import pytest

from experiments.paper.similarity import (
    chance_at_least,
    chance_similarity,
    pair_shares,
    similarity_index,
    similarity_matrix,
)


def test_by_hand():
    assert similarity_index(["tau", "accel", "minGap", "decel"], ["accel", "tau", "delta", "sigma"]) == 0.5
    assert similarity_index(["tau"], ["tau"]) == 1.0
    assert similarity_index(["tau"], ["delta"]) == 0.0
    sets = [["a", "b"], ["b", "c"], ["c", "d"]]
    np.testing.assert_array_equal(similarity_matrix(sets), [[1, 0.5, 0], [0.5, 1, 0.5], [0, 0.5, 1]])
    assert pair_shares(sets, 0.5) == pytest.approx(2 / 3)
    assert pair_shares(sets[:1], 0.5) is None


def test_sets_of_different_size_are_refused():
    with pytest.raises(ValueError, match="one size"):
        similarity_index(["a"], ["a", "b"])


@pytest.mark.parametrize(("num_critical", "num_parameters"), [(2, 5), (3, 6), (4, 5)])
def test_chance_by_counting_all_sets(num_critical: int, num_parameters: int):
    first = set(range(num_critical))
    others = list(itertools.combinations(range(num_parameters), num_critical))
    found = np.asarray([len(first & set(other)) / num_critical for other in others])
    assert chance_similarity(num_critical, num_parameters) == pytest.approx(found.mean())
    for least in (0.3, 0.5, 1.0):
        expected = np.mean(found >= least - 1e-12)
        assert chance_at_least(least, num_critical, num_parameters) == pytest.approx(expected)


def test_what_the_paper_reports_is_near_chance():
    """Ten of twenty: 98.8 % of random pairs share three or more, 67 % five or more."""
    assert chance_similarity(10, 20) == 0.5
    assert chance_at_least(0.3, 10, 20) == pytest.approx(0.98848, abs=1e-4)
    assert chance_at_least(0.5, 10, 20) == pytest.approx(0.67187, abs=1e-4)
