"""One damped Gauss-Newton step on a response surface, inside a box, with a Gaussian prior."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

from jaxcalib.search.least_squares.response_surface import ResponseSurface

MOST_STEPS = 30  # of the inner Gauss-Newton iteration; a linear surface needs one
SMALLEST_STEP = 1e-10


@dataclass(frozen=True)
class GaussianPrior:
    """What is known of the parameters beforehand, in coordinates of the unit cube.

    Raises:
        ValueError: shapes that do not fit, or a precision that is not symmetric and positive semi-definite.
    """

    mean: Float[np.ndarray, " parameter"]  # most probable values; may lie outside the unit cube
    precision: Float[np.ndarray, "parameter parameter"]  # inverse covariance, symmetric and positive semi-definite

    def __post_init__(self) -> None:
        """Check shapes and definiteness."""
        if self.mean.ndim != 1 or self.precision.shape != (self.mean.shape[0],) * 2:
            raise ValueError(
                f"Expected a vector and a square matrix; got shapes {self.mean.shape}, {self.precision.shape}."
            )
        values = np.linalg.eigvalsh(self.precision)
        if not np.allclose(self.precision, self.precision.T) or values.min() < -1e-9 * max(values.max(), 1e-300):
            raise ValueError("Expected a symmetric, positive semi-definite precision.")

    def misfit(self, point: Float[np.ndarray, " parameter"]) -> float:
        """Return (point - mean)' precision (point - mean)."""
        offset = point - self.mean
        return float(offset @ self.precision @ offset)

    def root(self) -> Float[np.ndarray, "parameter parameter"]:
        """Return a matrix A with A'A equal to the precision."""
        values, vectors = np.linalg.eigh(self.precision)
        return np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T


@dataclass(frozen=True)
class LocalStep:
    """A step on a response surface."""

    step: Float[np.ndarray, " parameter"]  # z, in radii from the centre
    candidate: Float[np.ndarray, " parameter"]  # the point it leads to, in the unit cube
    predicted_improvement: float  # by how much the surface says that the misfit falls, >= 0


def predicted_misfit(
    surface: ResponseSurface,
    step: Float[np.ndarray, " parameter"],
    weights: Float[np.ndarray, " measure"],
    prior: GaussianPrior | None,
) -> float:
    """Return the weighted sum of squared residuals on the surface, plus the misfit of the prior."""
    misfit = float(weights @ surface.residual_at(step) ** 2)
    return misfit if prior is None else misfit + prior.misfit(surface.center + surface.radius * step)


def levenberg_marquardt_step(
    surface: ResponseSurface,
    weights: Float[np.ndarray, " measure"],
    prior: GaussianPrior | None = None,
    damping: float = 1e-3,
) -> LocalStep:
    """Return the step that minimises the misfit on the surface plus a damping term, in the trust region and the cube.

    The trust region is a box of one radius in each direction, so that it and the unit cube are bounds of one bounded
    linear least-squares problem; a quadratic surface takes several, each with a step that is halved until the misfit
    falls.

    Args:
        surface: residuals around the centre.
        weights: of the measures, 1 / noise variance, >= 0.
        prior: on the parameters, if any.
        damping: relative to the mean information on a parameter, >= 0; it keeps steps short in directions that
            hardly matter.

    Source: Levenberg (1944), Marquardt (1963); bounded least squares: Stark & Parker (1995).
    """
    num_parameters = surface.center.shape[0]
    lower = np.maximum(-1.0, -surface.center / surface.radius)
    upper = np.minimum(1.0, (1.0 - surface.center) / surface.radius)
    prior_root = np.empty((0, num_parameters)) if prior is None else surface.radius * prior.root()
    root_weight = np.sqrt(weights)[:, None]
    information = ((root_weight * surface.slope) ** 2).sum() + (prior_root**2).sum()
    penalty = damping * information / num_parameters if information > 0.0 else 1.0
    damping_root = np.sqrt(penalty) * np.eye(num_parameters)

    def damped_misfit(step: Float[np.ndarray, " parameter"]) -> float:
        return predicted_misfit(surface, step, weights, prior) + penalty * float(step @ step)

    step = np.zeros(num_parameters)
    for _ in range(MOST_STEPS):
        rows = [root_weight * surface.jacobian_at(step), damping_root]
        sides = [root_weight[:, 0] * surface.residual_at(step), damping_root @ step]
        if prior is not None:
            rows.append(prior_root)
            sides.append(prior.root() @ (surface.center + surface.radius * step - prior.mean))
        solution = lsq_linear(
            np.vstack(rows), -np.concatenate(sides), bounds=(lower - step, upper - step), method="bvls"
        )
        move = np.asarray(solution.x)
        before = damped_misfit(step)
        while damped_misfit(step + move) > before and np.abs(move).max() > SMALLEST_STEP:
            move = 0.5 * move
        if np.abs(move).max() <= SMALLEST_STEP:
            break
        step = np.clip(step + move, lower, upper)
        if not surface.curvature.any():
            break
    origin = np.zeros(num_parameters)
    improvement = predicted_misfit(surface, origin, weights, prior) - predicted_misfit(surface, step, weights, prior)
    return LocalStep(
        step=step,
        candidate=np.clip(surface.center + surface.radius * step, 0.0, 1.0),
        predicted_improvement=max(0.0, improvement),
    )
