"""Values of which the logs say nothing by themselves, looked for where the whole road behaves as the drives show.

Weights of lane changes show in no pair of leader and follower. They stay at the scenario's, which may be far from what
drivers do, and by the small steps of a slope nobody gets there: what the road then lacks looks like something unknown.
So before something is said to be missing, other values of theirs are tried, as far from the scenario's as a search
goes (`half_width_of`). They are one more explanation, judged as the others are: what each feature answers is fitted to
runs spread over all of it, and what a few runs at one point leave open is smoothed by those at the others.

Sources: response surfaces of second order, Box & Wilson (1951), J. R. Stat. Soc. B 13, 1, here without products, for
which the runs are too few; spread points: Sobol (1967), USSR Comput. Math. Math. Phys. 7(4), 86; shrinkage by the
ratio of variances: James & Stein (1961), Proc. 4th Berkeley Symp. 1, 361, in its positive part.
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
LEAST_VARIANCE = 1e-12  # of what a fit leaves, in units of noise; runs without any noise divide by it
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
        """How many points show how features answer; 0 where nothing is open, or more than points can tell apart."""
        num_silent = int(self.is_silent.sum())
        if not 0 < 2 * num_silent < MOST_POINTS:
            return 0
        wanted = np.clip(POINTS_PER_VALUE * num_silent, FEWEST_POINTS, MOST_POINTS)
        return int(2 ** np.ceil(np.log2(wanted)))

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
    # covariance of each feature's coefficients; inf where fewer than two points for each show the feature
    covariance: Float[np.ndarray, "feature coefficient coefficient"]

    @staticmethod
    def to_runs(open_values: OpenValues, points: Sequence[Values], shifts: Sequence[Feature]) -> "FittedAnswer | None":
        """Fit what runs at points show; None where they are too few.

        All shifts are from the same runs where the values stay, and share what chance made of these: those are one
        more point of the fit, whose height is free. Coefficients that chance alone would make as large are shrunk
        towards nothing, all by the same factor: the best of many points on a surface of noise would fit any drives.

        Args:
            open_values: what is open.
            points: values at which runs were made.
            shifts: change of the features there, in units of noise; NaN where a feature was not seen.
        """
        if not points:
            return None
        moved = np.vstack([np.zeros(2 * int(open_values.is_silent.sum())), open_values.moved(points)])
        seen = np.vstack([np.zeros(len(shifts[0])), *shifts])
        num_coefficients, num_features = moved.shape[1], seen.shape[1]
        coefficients = np.zeros((num_coefficients, num_features))
        covariance = np.full((num_features, num_coefficients, num_coefficients), np.inf)
        ratios = np.full(num_features, np.nan)
        patterns, pattern_of = np.unique(np.isfinite(seen), axis=1, return_inverse=True)
        for number, rows in enumerate(patterns.T):
            alike = pattern_of.ravel() == number
            away = moved[rows] - moved[rows].mean(axis=0)
            num_free = len(away) - 1 - num_coefficients
            if num_free < num_coefficients or np.linalg.matrix_rank(away) < num_coefficients:
                continue
            inverse = np.linalg.inv(away.T @ away)
            coefficients[:, alike] = inverse @ away.T @ seen[np.ix_(rows, alike)]
            fitted = away @ coefficients[:, alike]
            rest = seen[np.ix_(rows, alike)] - seen[np.ix_(rows, alike)].mean(axis=0) - fitted
            variance = np.sum(rest**2, axis=0) / num_free
            covariance[alike] = variance[:, None, None] * inverse
            ratios[alike] = np.sum(fitted**2, axis=0) / num_coefficients / np.maximum(variance, LEAST_VARIANCE)
        if np.isnan(ratios).all():
            return None
        return FittedAnswer(open_values, coefficients * _shrinkage(float(np.nanmean(ratios))), covariance)

    def at(self, point: Values) -> tuple[Feature, Feature]:
        """Return the change of the features at a point, and its standard error; inf where it is not known."""
        (moved,) = self.open_values.moved([point])
        is_known = np.isfinite(self.covariance[:, 0, 0])
        variance = np.einsum("c,fcd,d->f", moved, np.where(is_known[:, None, None], self.covariance, 0.0), moved)
        return moved @ self.coefficients, np.where(is_known, np.sqrt(variance), np.inf)


def _shrinkage(ratio: float) -> float:
    """Return the factor on coefficients whose variance is such a multiple of what chance makes (F ratio)."""
    return max(0.0, 1.0 - 1.0 / ratio) if ratio > 0.0 else 0.0


def likeliest_values(answer: FittedAnswer, difference: Feature, null: NullModel, seed: int) -> tuple[Values, float]:
    """Return the open values that explain the drives best by the surrogate, and their log evidence above the present.

    Args:
        answer: the surrogate's.
        difference: of the drives from the baseline, in units of noise.
        null: the null model.
        seed: of the points that are looked at.
    """
    points = answer.open_values.spread(LOOKED_AT, seed)
    gains = [log_evidence_of(difference, null, *answer.at(point)) for point in points]
    best = int(np.argmax(gains))
    return points[best], gains[best] - float(np.log(answer.open_values.num_points))


def log_evidence_of(difference: Feature, null: NullModel, shift: Feature, error: Feature) -> float:
    """Return the log evidence for a shift that the surrogate shows, which may be wrong by as much as an effect's.

    Its standard error widens the present values, too: what is wide fits, and few runs are wide. A feature of which no
    shift is known says nothing.
    """
    known = np.isfinite(error)
    difference, shift, error, knees = difference[known], shift[known], error[known], knees_of(null.cells)[known]
    judged, moved = squeezed(difference, knees), squeezed(shift, knees)
    wide = null.covariance[np.ix_(known, known)] + prediction_error(shift, error, 0.0, knees)
    before, _ = log_density(judged, wide)
    wrong = prediction_error(shift, np.zeros_like(error), SIGNATURE_ERROR, knees)
    return log_density(judged - moved, wide + wrong)[0] - before


def shared_features(one: NullModel, other: NullModel) -> list[Cell]:
    """Return the features that two null models both have, in the order of the second."""
    known = set(one.cells)
    return [cell for cell in other.cells if cell in known]


def evidence_between(one: NullModel, one_difference: Feature, other: NullModel, other_difference: Feature) -> float:
    """Return the log evidence of drives for one null model above another, over the features that both have.

    Each has units of noise of its own, so that densities are those of the values themselves; and each has counted the
    drives by the drivers that it expects, which moves what is counted, and does not stretch it.

    Args:
        one: null model.
        one_difference: of the drives from it, in its units of noise.
        other: the null model above which it is judged.
        other_difference: likewise.
    """
    shared = shared_features(one, other)
    return _log_density_of_values(one_difference, shared, one) - _log_density_of_values(other_difference, shared, other)


def _log_density_of_values(difference: Feature, cells: Sequence[Cell], null: NullModel) -> float:
    place = {cell: number for number, cell in enumerate(null.cells)}
    at = np.asarray([place[cell] for cell in cells])
    judged, knees = difference[at], knees_of(cells)
    density, _ = log_density(squeezed(judged, knees), null.covariance[np.ix_(at, at)])
    return density - float(np.sum(np.log(null.deviation[at] * np.hypot(1.0, judged / knees))))
