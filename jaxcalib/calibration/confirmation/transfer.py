"""How well the surrogate stands for SUMO: per measure, rank correlation and bias over what both have run."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from jaxcalib.calibration.confirmation.discrepancy import Confirmed
from jaxcalib.calibration.objective.moments import Moments

FEWEST_POINTS = 3


@dataclass(frozen=True)
class Transfer:
    """One measure in both simulators."""

    measure: str  # its name
    bias: float | None  # median of surrogate / SUMO - 1
    bias_in_noise: float  # median difference in standard deviations of the field's drives
    rank_correlation: float | None  # Spearman's, over candidates; None for fewer than three


def transfer_of(
    moments: Moments, covariance: np.ndarray, num_drives: float, confirmed: Sequence[Confirmed]
) -> tuple[Transfer, ...]:
    """Return the transfer of each moment.

    Args:
        moments: what is matched.
        covariance: of the moments of one run.
        num_drives: drives behind the field's values.
        confirmed: candidates that both simulators have run.
    """
    surrogate = np.stack([moments.values(one.surrogate) for one in confirmed])
    sumo = np.stack([moments.values(one.sumo) for one in confirmed])
    deviation = np.sqrt(np.diag(covariance) / num_drives)
    rows = []
    for place, name in enumerate(moments.names):
        ours, theirs = surrogate[:, place], sumo[:, place]
        with np.errstate(divide="ignore", invalid="ignore"):
            bias = np.median(ours / theirs - 1.0)
        correlation = None
        if len(confirmed) >= FEWEST_POINTS and np.ptp(ours) > 0.0 and np.ptp(theirs) > 0.0:
            correlation = float(np.asarray(spearmanr(ours, theirs))[0])
        rows.append(
            Transfer(
                name,
                float(bias) if np.isfinite(bias) else None,
                float(np.median((ours - theirs) / deviation[place])),
                correlation,
            )
        )
    return tuple(rows)
