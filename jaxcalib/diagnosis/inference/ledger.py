"""Where the gap lies: one entry per feature, which add up to the whole."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import Cell
from jaxcalib.diagnosis.features.noise import NullModel

NUM_DRAWS = 4000


@dataclass(frozen=True)
class LedgerEntry:
    """One feature's part of the gap."""

    cell: Cell  # what it describes
    field: float  # value in the field
    simulated: float  # value in the calibrated simulation
    difference: float  # what remains after the parameters' shift, in units of noise
    # its square less what chance makes of it, divided by the number of features: entries add up to the gap above
    # noise. Negative where the field agrees better than chance lets expect.
    excess: float
    share: float  # its part of the squared difference of all features
    p_adjusted: float  # chance of so large a difference in any feature, if nothing were missing


def parameter_shift(difference: np.ndarray, null: NullModel) -> np.ndarray:
    """Return the most likely shift of the parameters, in steps: the calibration's last iteration, on all features."""
    weights = np.linalg.solve(null.covariance, difference)
    return null.prior_steps**2 * (null.slope.T @ weights)


def shift_covariance(null: NullModel) -> np.ndarray:
    """Return the covariance of the parameters' shift that stays after the field was seen."""
    prior = np.diag(null.prior_steps**2)
    seen = prior @ null.slope.T @ np.linalg.solve(null.covariance, null.slope @ prior)
    return prior - seen


def remaining_covariance(null: NullModel) -> np.ndarray:
    """Return the covariance of differences after the parameters' shift, where nothing is missing."""
    return null.noise @ np.linalg.solve(null.covariance, null.noise)


def make_ledger(values: np.ndarray, null: NullModel, random: np.random.Generator) -> list[LedgerEntry]:
    """Return the ledger, largest share first.

    P-values are those of the largest of all standardised differences under the null model, so that they hold for all
    entries together.

    Source: single-step maximum statistic, Westfall & Young (1993), Resampling-Based Multiple Testing, ch. 2.
    """
    difference = null.standardised(values)
    remaining = difference - null.slope @ parameter_shift(difference, null)
    covariance = remaining_covariance(null)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance)))
    drawn = random.standard_normal((NUM_DRAWS, len(remaining))) @ root.T
    largest = np.sort(np.abs(drawn / deviation).max(axis=1))
    exceeded = NUM_DRAWS - np.searchsorted(largest, np.abs(remaining / deviation))
    square = remaining**2
    total = max(float(square.sum()), 1e-12)
    entries = [
        LedgerEntry(
            cell=cell,
            field=float(values[feature]),
            simulated=float(null.mean[feature]),
            difference=float(remaining[feature]),
            excess=float((square[feature] - deviation[feature] ** 2) / len(remaining)),
            share=float(square[feature] / total),
            p_adjusted=float((exceeded[feature] + 1) / (NUM_DRAWS + 1)),
        )
        for feature, cell in enumerate(null.cells)
    ]
    return sorted(entries, key=lambda entry: -entry.share)
