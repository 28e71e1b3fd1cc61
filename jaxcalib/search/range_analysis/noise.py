"""How large the accuracy range of a parameter without any effect would be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True)
class RangeNoise:
    """What pure noise does to level means and ranges.

    Attributes:
        source: where the error variance comes from: "given", "replicates" or "residual" (of the analysis of variance;
            then it holds the interactions, too).
        case_variance: error variance of the mean accuracy of one case (averaged over cases).
        degrees_of_freedom: of that variance; inf if it is known.
        level_standard_error: standard error of each level mean; nan where there is no level mean.
        null_range_quantile: quantile of the range under no effect; nan where the range is nan.
        p_value: probability of a range at least as large as the one found if there is no effect; nan where that is.
        is_indistinguishable: whether the range does not exceed the quantile: what was found may be noise alone.
    """

    source: str
    case_variance: float
    degrees_of_freedom: float
    level_standard_error: Float[np.ndarray, "parameter level"]
    null_range_quantile: Float[np.ndarray, " parameter"]
    p_value: Float[np.ndarray, " parameter"]
    is_indistinguishable: Bool[np.ndarray, " parameter"]


def simulate_null_ranges(
    level_standard_error: Float[np.ndarray, " level"],
    degrees_of_freedom: float,
    num_draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, " draw"]:
    """Return draws of max - min of level means that consist of noise alone.

    The degrees of freedom are those of the variance behind the standard errors; inf if it is known.

    Source: not in the paper. With equal standard errors this is the studentised range (Tukey), times the error.
    """
    noise = rng.standard_normal((num_draws, level_standard_error.shape[0])) * level_standard_error
    ranges = noise.max(axis=1) - noise.min(axis=1)
    if np.isinf(degrees_of_freedom):
        return ranges
    return ranges / np.sqrt(rng.chisquare(degrees_of_freedom, num_draws) / degrees_of_freedom)


def judge_ranges(
    accuracy_range: Float[np.ndarray, " parameter"],
    level_standard_error: Float[np.ndarray, "parameter level"],
    case_variance: float,
    degrees_of_freedom: float,
    source: str,
    *,
    probability: float = 0.95,
    num_draws: int = 20000,
    seed: int = 0,
) -> RangeNoise:
    """Return which ranges stand out from noise.

    Every parameter is judged on its own: of M parameters without effect, (1 - probability) M are expected to stand
    out by chance. Compare the p values with 0.05 / M to judge all of them together.

    Args:
        accuracy_range: R_j >= 0; nan where it is unknown.
        level_standard_error: standard error of each level mean, >= 0; nan where there is no level mean.
        case_variance: error variance of the mean accuracy of one case, >= 0.
        degrees_of_freedom: of that variance; inf if it is known.
        source: "given", "replicates" or "residual".
        probability: of the quantile, in (0, 1).
        num_draws: draws of the range under no effect.
        seed: of the draws; every parameter sees the same draws.

    Source: not in the paper, which ranks parameters by Eq. 15 alone.
    """
    num_parameters = accuracy_range.shape[0]
    quantile = np.full(num_parameters, np.nan)
    p_value = np.full(num_parameters, np.nan)
    is_indistinguishable = np.zeros(num_parameters, dtype=bool)
    judged: dict[bytes, Float[np.ndarray, " draw"]] = {}
    for j in np.flatnonzero(np.isfinite(accuracy_range)):
        errors = level_standard_error[j]
        key = errors.tobytes()
        if key not in judged:
            rng = np.random.default_rng(seed)
            judged[key] = simulate_null_ranges(errors, degrees_of_freedom, num_draws, rng)
        quantile[j] = np.quantile(judged[key], probability)
        p_value[j] = (1.0 + (judged[key] >= accuracy_range[j]).sum()) / (1.0 + num_draws)
        is_indistinguishable[j] = accuracy_range[j] <= quantile[j]
    return RangeNoise(
        source=source,
        case_variance=case_variance,
        degrees_of_freedom=degrees_of_freedom,
        level_standard_error=level_standard_error,
        null_range_quantile=quantile,
        p_value=p_value,
        is_indistinguishable=is_indistinguishable,
    )
