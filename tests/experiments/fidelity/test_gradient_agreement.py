"""Comparison of derivatives with differences, on tallies whose answers are known."""

import numpy as np
import pytest

from experiments.fidelity.gradients import Agreement, compare_slopes
from jaxcalib.calibration.objective.moments import Moments
from jaxcalib.measures.measure import Level

H = 0.04
RANDOM = np.random.default_rng(3)
FRAMES = RANDOM.uniform(80.0, 120.0, 12)
SPEED = RANDOM.uniform(20.0, 24.0, 12) * FRAMES
CHANGES = RANDOM.poisson(9.0, 12).astype(float)
# the mean of a quotient answers by -0.3 % per %, with another strength in each drive; the count by +0.8
STRENGTH = -0.3 * RANDOM.uniform(0.8, 1.2, 12)
MOMENTS = Moments(
    names=("speed_mps", "changes_per_frame"),
    levels=(Level.TRAFFIC, Level.TRAFFIC),
    numerator=np.asarray([0, 1]),
    denominator=np.asarray([2, 2]),
    scale=np.asarray([1.0, 100.0]),
    drives=2,
)


def tallies(step: float) -> np.ndarray:
    return np.stack([SPEED * (1.0 + STRENGTH * step), CHANGES * (1.0 + 0.8 * step), FRAMES], axis=1)


@pytest.fixture
def found() -> tuple[Agreement, ...]:
    # a derivative of the drive as driven: right for the speed, and nothing for what is counted
    slope = np.stack([SPEED * STRENGTH, np.zeros(12), np.zeros(12)], axis=1)
    return tuple(compare_slopes(MOMENTS, "tau", H, tallies(0.0), slope, tallies(H), tallies(-H)))


def test_a_smooth_measure_agrees(found: tuple[Agreement, ...]) -> None:
    speed = found[0]
    expected = float((SPEED * STRENGTH).sum() / SPEED.sum())
    assert speed.slope == pytest.approx(expected, rel=1e-9)
    assert speed.pathwise == pytest.approx(expected, rel=1e-9)
    assert speed.counts
    assert speed.is_usable
    assert speed.cosine == pytest.approx(1.0)
    assert speed.sign_agrees == 1.0


def test_a_count_has_a_slope_but_no_derivative(found: tuple[Agreement, ...]) -> None:
    changes = found[1]
    assert changes.slope == pytest.approx(0.8, rel=1e-9)
    assert changes.pathwise == 0.0
    assert changes.counts
    assert not changes.is_usable
    assert np.isnan(changes.cosine)
    assert changes.sign_agrees == 0.0


def test_noise_does_not_count() -> None:
    shaken = tallies(H)
    shaken[:, 0] += RANDOM.normal(0.0, 0.2 * SPEED.mean(), 12)
    speed, _ = compare_slopes(MOMENTS, "tau", H, tallies(0.0), tallies(0.0), shaken, tallies(-H))
    assert not speed.counts
