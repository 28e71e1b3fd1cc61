"""Levenberg-Marquardt steps within the unit cube, for many independent least-squares problems side by side.

Exact derivatives come in; the steps themselves are small linear algebra, so that nothing more is to be compiled.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from jaxcalib.pair_fitting.batch import Misfit

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6
DAMPING_DOWN, DAMPING_UP = 0.2, 5.0


class Descent(eqx.Module):
    """Where the problems stand; the last axis of every array is that of the problems.

    Attributes:
        unit: best points so far, [parameter, problem].
        found: the misfit there.
        damping: of the next step.
    """

    unit: Float[np.ndarray, "parameter problem"]
    found: Misfit
    damping: Float[np.ndarray, " problem"]

    def take(self, chosen: np.ndarray) -> "Descent":
        """Return some of the problems."""
        found = jax.tree.map(lambda leaf: leaf[..., chosen], self.found)
        return Descent(self.unit[:, chosen], found, self.damping[chosen])


def begin(unit: Float[np.ndarray, "parameter problem"], found: Misfit) -> Descent:
    """Return problems at their beginning."""
    return Descent(unit, found, np.full(unit.shape[1], FIRST_DAMPING))


def descend(evaluate: Callable[[np.ndarray], Misfit], now: Descent, num_steps: int) -> Descent:
    """Return where a number of steps leads.

    Args:
        evaluate: from points, [parameter, problem], to their misfits.
        now: where to begin.
        num_steps: how often to evaluate.
    """
    for _ in range(num_steps):
        there = np.clip(now.unit + np.nan_to_num(_step(now)), 0.0, 1.0)
        later = evaluate(there)
        is_better = later.total < now.found.total  # false for what is no number
        damping = np.clip(now.damping * np.where(is_better, DAMPING_DOWN, DAMPING_UP), LEAST_DAMPING, MOST_DAMPING)
        found = jax.tree.map(lambda new, old, better=is_better: np.where(better, new, old), later, now.found)
        now = Descent(np.where(is_better, there, now.unit), found, damping)
    return now


def _step(now: Descent) -> Float[np.ndarray, "parameter problem"]:
    """Return damped Gauss-Newton steps; a parameter at a bound that it would cross stays."""
    unit, gradient = now.unit.T, np.nan_to_num(now.found.gradient).T
    product = np.moveaxis(np.nan_to_num(now.found.product), -1, 0)
    free = ~(((unit <= 0.0) & (gradient > 0.0)) | ((unit >= 1.0) & (gradient < 0.0)))
    diagonal = np.diagonal(product, axis1=-2, axis2=-1)
    scale = now.damping[:, None] * np.maximum(diagonal, 1e-4 * diagonal.max(axis=-1, keepdims=True)) + 1e-12
    matrix = np.where(free[:, :, None] & free[:, None, :], product, 0.0)
    matrix = matrix + np.eye(unit.shape[-1]) * np.where(free, scale, 1.0)[:, None, :]
    return np.linalg.solve(matrix, np.where(free, -gradient, 0.0)[..., None])[..., 0].T
