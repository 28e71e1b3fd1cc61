"""Residual vectors of all points that a local search has evaluated, and comparisons of two points under noise."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.search.least_squares.surface_step import GaussianPrior


@dataclass(frozen=True)
class EvaluatedPoints:
    """Successful evaluations in the order in which they were told; a point may occur several times."""

    points: Float[np.ndarray, "candidate parameter"]  # in the unit cube
    residuals: Float[np.ndarray, "candidate measure"]  # finite; 0 where the weight is 0
    # 1 / noise variance, >= 0; 0 means that the measure is not known there
    weights: Float[np.ndarray, "candidate measure"]


@dataclass(frozen=True)
class Comparison:
    """By how much one point is better than another."""

    improvement: float  # misfit of the old point - misfit of the new one, over the measures known at both
    standard_deviation: float  # of the improvement, from the noise of the residuals


def append_points(
    evaluated: EvaluatedPoints | None,
    points: Float[np.ndarray, "candidate parameter"],
    residuals: Float[np.ndarray, "candidate measure"],
    weights: Float[np.ndarray, "candidate measure"],
    is_counted: Bool[np.ndarray, " candidate"],
) -> EvaluatedPoints:
    """Return the points with further ones added; those that do not count are left out."""
    residuals = np.where(weights > 0.0, residuals, 0.0)
    added = EvaluatedPoints(points[is_counted], residuals[is_counted], weights[is_counted])
    if evaluated is None:
        return added
    return EvaluatedPoints(
        points=np.vstack([evaluated.points, added.points]),
        residuals=np.vstack([evaluated.residuals, added.residuals]),
        weights=np.vstack([evaluated.weights, added.weights]),
    )


def measure_weights(evaluated: EvaluatedPoints) -> Float[np.ndarray, " measure"]:
    """Return one weight per measure, the mean over the points where it is known; 0 where it is known nowhere."""
    num_known = (evaluated.weights > 0.0).sum(axis=0)
    return evaluated.weights.sum(axis=0) / np.maximum(num_known, 1)


def _mean_residual(
    evaluated: EvaluatedPoints, point: Float[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, " measure"], Float[np.ndarray, " measure"]]:
    """Return the mean residual at a point over all its evaluations, and the weight of that mean."""
    is_here = (evaluated.points == point).all(axis=1)
    weights = evaluated.weights[is_here]
    total = weights.sum(axis=0)
    return (weights * evaluated.residuals[is_here]).sum(axis=0) / np.where(total > 0.0, total, 1.0), total


def is_evaluated(evaluated: EvaluatedPoints, point: Float[np.ndarray, " parameter"]) -> bool:
    """Return whether the point was evaluated with success at least once."""
    return bool((evaluated.points == point).all(axis=1).any())


def misfit_at(
    evaluated: EvaluatedPoints, point: Float[np.ndarray, " parameter"], prior: GaussianPrior | None = None
) -> float:
    """Return the weighted sum of squared mean residuals at a point, plus the misfit of the prior."""
    residual, _ = _mean_residual(evaluated, point)
    misfit = float(measure_weights(evaluated) @ residual**2)
    return misfit if prior is None else misfit + prior.misfit(point)


def compare_points(
    evaluated: EvaluatedPoints,
    old: Float[np.ndarray, " parameter"],
    new: Float[np.ndarray, " parameter"],
    prior: GaussianPrior | None = None,
) -> Comparison:
    """Return the improvement from an old to a new point and how uncertain it is.

    With r = mu + e and var e = v, the variance of w r^2 is w^2 (4 mu^2 v + 2 v^2), of which w^2 (4 r^2 v - 2 v^2) is
    an unbiased estimate; their sum is kept from falling below that of mu = 0. Points that share random seeds are
    compared more precisely than this.
    """
    weights = measure_weights(evaluated)
    improvement, variance, least_variance = 0.0, 0.0, 0.0
    is_known = np.ones(weights.shape[0], dtype=bool)
    terms = []
    for sign, point in ((1.0, old), (-1.0, new)):
        residual, total = _mean_residual(evaluated, point)
        is_known &= total > 0.0
        noise = 1.0 / np.where(total > 0.0, total, 1.0)
        terms.append(
            (sign * weights * residual**2, 4.0 * weights**2 * residual**2 * noise, 2.0 * (weights * noise) ** 2)
        )
        improvement += 0.0 if prior is None else sign * prior.misfit(point)
    for misfit_terms, product_terms, square_terms in terms:
        improvement += float(misfit_terms[is_known].sum())
        variance += float((product_terms - square_terms)[is_known].sum())
        least_variance += float(square_terms[is_known].sum())
    return Comparison(improvement, float(np.sqrt(max(variance, least_variance))))
