"""Levenberg-Marquardt within the unit cube, for many independent least-squares problems side by side.

Exact derivatives come in; the steps themselves are small linear algebra, so that nothing more is to be compiled.

Source: Levenberg (1944); Marquardt (1963), J. SIAM 11, 431: damping by the diagonal of the normal equations.
"""

from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6
DAMPING_DOWN, DAMPING_UP = 0.2, 5.0
DAMPING_FACTORS = (1.0, 0.1, 0.01, 10.0)  # tried side by side, as many as there is room for
FLATTEST = 1e-4  # of the steepest: the least diagonal that damping counts with


class NormalEquations(Protocol):
    """What is known of the residuals at the points of some problems; the last axis of every array is the problems'.

    A record (a pytree) may hold more, for whoever made it; its leaves follow the problems, too.
    """

    @property
    def total(self) -> Any:
        """Sum of squared residuals, [problem]; nan where the point failed."""
        ...

    @property
    def gradient(self) -> Any:
        """Half its derivative, [parameter, problem]."""
        ...

    @property
    def product(self) -> Any:
        """The residuals' slopes, transposed, times themselves, [parameter, parameter, problem]."""
        ...


Found = TypeVar("Found", bound=NormalEquations)


class Descent(eqx.Module, Generic[Found]):
    """Where the problems stand; the last axis of every array is that of the problems."""

    unit: Float[np.ndarray, "parameter problem"]  # best points so far, [parameter, problem]
    found: Found  # what is known there
    damping: Float[np.ndarray, " problem"]  # of the next step

    def take(self, chosen: np.ndarray) -> "Descent[Found]":
        """Return some of the problems."""
        found = jax.tree.map(lambda leaf: leaf[..., chosen], self.found)
        return Descent(self.unit[:, chosen], found, self.damping[chosen])


def begin(unit: Float[np.ndarray, "parameter problem"], found: Found) -> Descent[Found]:
    """Return problems at their beginning."""
    return Descent(unit, found, np.full(unit.shape[1], FIRST_DAMPING))


def descend(
    evaluate: Callable[[np.ndarray], Found], now: Descent[Found], num_steps: int, num_dampings: int = 1
) -> Descent[Found]:
    """Return where a number of steps leads.

    Args:
        evaluate: from points, [parameter, point], to what is known there; the points are those of the problems with the
            first damping, then with the second, and so on.
        now: where to begin.
        num_steps: how often to evaluate.
        num_dampings: how many dampings each step tries; the best point counts.
    """
    num_problems = now.unit.shape[1]
    problem = np.arange(num_problems)
    factors = np.asarray(DAMPING_FACTORS[:num_dampings])
    for _ in range(num_steps):
        trial = now.take(np.tile(problem, num_dampings))
        trial = Descent(trial.unit, trial.found, np.outer(factors, now.damping).ravel())
        there = np.clip(trial.unit + np.nan_to_num(_step(trial)), 0.0, 1.0)
        tried = Descent(there, evaluate(there), trial.damping)
        total = np.where(np.isfinite(tried.found.total), tried.found.total, np.inf).reshape(num_dampings, -1)
        best = tried.take(np.argmin(total, axis=0) * num_problems + problem)
        is_better = best.found.total < now.found.total  # false for what is no number
        damping = np.where(is_better, DAMPING_DOWN * best.damping, DAMPING_UP * factors.max() * now.damping)
        damping = np.clip(damping, LEAST_DAMPING, MOST_DAMPING)
        found = jax.tree.map(lambda new, old, better=is_better: np.where(better, new, old), best.found, now.found)
        now = Descent(np.where(is_better, best.unit, now.unit), found, damping)
    return now


def _step(now: Descent[Found]) -> Float[np.ndarray, "parameter problem"]:
    """Return damped Gauss-Newton steps; a parameter at a bound that it would cross stays."""
    unit, gradient = now.unit.T, np.nan_to_num(now.found.gradient).T
    product = np.moveaxis(np.nan_to_num(now.found.product), -1, 0)
    free = ~(((unit <= 0.0) & (gradient > 0.0)) | ((unit >= 1.0) & (gradient < 0.0)))
    diagonal = np.diagonal(product, axis1=-2, axis2=-1)
    scale = now.damping[:, None] * np.maximum(diagonal, FLATTEST * diagonal.max(axis=-1, keepdims=True)) + 1e-12
    matrix = np.where(free[:, :, None] & free[:, None, :], product, 0.0)
    matrix = matrix + np.eye(unit.shape[-1]) * np.where(free, scale, 1.0)[:, None, :]
    return np.linalg.solve(matrix, np.where(free, -gradient, 0.0)[..., None])[..., 0].T
