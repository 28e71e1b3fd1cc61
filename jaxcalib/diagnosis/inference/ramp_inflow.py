"""The one effect that the calibration takes for a parameter: a ramp's inflow that is not what the scenario says.

A calibrated inflow near the scenario's is an ordinary day; one far from it says that the scenario's count is wrong. So
the evidence is that of two priors for the ratio of true to given inflow, seen through the calibration's error.
"""

import numpy as np
from scipy.stats import norm

from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.statistics.normal import HALF_WIDTH_90
from surrogate.effects.ramp_inflow_error import RAMP_INFLOW_ERROR

ORDINARY_DEVIATION = 0.12  # between days, of the ratio of true to given inflow
# Of its error, either sign, if the given inflow is wrong: all sizes up to the usual most are as likely; beyond, density
# falls with the square, down to a closed ramp and up to five times the given inflow.
ERROR_RANGE, MOST_ERROR, CLOSED = (0.15, 0.7), 4.0, -1.0
NUM_POINTS = 4000


def _prior() -> tuple[np.ndarray, np.ndarray]:
    """Return errors and how likely each is beforehand."""
    errors = np.linspace(CLOSED, MOST_ERROR, NUM_POINTS)
    least, usual = ERROR_RANGE
    size = np.abs(errors)
    density = np.where(size < least, 0.0, np.minimum(1.0, (usual / np.maximum(size, least)) ** 2))
    return errors, density / density.sum()


ERRORS, PRIOR = _prior()


def explain_ramps(none_evidence: float, ratios: dict[int, tuple[float, float]], main_ratio: float) -> Explained | None:
    """Return the evidence for a wrong inflow at one of the ramps; None where there is no ramp.

    Args:
        none_evidence: log evidence of the baseline.
        ratios: for each ramp's input its calibrated value over the scenario's, and the error of that.
        main_ratio: the same of the main entrance. Half of what it is off counts as a busy day's at the ramps, too, and
            the strength told is what a ramp is off beyond that.
    """
    ramps = []
    for number, (ratio, error) in ratios.items():
        centre = 0.5 * (1.0 + np.clip(main_ratio, 0.8, 1.2))
        ordinary = norm.logpdf(ratio, centre, np.hypot(ORDINARY_DEVIATION, error))
        likelihood = norm.pdf(ratio, centre * (1.0 + ERRORS), np.hypot(error, 0.03))
        evidence = max(float(PRIOR @ likelihood), 1e-300)
        posterior = PRIOR * likelihood / evidence
        strength = float(posterior @ ERRORS)
        spread = float(np.sqrt(max(posterior @ (ERRORS - strength) ** 2, 0.0)))
        ramps.append((float(np.log(evidence) - ordinary), number, strength, spread))
    if not ramps:
        return None
    gain, number, strength, spread = max(ramps)
    return Explained(
        RAMP_INFLOW_ERROR.name,
        none_evidence + gain - float(np.log(len(ramps))),
        strength=strength,
        interval=(strength - HALF_WIDTH_90 * spread, strength + HALF_WIDTH_90 * spread),
        setting={"input": float(number)},
    )
