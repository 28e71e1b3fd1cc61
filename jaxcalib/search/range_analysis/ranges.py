"""Range analysis of an orthogonal array, the paper's Algorithm 2, and what it cannot know.

An array of strength 2 separates main effects from one another, not from interactions, and level means carry the noise
of the simulator. So next to the paper's level means, ranges and critical parameters stand the size of a range that
noise alone would show, the interactions that each main effect is aliased with, and the analysis of variance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxcalib.search.orthogonal_arrays.orthogonal_array import OrthogonalArray
from jaxcalib.search.range_analysis.analysis_of_variance import AnalysisOfVariance, analyse_variance
from jaxcalib.search.range_analysis.case_means import CaseMeans, average_replicates
from jaxcalib.search.range_analysis.noise import RangeNoise, judge_ranges

NO_LEVEL = -1  # best level of a parameter of which no level could be judged


@dataclass(frozen=True)
class RangeAnalysisConfig:
    """Options of range analysis."""

    least_cases_per_level: int = 2  # a level mean over fewer successful cases is nan
    noise_probability: float = 0.95  # quantile of the range under no effect that a range must exceed to stand out
    num_draws: int = 20000  # draws of that range
    seed: int = 0  # of these draws


@dataclass(frozen=True)
class RangeAnalysis:
    """Main effects of the parameters on accuracy.

    Attributes:
        level_mean_accuracy: mean accuracy at each level (Eq. 14); nan where too few cases succeeded.
        level_num_cases: successful cases behind each level mean.
        accuracy_range: R_j (Eq. 15); nan if a level mean is.
        ranking: pi, the parameters by descending range (Eq. 16); equal ranges by index, unknown ranges last.
        critical_parameters: C_K, the first K of the ranking (Eq. 17).
        best_levels: c_best, the level of each parameter with the highest mean; `NO_LEVEL` where there is no mean. Ties
            go to the lower level. This combination is usually not a case of the array, so its accuracy is not known.
        is_unreliable: whether some level of the parameter has too few successful cases.
        is_unbalanced: whether failed cases have made the array unbalanced; then the level means of one parameter also
            carry part of the effects of the others.
        aliases: for each parameter the pairs of other parameters whose two-factor interaction cannot be told from its
            main effect.
        noise: what noise does to the ranges; None if the error variance is not known.
        analysis_of_variance: None where no error degrees of freedom are left.
    """

    level_mean_accuracy: Float[np.ndarray, "parameter level"]
    level_num_cases: Int[np.ndarray, "parameter level"]
    accuracy_range: Float[np.ndarray, " parameter"]
    ranking: Int[np.ndarray, " parameter"]
    critical_parameters: Int[np.ndarray, " critical"]
    best_levels: Int[np.ndarray, " parameter"]
    is_unreliable: Bool[np.ndarray, " parameter"]
    is_unbalanced: bool
    aliases: tuple[tuple[tuple[int, int], ...], ...]
    noise: RangeNoise | None
    analysis_of_variance: AnalysisOfVariance | None


def analyse_ranges(
    array: OrthogonalArray,
    accuracy: Float[np.ndarray, "..."],
    num_critical: int,
    *,
    is_ok: Bool[np.ndarray, "..."] | None = None,
    error_variance: float | None = None,
    config: RangeAnalysisConfig | None = None,
) -> RangeAnalysis:
    """Return level means, ranges, the critical parameters and the best combination of levels.

    Args:
        array: the design; its factors are the parameters.
        accuracy: of each case [case], or of each case and seed [case, seed]; at most 1; nan means failed.
        num_critical: K, from 1 to the number of parameters.
        is_ok: what the simulator said about each run, in the shape of the accuracy; None means that all went well.
        error_variance: variance of the accuracy of one run, if it is known from elsewhere. Otherwise it is estimated
            from the replicates, or without them from the residual of the analysis of variance.
        config: options; None means `RangeAnalysisConfig()`.

    Raises:
        ValueError: the accuracy does not fit the array, or K the number of parameters.

    Source: Algorithm 2; Eqs. 14-17.
    Deviation: failed cases never enter a level mean, and a parameter with a level that has too few successful cases
        is ranked last (the paper does not say what happens to failed cases). Levels count from 0.
    """
    config = RangeAnalysisConfig() if config is None else config
    if accuracy.ndim not in (1, 2) or accuracy.shape[0] != array.num_cases:
        raise ValueError(
            f"Expected accuracy of shape ({array.num_cases},) or ({array.num_cases}, seeds) for {array.name}; "
            f"got {accuracy.shape}."
        )
    if not 1 <= num_critical <= array.num_factors:
        raise ValueError(f"Expected 1 to {array.num_factors} critical parameters; got {num_critical}.")
    if is_ok is not None and is_ok.ndim == 1:
        is_ok = is_ok[:, None]
    cases = average_replicates(accuracy[:, None] if accuracy.ndim == 1 else accuracy, is_ok)

    sums, counts = _level_sums(array, cases.accuracy)
    level_mean_accuracy = np.where(counts >= config.least_cases_per_level, sums / np.maximum(counts, 1), np.nan)
    is_unreliable = np.asarray((counts < config.least_cases_per_level).any(axis=1))
    accuracy_range = level_mean_accuracy.max(axis=1) - level_mean_accuracy.min(axis=1)
    ranking = np.argsort(np.where(is_unreliable, np.inf, -accuracy_range), kind="stable")
    best_levels = np.argmax(np.where(np.isnan(level_mean_accuracy), -np.inf, level_mean_accuracy), axis=1)
    noise_variance, noise_degrees_of_freedom = _replicate_noise(cases, error_variance)
    analysis_of_variance = analyse_variance(array.levels, cases.accuracy, noise_variance, noise_degrees_of_freedom)
    return RangeAnalysis(
        level_mean_accuracy=level_mean_accuracy,
        level_num_cases=counts,
        accuracy_range=accuracy_range,
        ranking=ranking,
        critical_parameters=ranking[:num_critical],
        best_levels=np.where(np.isnan(level_mean_accuracy).all(axis=1), NO_LEVEL, best_levels),
        is_unreliable=is_unreliable,
        is_unbalanced=bool(np.isnan(cases.accuracy).any()),
        aliases=aliases_of(array),
        noise=_judge(array, cases, counts, accuracy_range, error_variance, analysis_of_variance, config),
        analysis_of_variance=analysis_of_variance,
    )


def aliases_of(array: OrthogonalArray) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Return for each factor the pairs of factors whose two-factor interaction is aliased with its main effect."""
    pairs: list[list[tuple[int, int]]] = [[] for _ in range(array.num_factors)]
    for i, j, k in array.aliased_triples.tolist():
        pairs[i].append((j, k))
        pairs[j].append((i, k))
        pairs[k].append((i, j))
    return tuple(tuple(sorted(factor_pairs)) for factor_pairs in pairs)


