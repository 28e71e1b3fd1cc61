"""What one more set of drives would show, from rounds of simulated ones; and Holm's correction for many tests."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

PROBABILITY = 0.9
FEWEST_ROUNDS = 3
ROUNDING = 1e-9  # relative; what is closer together is the same number


@dataclass(frozen=True)
class Prediction:
    """A quantity over rounds."""

    mean: float  # mean over rounds
    lower: float  # lower bound of the 90 % interval of one more round
    upper: float  # upper bound
    mean_lower: float  # lower bound of the 90 % interval of the mean
    mean_upper: float  # upper bound
    p_value: float  # how often one more round would be as far from the mean as the field; nan where that is not known


def predict(rounds: Float[np.ndarray, " round"], field: float) -> Prediction | None:
    """Return the prediction for one more round; None for fewer than three. Rounds that show nothing are nan.

    Source: prediction interval for a normal quantity, Hahn & Meeker (1991), Statistical Intervals, sec. 4.7.
    """
    known = rounds[np.isfinite(rounds)]
    count = len(known)
    if count < FEWEST_ROUNDS:
        return None
    mean, spread = float(known.mean()), float(known.std(ddof=1))
    quantile = float(stats.t.ppf(0.5 + 0.5 * PROBABILITY, count - 1))
    of_one, of_mean = spread * np.sqrt(1.0 + 1.0 / count), spread / np.sqrt(count)
    if not np.isfinite(field):
        p_value = float("nan")
    elif spread > ROUNDING * abs(mean):
        p_value = float(2.0 * stats.t.sf(abs(field - mean) / of_one, count - 1))
    else:
        p_value = 1.0 if np.isclose(field, mean) else 1.0 / (count + 1.0)  # of as many, any may be the odd one
    return Prediction(
        mean,
        mean - quantile * of_one,
        mean + quantile * of_one,
        mean - quantile * of_mean,
        mean + quantile * of_mean,
        p_value,
    )


def upper_limit(rounds: Float[np.ndarray, " round"]) -> float:
    """Return what one more round of a positive, log-normal quantity exceeds in 5 % of cases; nan for too few rounds."""
    known = rounds[np.isfinite(rounds) & (rounds > 0.0)]
    if len(known) < FEWEST_ROUNDS:
        return float("nan")
    logs = np.log(known)
    quantile = float(stats.t.ppf(0.95, len(known) - 1))
    return float(np.exp(logs.mean() + quantile * logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(known))))


def exceedance(rounds: Float[np.ndarray, " round"], value: float) -> float:
    """Return how often one more round of a positive, log-normal quantity exceeds a value; nan for too few rounds."""
    known = rounds[np.isfinite(rounds) & (rounds > 0.0)]
    if len(known) < FEWEST_ROUNDS or not value > 0.0:
        return float("nan")
    logs = np.log(known)
    spread = float(logs.std(ddof=1)) * np.sqrt(1.0 + 1.0 / len(known))
    if spread <= ROUNDING:
        return 1.0 / (len(known) + 1.0) if np.log(value) > logs.mean() else 1.0
    return float(stats.t.sf((np.log(value) - logs.mean()) / spread, len(known) - 1))
