"""A linear or quadratic response surface of residual vectors around a centre."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class ResponseSurface:
    """Residual of each measure as intercept + slope z + curvature z^2 / 2, with z = (point - center) / radius."""

    center: Float[np.ndarray, " parameter"]  # in the unit cube
    radius: float  # unit of z, > 0
    intercept: Float[np.ndarray, " measure"]  # residual at the centre
    slope: Float[np.ndarray, "measure parameter"]  # per unit of z
    # second derivative with respect to each parameter alone; 0 on a linear surface
    curvature: Float[np.ndarray, "measure parameter"]
    num_points: int  # points that the surface rests on
    # of the errors of each measure's slopes, from the scatter around the surface; inf where there are no more
    # points than coefficients
    slope_covariance: Float[np.ndarray, "measure parameter parameter"]

    def residual_at(self, step: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, " measure"]:
        """Return the residual vector at a step z."""
        return self.intercept + self.slope @ step + 0.5 * self.curvature @ step**2

    def jacobian_at(self, step: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, "measure parameter"]:
        """Return the derivative of the residual vector with respect to z at a step z."""
        return self.slope + self.curvature * step


def fit_response_surface(
    points: Float[np.ndarray, "candidate parameter"],
    residuals: Float[np.ndarray, "candidate measure"],
    weights: Float[np.ndarray, "candidate measure"],
    center: Float[np.ndarray, " parameter"],
    radius: float,
    *,
    is_quadratic: bool = False,
    ridge: float = 1e-4,
) -> ResponseSurface:
    """Return the surface that fits the residuals best in weighted least squares, with a ridge on all but intercepts.

    Args:
        points: in the unit cube.
        residuals: finite.
        weights: 1 / noise variance of each residual, >= 0; 0 leaves it out.
        center: in the unit cube.
        radius: > 0.
        is_quadratic: whether each parameter has a curvature; products of parameters never enter.
        ridge: relative to the mean information on a slope, >= 0. It decides what happens where there are fewer points
            than coefficients: the unknown directions get slope 0.

    Source: Hastie, Tibshirani & Friedman, The Elements of Statistical Learning, ch. 3.4.
    """
    step = (points - center) / radius
    num_parameters = center.shape[0]
    design = np.hstack([np.ones((points.shape[0], 1)), step] + ([0.5 * step**2] if is_quadratic else []))
    coefficients = np.zeros((residuals.shape[1], design.shape[1]))
    covariance = np.full((residuals.shape[1], num_parameters, num_parameters), np.inf)
    for measure in range(residuals.shape[1]):
        root_weight = np.sqrt(weights[:, measure] / max(weights[:, measure].max(initial=0.0), np.finfo(float).tiny))
        weighted = design * root_weight[:, None]
        slope_information = (weighted[:, 1 : 1 + num_parameters] ** 2).sum() / num_parameters
        penalty = np.sqrt(ridge * slope_information) * np.eye(design.shape[1])[1:]
        coefficients[measure] = np.linalg.lstsq(
            np.vstack([weighted, penalty]),
            np.concatenate([residuals[:, measure] * root_weight, np.zeros(penalty.shape[0])]),
            rcond=None,
        )[0]
        num_free = np.count_nonzero(root_weight) - design.shape[1]
        if num_free > 0:
            scatter = np.sum((residuals[:, measure] * root_weight - weighted @ coefficients[measure]) ** 2) / num_free
            inverse = np.linalg.pinv(weighted.T @ weighted + penalty.T @ penalty, hermitian=True)
            covariance[measure] = scatter * inverse[1 : 1 + num_parameters, 1 : 1 + num_parameters]
    slope = coefficients[:, 1 : 1 + num_parameters]
    return ResponseSurface(
        center=center.copy(),
        radius=radius,
        intercept=coefficients[:, 0],
        slope=slope,
        curvature=coefficients[:, 1 + num_parameters :] if is_quadratic else np.zeros_like(slope),
        num_points=points.shape[0],
        slope_covariance=covariance,
    )
