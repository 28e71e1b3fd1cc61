"""Intervals of the bootstrap and of the normal distribution."""

import math

import numpy as np
import pytest

from jaxcalib.statistics.bootstrap import percentile_interval
from jaxcalib.statistics.normal import HALF_WIDTH_90


def test_ninety_percent_of_a_normal_distribution_lie_within() -> None:
    assert math.erf(HALF_WIDTH_90 / math.sqrt(2.0)) == pytest.approx(0.9, rel=1e-12)


def test_the_interval_of_a_mean_is_that_of_the_normal_distribution() -> None:
    values = np.random.default_rng(3).normal(2.7, 0.8, 400)
    found = percentile_interval(
        lambda drawn: float(values[drawn].mean()), 400, np.random.default_rng(5), 4000, (0.05, 0.95)
    )
    half = HALF_WIDTH_90 * values.std() / np.sqrt(400)
    # an end from 4000 draws errs by about sqrt(0.05 * 0.95 / 4000) / 0.103 = 0.033 standard deviations: 4 of those
    assert found == pytest.approx((values.mean() - half, values.mean() + half), abs=4 * 0.033 * half / HALF_WIDTH_90)


def test_draws_without_a_statistic_do_not_count() -> None:
    found = percentile_interval(lambda drawn: None if (drawn == 0).any() else 3.5, 5, np.random.default_rng(1), 200)
    assert found == (3.5, 3.5)
    assert percentile_interval(lambda drawn: None, 5, np.random.default_rng(1), 20) is None


def test_infinite_statistics_have_ends_if_the_nearest_draw_counts() -> None:
    values = np.asarray([1.0, 2.0, np.inf])
    low, high = percentile_interval(
        lambda drawn: float(values[drawn].max()), 3, np.random.default_rng(2), 500, method="nearest"
    ) or (0.0, 0.0)
    assert (low, high) == (1.0, np.inf)  # all draws are the first one in 1 of 27: more than 2.5 %
