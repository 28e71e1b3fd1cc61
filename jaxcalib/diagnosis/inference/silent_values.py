"""Values of which the logs say nothing by themselves, looked for where the whole road behaves as the drives show.

Weights of lane changes show in no pair of leader and follower. They stay at the scenario's, which may be far from what
drivers do, and by the small steps of a slope nobody gets there: what the road then lacks looks like something unknown.
So before something is said to be missing, other values of theirs are tried over all that the logs leave open. They are
one more explanation, judged as the others are: what each feature answers is fitted to runs spread over all of it, and
what a few runs at one point leave open is smoothed by those at the others.

Sources: response surfaces of second order, Box & Wilson (1951), J. R. Stat. Soc. B 13, 1, here without products, for
which the runs are too few; spread points: Sobol (1967), USSR Comput. Math. Math. Phys. 7(4), 86.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats.qmc import Sobol

from jaxcalib.diagnosis.features.features import Cell
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    SIGNATURE_ERROR,
    knees_of,
    log_density,
    prediction_error,
    squeezed,
)
from jaxcalib.problem.parameter_space import round_values

POINTS_PER_VALUE = 6  # three for each coefficient; their number is raised to a power of two
FEWEST_POINTS, MOST_POINTS = 8, 128
LOOKED_AT = 256  # points of the fitted surface

Values = Float[np.ndarray, " parameter"]
Feature = Float[np.ndarray, " feature"]


@dataclass(frozen=True)
class OpenValues:
    """Values that the logs leave open, among all of them."""

    values: Values  # where they are
    is_silent: Bool[np.ndarray, " parameter"]  # which are open
    low: Values  # bounds
    high: Values  # likewise

    @property
    def num_points(self) -> int:
        """How many points show how features answer; 0 where nothing is open."""
        wanted = POINTS_PER_VALUE * int(self.is_silent.sum())
        return 0 if not wanted else int(2 ** np.ceil(np.log2(np.clip(wanted, FEWEST_POINTS, MOST_POINTS))))

    def spread(self, num_points: int, seed: int) -> list[Values]:
        """Return values whose silent ones are spread evenly between bounds, while the others stay."""
        shares = Sobol(int(self.is_silent.sum()), rng=np.random.default_rng(seed)).random(num_points)
        points = np.tile(self.values, (num_points, 1))
        points[:, self.is_silent] = self.low[self.is_silent] + shares * (self.high - self.low)[self.is_silent]
        return list(round_values(points))

    def moved(self, points: Sequence[Values]) -> Float[np.ndarray, "point coefficient"]:
        """Return by how much points are away, in shares of what is open, and the squares of that."""
        away = (np.stack(points) - self.values)[:, self.is_silent] / (self.high - self.low)[self.is_silent]
        return np.hstack([away, away**2])


@dataclass(frozen=True)
class FittedAnswer:
    """What each feature answers to the open values, in units of noise; nothing where they stay."""

    open_values: OpenValues
    coefficients: Float[np.ndarray, "coefficient feature"]
    spread: Feature  # standard deviation of what runs at a point differ from it by
    inverse: Float[np.ndarray, "coefficient coefficient"]  # covariance of the coefficients, in units of that

    @staticmethod
    def to_runs(open_values: OpenValues, points: Sequence[Values], shifts: Sequence[Feature]) -> "FittedAnswer | None":
        """Fit what runs at points show; None where they are too few."""
        if not points:
            return None
        design, seen = open_values.moved(points), np.stack(shifts)
        num_free = len(design) - design.shape[1]
        if num_free < 1 or np.linalg.matrix_rank(design) < design.shape[1]:
            return None
        inverse = np.linalg.inv(design.T @ design)
        coefficients = inverse @ design.T @ seen
        spread = np.sqrt(np.sum((seen - design @ coefficients) ** 2, axis=0) / num_free)
        return FittedAnswer(open_values, coefficients, spread, inverse)

    def at(self, point: Values) -> tuple[Feature, Feature]:
        """Return the change of the features at a point, and its standard error."""
        (moved,) = self.open_values.moved([point])
        return moved @ self.coefficients, self.spread * np.sqrt(moved @ self.inverse @ moved)


def likeliest_values(answer: FittedAnswer, difference: Feature, null: NullModel, seed: int) -> tuple[Values, float]:
    """Return the open values that explain the drives best by the surrogate, and their log evidence above the present.

    Args:
        answer: the surrogate's.
        difference: of the drives from the baseline, in units of noise.
        null: the null model.
        seed: of the points that are looked at.
    """
    points = answer.open_values.spread(LOOKED_AT, seed)
    gains = [_gain(difference, null, *answer.at(point)) for point in points]
    best = int(np.argmax(gains))
    return points[best], gains[best] - float(np.log(answer.open_values.num_points))


def _gain(difference: Feature, null: NullModel, shift: Feature, error: Feature) -> float:
    """Return the log evidence for a shift that the surrogate predicts, which may be wrong by as much as an effect's.

    Its standard error widens the present values, too: what is wide fits, and few runs are wide.
    """
    knees = knees_of(null.cells)
    judged, moved = squeezed(difference, knees), squeezed(shift, knees)
    wide = null.covariance + prediction_error(shift, error, 0.0, knees)
    before, _ = log_density(judged, wide)
    wrong = prediction_error(shift, np.zeros_like(error), SIGNATURE_ERROR, knees)
    return log_density(judged - moved, wide + wrong)[0] - before


def evidence_between(values: Feature, cells: Sequence[Cell], one: NullModel, other: NullModel) -> float:
    """Return the log evidence of feature values for one null model above another, over the features that both have.

    Each has units of noise of its own, so that densities are those of the values themselves.
    """
    known = [cell for cell in cells if cell in set(one.cells) and cell in set(other.cells)]
    at = {cell: value for cell, value in zip(cells, values, strict=True)}
    told = np.asarray([at[cell] for cell in known])
    return _log_density_of_values(told, known, one) - _log_density_of_values(told, known, other)


def _log_density_of_values(values: Feature, cells: Sequence[Cell], null: NullModel) -> float:
    place = {cell: number for number, cell in enumerate(null.cells)}
    at = np.asarray([place[cell] for cell in cells])
    deviation, knees = null.deviation[at], knees_of(cells)
    difference = (values - null.mean[at]) / deviation
    density, _ = log_density(squeezed(difference, knees), null.covariance[np.ix_(at, at)])
    return density - float(np.sum(np.log(deviation * np.hypot(1.0, difference / knees))))
