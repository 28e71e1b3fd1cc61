"""Gauss-Newton steps with a trust region towards runs that agree with drives.

Runs at a point tell the features there; what the drives still differ by asks for a step, along slopes that are
measured anew where they mislead and corrected by what runs at two points differ by. A step that does not come nearer is
taken back and the next is half as long; one that keeps its promise lets the next be twice as long.

Sources: generalised least squares with a normal prior, e.g. Tarantola (2005), Inverse Problem Theory, eq. 3.51; the
slopes' correction, Broyden (1965), Math. Comp. 19, eq. 4.5; the trust region, Nocedal and Wright (2006), Numerical
Optimization, algorithm 4.1.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.runs.explained_runs import ExplainedRuns

WORTH_A_STEP = 4.0  # gain in log-likelihood that a further step promises; the runs' noise alone promises 1 to 2
FIRST_LONGEST, LONGEST = 3.0, 8.0  # in prior deviations: slopes are not trusted farther
SHORTEST_SECANT = 0.3  # likewise: noise would make the slopes of shorter ones
KEPT_PROMISE = 0.5  # share of the promised gain from which on slopes are trusted


@dataclass(frozen=True)
class Point:
    """Where runs were made."""

    at: np.ndarray  # in prior deviations
    runs: ExplainedRuns
    features: np.ndarray  # by how much they differ from the null's, in units of noise
    noise: np.ndarray  # covariance of what the drives may differ from them by
    loss: float  # twice the negative logarithm of the likelihood with the prior, but for a constant
    square: float  # its part without the noise's determinant


@dataclass(frozen=True)
class Target:
    """What is to be met, and from where on."""

    drives: np.ndarray  # by how much the drives differ from the null, in units of noise
    # covariance of what drives may differ by from runs, for runs and their features with standard errors
    noise: Callable[[ExplainedRuns, np.ndarray], np.ndarray]
    low: np.ndarray  # bounds, in prior deviations
    high: np.ndarray  # likewise
    center: np.ndarray  # where the prior stays around

    def point(self, at: np.ndarray, runs: ExplainedRuns, features: np.ndarray, error: np.ndarray) -> Point:
        """Return a point where runs were made."""
        noise = self.noise(runs, error)
        left = self.drives - features
        away = at - self.center
        square = float(left @ np.linalg.solve(noise, left) + away @ away)
        return Point(at, runs, features, noise, square + float(np.linalg.slogdet(noise)[1]), square)

    def step(self, point: Point, slopes: np.ndarray, longest: float) -> tuple[np.ndarray, float]:
        """Return the most likely further step inside the bounds, and by how much it lowers the loss if slopes hold."""
        away = point.at - self.center
        pull = slopes.T @ np.linalg.solve(point.noise, self.drives - point.features) - away
        steepness = precision(point.noise, slopes)
        step = _shortened(np.linalg.solve(steepness, pull), longest)
        step = np.clip(point.at + step, self.low, self.high) - point.at
        return step, float(2.0 * step @ pull - step @ steepness @ step)


@dataclass(frozen=True)
class Descent:
    """Where the steps ended."""

    nearest: Point  # the point whose runs agree best
    slopes: np.ndarray  # change of the features with each coordinate there
    step: np.ndarray  # the last step, that was not run any more
    num_runs: int  # runs that were made


def descend(
    target: Target,
    start: np.ndarray,
    slopes: np.ndarray,
    run: Callable[[np.ndarray], tuple[ExplainedRuns, np.ndarray, np.ndarray] | None],
    measure_slopes: Callable[[np.ndarray, np.ndarray], np.ndarray],
    most_points: int,
) -> Descent | None:
    """Return where steps from a start lead; None where its runs fail.

    Args:
        target: what is to be met.
        start: where to begin, in prior deviations.
        slopes: change of the features with each coordinate, as known at first, [feature, coordinate].
        run: makes runs at a point and tells their features with standard errors; None where they fail.
        measure_slopes: measures slopes at a point, given the known ones.
        most_points: how many points are run at most.
    """
    at, longest, promised, num_runs = start, FIRST_LONGEST, 0.0, 0
    nearest: Point | None = None
    measured_at: Point | None = None
    step = np.zeros(len(start))
    for number in range(most_points):
        made = run(at)
        point = None
        if made is not None:
            num_runs += made[0].with_effect.num_runs
            point = target.point(at, *made)
        if nearest is None:
            if point is None:
                return None
            nearest, is_misled = point, True
        else:
            length = float(np.linalg.norm(at - nearest.at))
            if point is None or point.loss >= nearest.loss:
                is_misled, longest = True, 0.5 * length
            else:
                is_misled = nearest.loss - point.loss < KEPT_PROMISE * promised
                longest = longest if is_misled else min(max(longest, 2.0 * length), LONGEST)
            if point is not None:
                slopes = _corrected(slopes, point, nearest)
                nearest = point if point.loss < nearest.loss else nearest
        step, promised = target.step(nearest, slopes, longest)
        is_stale = is_misled and measured_at is not nearest and number < most_points - 1
        if promised <= 2.0 * WORTH_A_STEP and not (is_stale and measured_at is not None):
            break
        if is_stale:
            slopes, measured_at = measure_slopes(nearest.at, slopes), nearest
            step, promised = target.step(nearest, slopes, longest)
            if promised <= 2.0 * WORTH_A_STEP:
                break
        at = nearest.at + step
    assert nearest is not None
    return Descent(nearest, slopes, step, num_runs)


def linear_step(
    noise: np.ndarray, slopes: np.ndarray, left: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Return the step that what is left of the drives' difference asks for before anything was run."""
    step = np.linalg.solve(precision(noise, slopes), slopes.T @ np.linalg.solve(noise, left))
    return np.clip(_shortened(step, FIRST_LONGEST), low, high)


def precision(noise: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return the inverse covariance of the coordinates, that of the prior included."""
    return slopes.T @ np.linalg.solve(noise, slopes) + np.eye(slopes.shape[1])


def _shortened(step: np.ndarray, longest: float) -> np.ndarray:
    return step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-12))


def _corrected(slopes: np.ndarray, point: Point, other: Point) -> np.ndarray:
    """Return slopes that give what runs at two points differ by."""
    way = point.at - other.at
    length = float(way @ way)
    if length < SHORTEST_SECANT**2:
        return slopes
    return slopes + np.outer(point.features - other.features - slopes @ way, way) / length