def _level_sums(
    array: OrthogonalArray, values: Float[np.ndarray, " case"]
) -> tuple[Float[np.ndarray, "parameter level"], Int[np.ndarray, "parameter level"]]:
    """Return sum and number of the finite values at each level of each factor."""
    is_counted = np.isfinite(values)
    shows = (array.levels[:, :, None] == np.arange(array.num_levels)) & is_counted[:, None, None]
    return np.einsum("cpl,c->pl", shows, np.where(is_counted, values, 0.0)), shows.sum(axis=0)


def _replicate_noise(cases: CaseMeans, error_variance: float | None) -> tuple[float, float]:
    """Return the variance of a case mean that replicates or the caller know of, and its degrees of freedom."""
    is_counted = cases.num_replicates > 0
    if not is_counted.any():
        return np.nan, 0.0
    share = float((1.0 / cases.num_replicates[is_counted]).mean())
    if error_variance is not None:
        return error_variance * share, np.inf
    return cases.replicate_variance * share, float(cases.replicate_degrees_of_freedom)


def _judge(
    array: OrthogonalArray,
    cases: CaseMeans,
    counts: Int[np.ndarray, "parameter level"],
    accuracy_range: Float[np.ndarray, " parameter"],
    error_variance: float | None,
    analysis_of_variance: AnalysisOfVariance | None,
    config: RangeAnalysisConfig,
) -> RangeNoise | None:
    replicates = np.maximum(cases.num_replicates, 1)
    if error_variance is not None:
        source, case_variance, degrees_of_freedom = "given", error_variance / replicates, np.inf
    elif cases.replicate_degrees_of_freedom > 0:
        source, case_variance = "replicates", cases.replicate_variance / replicates
        degrees_of_freedom = float(cases.replicate_degrees_of_freedom)
    elif analysis_of_variance is not None:
        source, case_variance = "residual", np.full(array.num_cases, analysis_of_variance.error_mean_square)
        degrees_of_freedom = float(analysis_of_variance.error_degrees_of_freedom)
    else:
        return None
    case_variance = np.where(cases.num_replicates > 0, case_variance, np.nan)
    variance_sums, _ = _level_sums(array, case_variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        level_standard_error = np.where(counts > 0, np.sqrt(variance_sums) / counts, np.nan)
    return judge_ranges(
        accuracy_range,
        level_standard_error,
        case_variance=float(np.nanmean(case_variance)) if (cases.num_replicates > 0).any() else np.nan,
        degrees_of_freedom=degrees_of_freedom,
        source=source,
        probability=config.noise_probability,
        num_draws=config.num_draws,
        seed=config.seed,
    )
