"""The jackknife against closed forms."""

import numpy as np
import pytest

from jaxcalib.statistics.jackknife import jackknife

RUNS = np.asarray([[3.0, 1.0], [8.0, 2.5], [1.0, 0.5], [13.0, 3.0]])


def test_of_a_mean_it_is_the_standard_error() -> None:
    runs = np.column_stack([RUNS[:, 0], np.ones(len(RUNS))])
    value, error = jackknife(runs, lambda tally: tally[:1] / tally[1:])
    assert value[0] == pytest.approx(runs[:, 0].mean())
    assert error[0] == pytest.approx(runs[:, 0].std(ddof=1) / np.sqrt(len(runs)))


def test_of_a_quotient_it_is_near_the_delta_method() -> None:
    random = np.random.default_rng(3)
    below = random.uniform(20.0, 30.0, 400)
    above = 1.7 * below + random.normal(0.0, 2.0, 400)
    value, error = jackknife(np.column_stack([above, below]), lambda tally: tally[:1] / tally[1:])
    influence = (above - value * below) / below.mean()
    assert error[0] == pytest.approx(influence.std(ddof=1) / np.sqrt(400), rel=0.02)


def test_one_run_says_nothing_of_its_error() -> None:
    value, error = jackknife(RUNS[:1], lambda tally: tally)
    np.testing.assert_array_equal(value, RUNS[0])
    assert np.isnan(error).all()
