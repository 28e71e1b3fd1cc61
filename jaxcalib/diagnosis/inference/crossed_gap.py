"""How much of a gap an effect closes, from drives that share no noise with each other.

A gap of a few drives is mostly chance, and a floor that is taken off it is as uncertain as the gap is. The product of
what two sets of drives differ from a simulation by has no chance in it: their noises are independent, and what both
have in common is the gap. So held-out drives are multiplied with the drives to fit. These have been fitted, but a fit
by least squares takes as much off the product as it adds to the gap, and nothing is left of it in the mean.

Source: Walther et al. (2016), Reliability of dissimilarity measures for multi-voxel pattern analysis, NeuroImage 137,
eq. 12 (the cross-validated Mahalanobis distance); Fieller (1954), J. R. Stat. Soc. B 16, 175-185, for the ratio.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel

QUANTILE = 0.95
FEWEST_DRIVES = 2  # in each set, for an interval
LEAST_FRACTION = -1.0  # an effect that adds more to the gap than there was makes it worse, no matter how much

Directions = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Closed:
    """How much of a gap is closed."""

    fraction: float | None  # at most 1; None where there is no gap
    interval_90: tuple[float, float] | None  # its interval; None where there is no gap, or a set has a single drive


def fraction_closed(
    held_out: DriveTallies,
    other: DriveTallies,
    null: NullModel,
    directions: Directions,
    shifts: tuple[np.ndarray, np.ndarray],
    in_common: tuple[float, float],
) -> Closed:
    """Return the fraction of the gap that an effect closes.

    Args:
        held_out: drives that nothing was fitted to.
        other: other drives, with the same features.
        null: the null model of the held-out ones.
        directions: turns a difference of features, in units of noise, into directions whose noise is independent.
        shifts: by how much features differ from the null's without the effect and with it, in units of noise.
        in_common: what the error of either simulation's mean, which both sets have in common, adds to its gap.
    """

    def gaps(one: DriveTallies, two: DriveTallies) -> np.ndarray:
        differences = [null.standardised(some.values()) for some in (one, two)]
        both = [[directions(difference - shift) for shift in shifts] for difference in differences]
        return np.asarray([np.mean(a * b) for a, b in zip(*both, strict=True)]) - in_common

    whole = gaps(held_out, other)
    if whole[0] <= 0.0:
        return Closed(None, None)
    fraction = float(np.clip(1.0 - whole[1] / whole[0], LEAST_FRACTION, 1.0))
    if min(len(held_out), len(other)) < FEWEST_DRIVES:
        return Closed(fraction, None)
    parts = [
        _jackknifed([gaps(some, other) for some in held_out.without_each()]),
        _jackknifed([gaps(held_out, some) for some in other.without_each()]),
    ]
    # Welch-Satterthwaite, of the gap that is divided by
    variances, sizes = np.asarray([part[0, 0] for part in parts]), np.asarray([len(held_out), len(other)])
    freedom = variances.sum() ** 2 / max(float(np.sum(variances**2 / (sizes - 1))), 1e-300)
    low, high = ratio_interval(whole[1], whole[0], parts[0] + parts[1], float(t.ppf(QUANTILE, max(freedom, 1.0))))
    bounds = np.clip([1.0 - high, 1.0 - low], LEAST_FRACTION, 1.0)
    return Closed(fraction, (float(min(bounds[0], fraction)), float(max(bounds[1], fraction))))


def ratio_interval(above: float, below: float, covariance: np.ndarray, width: float) -> tuple[float, float]:
    """Return the interval of a ratio; infinite where what it is divided by may be 0.

    Args:
        above: numerator.
        below: denominator.
        covariance: of denominator and numerator, in this order.
        width: of the interval, in standard errors to either side.
    """
    (var_below, both), (_, var_above) = covariance
    square = below**2 - width**2 * var_below
    if square <= 0.0:
        return -np.inf, np.inf
    middle = above * below - width**2 * both
    root = np.sqrt(max(middle**2 - square * (above**2 - width**2 * var_above), 0.0))
    return float((middle - root) / square), float((middle + root) / square)


def _jackknifed(values: Sequence[np.ndarray]) -> np.ndarray:
    """Return the covariance of a statistic, from what it is without each drive."""
    spread = np.asarray(values) - np.mean(values, axis=0)
    return (len(values) - 1) / len(values) * spread.T @ spread
