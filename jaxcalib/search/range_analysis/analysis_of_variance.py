"""Analysis of variance of the main effects of an orthogonal array, complete or with failed cases."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy import stats


@dataclass(frozen=True)
class AnalysisOfVariance:
    """Main effects against the error that is left.

    Attributes:
        degrees_of_freedom: of each main effect.
        sum_of_squares: of each main effect, given all others (of the complete array: the classical one).
        f_statistic: mean square of each main effect over the error mean square; nan if an effect has no degrees left.
        p_value: probability of at least this F without the main effect.
        error_degrees_of_freedom: cases - 1 - degrees of freedom of all main effects, > 0.
        error_mean_square: residual sum of squares / error degrees of freedom; it holds all interactions that are not
            aliased with a main effect.
        lack_of_fit_p_value: probability of at least this error mean square if it were replicate noise alone; a small
            one says that interactions are there. nan if replicate noise is unknown.
    """

    degrees_of_freedom: Int[np.ndarray, " parameter"]
    sum_of_squares: Float[np.ndarray, " parameter"]
    f_statistic: Float[np.ndarray, " parameter"]
    p_value: Float[np.ndarray, " parameter"]
    error_degrees_of_freedom: int
    error_mean_square: float
    lack_of_fit_p_value: float


def _indicators(levels: Int[np.ndarray, " case"]) -> Float[np.ndarray, "case level"]:
    """Return one column per level that occurs, without the first one."""
    return (levels[:, None] == np.unique(levels)[None, 1:]).astype(np.float64)


def _fit(columns: list[Float[np.ndarray, "case _"]], accuracy: Float[np.ndarray, " case"]) -> tuple[float, int]:
    """Return residual sum of squares and rank of the least-squares fit with a constant."""
    design = np.hstack([np.ones((accuracy.shape[0], 1)), *columns])
    solution, _, rank, _ = np.linalg.lstsq(design, accuracy, rcond=None)
    residual = accuracy - design @ solution
    return float(residual @ residual), int(rank)


def analyse_variance(
    levels: Int[np.ndarray, "case parameter"],
    accuracy: Float[np.ndarray, " case"],
    noise_variance: float = np.nan,
    noise_degrees_of_freedom: float = 0.0,
) -> AnalysisOfVariance | None:
    """Return the analysis of variance, or None where no error degrees of freedom are left.

    Args:
        levels: level of each parameter in each case.
        accuracy: of each case; nan means failed, and the case is left out.
        noise_variance: variance of a case mean from replicates, in the same unit; nan if unknown.
        noise_degrees_of_freedom: of that variance; inf if it is known.

    Source: not in the paper; Montgomery, Design and Analysis of Experiments, ch. 3-5. Effects are tested by the extra
        sum of squares, which for the complete array equals sum_l n_l (mean_l - mean)^2.
    """
    is_counted = np.isfinite(accuracy)
    counted = accuracy[is_counted] - accuracy[is_counted].mean() if is_counted.any() else accuracy[:0]
    if counted.size < 2:
        return None
    num_parameters = levels.shape[1]
    columns = [_indicators(levels[is_counted, j]) for j in range(num_parameters)]
    residual, rank = _fit(columns, counted)
    error_degrees_of_freedom = counted.size - rank
    if error_degrees_of_freedom < 1:
        return None
    degrees_of_freedom = np.zeros(num_parameters, dtype=np.int64)
    sum_of_squares = np.zeros(num_parameters)
    for j in range(num_parameters):
        reduced_residual, reduced_rank = _fit(columns[:j] + columns[j + 1 :], counted)
        degrees_of_freedom[j] = rank - reduced_rank
        sum_of_squares[j] = max(0.0, reduced_residual - residual) if rank > reduced_rank else np.nan
    error_mean_square = residual / error_degrees_of_freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        f_statistic = sum_of_squares / degrees_of_freedom / error_mean_square
    return AnalysisOfVariance(
        degrees_of_freedom=degrees_of_freedom,
        sum_of_squares=sum_of_squares,
        f_statistic=f_statistic,
        p_value=np.asarray(stats.f.sf(f_statistic, degrees_of_freedom, error_degrees_of_freedom)),
        error_degrees_of_freedom=error_degrees_of_freedom,
        error_mean_square=error_mean_square,
        lack_of_fit_p_value=_lack_of_fit_p_value(
            error_mean_square, error_degrees_of_freedom, noise_variance, noise_degrees_of_freedom
        ),
    )


def _lack_of_fit_p_value(
    error_mean_square: float, error_degrees_of_freedom: int, noise_variance: float, noise_degrees_of_freedom: float
) -> float:
    if not noise_degrees_of_freedom > 0.0 or not noise_variance > 0.0:
        return np.nan
    ratio = error_mean_square / noise_variance
    if np.isinf(noise_degrees_of_freedom):
        return float(stats.chi2.sf(ratio * error_degrees_of_freedom, error_degrees_of_freedom))
    return float(stats.f.sf(ratio, error_degrees_of_freedom, noise_degrees_of_freedom))
