"""What drivers want to drive: few show it, most are held back, and those who want most are held back most often."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import CensoredData, norm

from jaxcalib.initial_values.following_fit import FollowingFit
from jaxcalib.initial_values.following_samples import FollowingSamples

CLEAR_ERROR = 0.03  # of the desired speed over the limit
CLEAR_RISE = 2.0  # of a driver's loss if he wanted more: that of two standard errors
FEWEST_CLEAR = 10
NUM_RESAMPLES = 40


@dataclass(frozen=True)
class DesiredSpeeds:
    """Mean and standard deviation of drivers' desired speeds over the limit, with standard errors."""

    mean: float
    mean_error: float
    deviation: float
    deviation_error: float


def desired_speeds(
    fit: FollowingFit, samples: FollowingSamples, limit_mps: Float[np.ndarray, " sample"], seed: int
) -> DesiredSpeeds | None:
    """Return the desired speeds of all drivers, of whom some show theirs.

    A driver shows his where the pairs would be explained worse if he wanted more. Of all others it is known that they
    want no less than the most that they drove. Leaving them out would keep those who want little: who wants more
    catches up, and then follows. So a normal distribution is fitted to both (right-censored; Tobin 1958, Econometrica
    26), and its errors come from drawing drivers anew.

    Args:
        fit: of the pairs.
        samples: the pairs.
        limit_mps: speed limit where each of them was.
        seed: of the drawing.

    Returns:
        None where too few drivers show theirs.
    """
    _, vehicle = np.unique(samples.vehicle, return_inverse=True)
    driven = np.zeros(len(fit.speed_factor))
    np.maximum.at(driven, vehicle, np.maximum(samples.speed_mps, samples.later_speed_mps) / limit_mps)
    is_clear = (fit.speed_factor_error < CLEAR_ERROR) & (fit.speed_factor_rise > CLEAR_RISE)
    if np.unique(fit.speed_factor[is_clear]).size < FEWEST_CLEAR:
        return None
    shown = np.where(is_clear, fit.speed_factor, driven)
    mean, deviation = _fitted(shown, is_clear, float(np.mean(shown)), float(np.std(shown)))
    random = np.random.default_rng(seed)
    drawn = []
    while len(drawn) < NUM_RESAMPLES:
        chosen = random.integers(0, len(shown), len(shown))
        if np.unique(shown[chosen][is_clear[chosen]]).size > 1:
            drawn.append(_fitted(shown[chosen], is_clear[chosen], mean, deviation))
    mean_error, deviation_error = np.std(drawn, axis=0, ddof=1)
    return DesiredSpeeds(mean, float(mean_error), deviation, float(deviation_error))


def _fitted(shown: np.ndarray, is_clear: np.ndarray, near: float, spread: float) -> tuple[float, float]:
    mean, deviation = norm.fit(CensoredData.right_censored(shown, ~is_clear), loc=near, scale=spread)
    return float(mean), float(deviation)
