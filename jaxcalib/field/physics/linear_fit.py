"""Coefficients of a linear identity between logged quantities, robust against odd rows, with errors from blocks."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

NUM_ROUNDS = 8  # of reweighting
OUTLIER = 2.5  # robust standard deviations beyond which a window counts less
FEWEST_WINDOWS = 8  # fewer say nothing


@dataclass(frozen=True)
class LinearFit:
    """What windows say of the coefficients."""

    value: Float[np.ndarray, " coefficient"]
    error: Float[np.ndarray, " coefficient"]  # standard errors; inf where they cannot be told
    scatter: float  # median size of what is left
    num_windows: int

    def is_off(self, coefficient: int, expected: float, tolerance: float, significance: float) -> bool:
        """Whether a coefficient differs from what is expected by more than a tolerance and than chance explains."""
        away = abs(self.value[coefficient] - expected)
        return bool(away > max(tolerance, significance * self.error[coefficient]))


def fit_linear(
    design: Float[np.ndarray, "window coefficient"],
    target: Float[np.ndarray, " window"],
    block: Int[np.ndarray, " window"],
) -> LinearFit | None:
    """Fit target = design @ coefficients; None where there are too few windows.

    Args:
        design: what each coefficient multiplies, in each window.
        target: what they add up to.
        block: number of the block of windows that are not independent: a drive, or a part of one.

    Source: Huber's M-estimator by reweighted least squares; errors by the jackknife over blocks (Efron & Tibshirani
    1993, ch. 11).
    """
    usable = np.isfinite(design).all(axis=1) & np.isfinite(target)
    design, target, block = design[usable], target[usable], block[usable]
    num_windows, num_coefficients = design.shape
    if num_windows < max(FEWEST_WINDOWS, 3 * num_coefficients):
        return None
    weight, value = np.ones(num_windows), np.zeros(num_coefficients)
    left = target
    for _ in range(NUM_ROUNDS):
        root = np.sqrt(weight)[:, None]
        value = np.linalg.lstsq(design * root, target * root[:, 0], rcond=None)[0]
        left = target - design @ value
        scale = 1.4826 * np.median(np.abs(left)) + 1e-9
        weight = np.minimum(1.0, OUTLIER * scale / np.maximum(np.abs(left), 1e-12))
    return LinearFit(value, _errors(design, target, block, weight, value), float(np.median(np.abs(left))), num_windows)


def _errors(
    design: np.ndarray, target: np.ndarray, block: np.ndarray, weight: np.ndarray, value: np.ndarray
) -> np.ndarray:
    """Jackknife over blocks, by leaving out the normal equations of each."""
    _, number = np.unique(block, return_inverse=True)
    num_blocks = int(number.max()) + 1
    if num_blocks < 3:
        return np.full(len(value), np.inf)
    normal = np.zeros((num_blocks, len(value), len(value)))
    moment = np.zeros((num_blocks, len(value)))
    np.add.at(normal, number, weight[:, None, None] * design[:, :, None] * design[:, None, :])
    np.add.at(moment, number, weight[:, None] * design * target[:, None])
    if not normal.any():
        return np.full(len(value), np.inf)
    ridge = 1e-9 * np.trace(normal.sum(axis=0)) * np.eye(len(value))
    without = np.linalg.solve(normal.sum(axis=0) - normal + ridge, (moment.sum(axis=0) - moment)[..., None])[..., 0]
    departures = without - without.mean(axis=0)
    return np.sqrt((num_blocks - 1) / num_blocks * np.sum(departures**2, axis=0))
