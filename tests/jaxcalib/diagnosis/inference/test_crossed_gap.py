"""How much of a gap is closed, on made-up drives of which everything is known."""

import numpy as np
import pytest

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.inference.crossed_gap import LEAST_FRACTION, Closed, fraction_closed, ratio_interval
from jaxcalib.diagnosis.inference.shrinkage import Gap
from tests.jaxcalib.diagnosis.synthetic import made_up_null

NULL = made_up_null(num_features=80)
SIZE = len(NULL.cells)
ROOT = np.linalg.cholesky(NULL.noise)
EFFECT = ROOT @ (0.7 * np.random.default_rng(1).standard_normal(SIZE))
NOTHING = np.zeros(SIZE)
NUM_HELD_OUT, NUM_FIT = 4, 8


def drives(number: int, random: np.random.Generator, shift: np.ndarray, jams: float) -> DriveTallies:
    """Return drives; some are in a jam, and scatter farther."""
    loud = np.where(random.random(number) < jams, 3.0, 1.0)
    noise = np.sqrt(NUM_HELD_OUT) * loud[:, None] * random.standard_normal((number, SIZE)) @ ROOT.T
    above = NULL.mean + NULL.deviation * (shift + noise)
    return DriveTallies(NULL.cells, above, np.ones_like(above), np.zeros(number))


def told(
    seed: int, share: float, jams: float = 0.0, effect: np.ndarray = EFFECT, num_held_out: int = NUM_HELD_OUT
) -> Closed:
    random = np.random.default_rng(seed)
    one, other = (drives(number, random, effect, jams) for number in (num_held_out, NUM_FIT))
    return fraction_closed(one, other, NULL, Gap.of(NULL).directions, (NOTHING, share * effect), (0.0, 0.0))


@pytest.mark.parametrize("jams", [0.0, 0.2])
@pytest.mark.parametrize(("share", "closed"), [(1.0, 1.0), (0.5, 0.75), (0.0, 0.0)])
def test_nine_in_ten_intervals_hold_the_fraction(share: float, closed: float, jams: float):
    several = [told(seed, share, jams) for seed in range(200)]
    held = [one.interval_90 is not None and one.interval_90[0] - 1e-9 <= closed <= one.interval_90[1] + 1e-9
            for one in several]  # fmt: skip
    assert np.mean(held) >= 0.85
    fractions = [one.fraction for one in several if one.fraction is not None]
    assert np.median(fractions) == pytest.approx(closed, abs=0.1)


def test_a_fit_to_one_of_the_sets_leaves_the_gap_as_it_is():
    """Least squares of a few parameters, in the directions that the gap is measured in."""
    slopes, found = ROOT @ np.random.default_rng(2).standard_normal((SIZE, 12)), []
    whitened = np.linalg.solve(ROOT, slopes)
    for seed in range(300):
        random = np.random.default_rng(seed)
        one, other = (drives(number, random, EFFECT, 0.0) for number in (NUM_HELD_OUT, NUM_FIT))
        rest = np.linalg.solve(ROOT, NULL.standardised(other.values()))
        fitted = slopes @ np.linalg.lstsq(whitened, rest, rcond=None)[0]
        held = np.linalg.solve(ROOT, NULL.standardised(one.values()) - fitted)
        found.append([np.mean(held * np.linalg.solve(ROOT, NULL.standardised(other.values()) - fitted))])
    middle = np.linalg.solve(ROOT, EFFECT)
    truth = middle - whitened @ np.linalg.lstsq(whitened, middle, rcond=None)[0]
    assert np.mean(found) == pytest.approx(np.mean(truth**2), abs=4.0 * np.std(found) / np.sqrt(300))


def test_where_the_gap_may_be_nothing_the_fraction_may_be_anything():
    few = [told(seed, 0.5, effect=0.05 * EFFECT) for seed in range(40)]
    assert any(one.fraction is None and one.interval_90 is None for one in few)
    wide = [one.interval_90 for one in few if one.interval_90 is not None]
    assert np.mean([bounds == (LEAST_FRACTION, 1.0) for bounds in wide]) > 0.7


def test_a_single_drive_tells_no_interval():
    one = told(3, 0.5, num_held_out=1)
    assert one.fraction is not None
    assert one.interval_90 is None


def test_the_error_of_the_means_is_taken_off():
    random = np.random.default_rng(5)
    one, other = (drives(number, random, EFFECT, 0.0) for number in (NUM_HELD_OUT, NUM_FIT))
    directions, shifts = Gap.of(NULL).directions, (NOTHING, 0.2 * EFFECT)
    gap, left = np.mean([
        directions(NULL.standardised(one.values()) - shift) * directions(NULL.standardised(other.values()) - shift)
        for shift in shifts
    ], axis=1)  # fmt: skip
    found = fraction_closed(one, other, NULL, directions, shifts, (0.1, 0.02))
    assert found.fraction == pytest.approx(1.0 - (left - 0.02) / (gap - 0.1), rel=1e-9)


def test_the_interval_of_a_ratio_is_fieller_s():
    covariance = np.asarray([[0.04, 0.01], [0.01, 0.09]])
    low, high = ratio_interval(1.0, 2.0, covariance, 1.645)
    for ratio in (low, high):  # where the numerator less the ratio times the denominator is so many errors from 0
        error = np.sqrt(0.09 - 2.0 * ratio * 0.01 + ratio**2 * 0.04)
        assert abs(1.0 - 2.0 * ratio) == pytest.approx(1.645 * error)
    assert low < 0.5 < high
    assert ratio_interval(1.0, 0.1, covariance, 1.645) == (-np.inf, np.inf)
