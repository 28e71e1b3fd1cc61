"""The best explanations fitted once more, around runs that contain them.

The contest judges all effects by signatures that are linear in strength and parameters, measured at the calibrated
values. A strong effect is neither: with it in, other parameter values fit, and there it does something else. So the
best few are run with the strength and the values that the drives to fit ask for, and what those drives still differ by
from these runs corrects both (`descent.py`): first in the surrogate, whose runs are cheap, by what effect and values
change there; then in SUMO where it can express the effect. Where steps do not lead to an agreement, they begin again
at what fits with a better explanation.
How well each of them fits then is evidence between them beside that of the signatures, and how far the gap shrinks
is measured from real runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.descent import Descent, Point, Target, descend, linear_step, precision
from jaxcalib.diagnosis.inference.investigation import Prepared, transfer
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    MOST_STRENGTH,
    SIGNATURE_ERROR,
    TRACE_ERROR,
    Explained,
    signature_behind,
)
from jaxcalib.diagnosis.inference.sumo_check import CHECKED_EXACTNESS
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRunner, ExplainedRuns
from jaxcalib.statistics.normal import HALF_WIDTH_90
from surrogate.effects.registry import effect_named

MOST_SURROGATE_POINTS = 8
MOST_SUMO_POINTS, OTHERS_SUMO_POINTS = 4, 2  # of the best explanation, and of those close behind it
PRIOR_SHARE = 0.7  # of the contest's strength: how far it may be off
LEAST_SHARE = 0.3  # of the contest's strength
CHANCE_OF_MISFIT = 0.01  # a fit is good if chance leaves as large a squared misfit in one of a hundred cases
TANGENT_SHARE = 0.25  # of the strength: over which the change with strength is measured


@dataclass(frozen=True)
class Refit:
    """An explanation at its last fit."""

    effect: str  # its name
    sign: float  # of the strength
    strength: float  # its size
    # its 90 % interval; where both simulators were run, by how far they disagree counts: the road is a third one,
    # and two draws tell how far a third may lie
    interval_90: tuple[float, float]
    steps: np.ndarray  # shift of the parameters from the calibrated values, in steps
    runs: ExplainedRuns  # the runs nearest to the drives to fit
    # what adds to their features, in units of noise: the last step, that was not run any more, and what runs of
    # this kind do not show
    correction: np.ndarray
    num_sumo_runs: int  # runs that SUMO made for it
    misfit: float  # whitened squared difference between the drives to fit and the nearest runs, with the prior's part
    log_evidence: float  # logarithm of the marginal likelihood around the nearest runs, by Laplace's approximation

    def expected(self, null: NullModel, fitted: NullModel) -> np.ndarray:
        """Difference of the features from the null's under the explanation, in units of its noise."""
        return self.runs.difference(null)[0] + transfer(self.correction, fitted, null)


_Makes = Callable[[Signature, np.ndarray, float], ExplainedRuns | None]


@dataclass(frozen=True)
class _Way:
    """Where a descent begins, and what it goes to; in coordinates of `_Course`."""

    target: Target
    at: np.ndarray
    slopes: np.ndarray  # as known there, [feature, coordinate]


@dataclass(frozen=True)
class _Course:
    """An explanation on its way, in coordinates that count prior deviations of the parameters and of the strength."""

    fitted: Prepared  # null model and drives to fit
    signature: Signature  # of the effect
    shift: np.ndarray  # what the contest expected of it, in units of noise
    strength: float  # its strength in the contest
    most: float  # the largest strength it may have
    maker: ExplainedRunner

    @property
    def unit(self) -> np.ndarray:
        """Prior deviation of each parameter, in steps, and of the strength."""
        return np.append(self.fitted.null.prior_steps, PRIOR_SHARE * self.strength)

    def there(self, at: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the shift of the parameters, in steps, and the strength at a point."""
        return at[:-1] * self.unit[:-1], float(self.strength + at[-1] * self.unit[-1])

    def start(self) -> _Way:
        """Where the contest's signature leads, before anything was run."""
        null, signature, low, high = self.fitted.null, self.signature, *self._bounds()
        slopes = np.column_stack([null.slope, tangent_of(signature, self.strength)]) * self.unit
        at = linear_step(self.noise(signature.exactness), slopes, self.fitted.difference - self.shift, low, high)
        # with the effect in the runs, no signature is stretched any more: what is left is that the road's has another
        # form
        noise = self.noise_of(np.minimum(signature.exactness, CHECKED_EXACTNESS))
        return _Way(Target(self.fitted.difference, noise, low, high, np.zeros_like(at)), at, slopes)

    def descend(self, way: _Way, make: _Makes, most_points: int) -> Descent | None:
        """Return where steps lead, with the runs that `make` makes; None where they fail."""

        def measure_slopes(at: np.ndarray, known: np.ndarray) -> np.ndarray:
            return self.maker.slopes(self.signature, *self.there(at), known / self.unit) * self.unit

        return descend(way.target, way.at, way.slopes, self.run_with(make), measure_slopes, most_points)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        low, high = np.full(len(self.unit), -np.inf), np.full(len(self.unit), np.inf)
        low[-1] = (LEAST_SHARE - 1.0) * self.strength / self.unit[-1]
        high[-1] = (self.most - self.strength) / self.unit[-1]
        return low, high

    def noise(self, exactness: float | np.ndarray) -> np.ndarray:
        """Covariance of chance and of the effect model's error: the road's may differ."""
        return self.fitted.null.noise + np.diag((SIGNATURE_ERROR * exactness * self.shift) ** 2)

    def noise_of(self, exactness: float | np.ndarray) -> Callable[[ExplainedRuns, np.ndarray], np.ndarray]:
        """Function from runs to the covariance around them: an effect that brings jams brings their chance too."""
        base, null, num_drives = self.noise(exactness), self.fitted.null, len(self.fitted.tallies)

        def noise(runs: ExplainedRuns, error: np.ndarray) -> np.ndarray:
            longer = np.maximum(runs.deviation(null, num_drives), 1.0)
            return base * np.outer(longer, longer) + np.diag(error**2)

        return noise

    def run_with(self, make: _Makes) -> Callable[[np.ndarray], tuple[ExplainedRuns, np.ndarray, np.ndarray] | None]:
        """Function from a point to the runs there and their features with standard errors."""

        def run(at: np.ndarray) -> tuple[ExplainedRuns, np.ndarray, np.ndarray] | None:
            steps, strength = self.there(at)
            runs = make(self.signature, steps, strength)
            if runs is None:
                return None
            shift, error = runs.difference(self.fitted.null)
            unseen, its_error = self.signature.at(strength)
            is_seen = np.isfinite(error)
            return runs, np.where(is_seen, shift, unseen), np.where(is_seen, error, its_error)

        return run

    def unseen(self, point: Point) -> np.ndarray:
        """Return the signature in features that the runs at a point do not show, 0 in others."""
        _, error = point.runs.difference(self.fitted.null)
        return np.where(np.isfinite(error), 0.0, point.features)


def refit(
    fitted: Prepared,
    best: Explained,
    signatures: Sequence[Signature],
    maker: ExplainedRunner,
    most_sumo_points: int = MOST_SUMO_POINTS,
    known_steps: np.ndarray | None = None,
) -> Refit | None:
    """Return the refit of an explanation; None where its runs fail.

    Args:
        fitted: null model and drives to fit.
        best: the explanation, as the contest found it.
        signatures: of its effect; they say how features change with the strength.
        maker: makes the runs.
        most_sumo_points: how often SUMO is run at most.
        known_steps: shift of the parameters, in steps, that fits with another explanation: where to begin anew, which
            saves a search.
    """
    course = _course_of(fitted, best, signatures, maker)
    in_surrogate, way = _descend_in_surrogate(course, known_steps)
    in_sumo = course.descend(way, maker.in_sumo, most_sumo_points)
    descent = in_sumo or in_surrogate
    if descent is None:
        return None
    nearest = descent.nearest
    steps, strength = course.there(nearest.at + descent.step)
    sharpness = precision(nearest.noise, descent.slopes)
    error = float(course.unit[-1] * np.sqrt(np.linalg.inv(sharpness)[-1, -1]))
    if in_sumo is not None and in_surrogate is not None:
        error = float(np.hypot(error, (strength - course.there(way.at)[1]) / np.sqrt(2.0)))
    return Refit(
        effect=best.name,
        sign=course.signature.sign,
        strength=strength,
        interval_90=_interval_90(course, best, signatures, strength, error),
        steps=steps,
        runs=nearest.runs,
        correction=descent.slopes @ descent.step + course.unseen(nearest),
        num_sumo_runs=0 if in_sumo is None else in_sumo.num_runs,
        misfit=nearest.square,
        log_evidence=-0.5 * (nearest.loss + float(np.linalg.slogdet(sharpness)[1])),
    )


def _course_of(fitted: Prepared, best: Explained, signatures: Sequence[Signature], maker: ExplainedRunner) -> _Course:
    assert best.shift is not None
    strength = abs(best.strength)
    most = max(MOST_STRENGTH * effect_named(best.name).strong, strength)
    return _Course(fitted, signature_behind(signatures, best), best.shift, strength, most, maker)


def _descend_in_surrogate(course: _Course, known_steps: np.ndarray | None) -> tuple[Descent | None, _Way]:
    """Return where the surrogate's runs lead, None where they fail, and the way that SUMO goes on from there."""
    way = course.start()
    descent = course.descend(way, course.maker.in_surrogate, MOST_SURROGATE_POINTS)
    if descent is None:
        return None, way
    target = way.target
    if descent.nearest.square > most_misfit(len(course.shift)):
        descent, target = _descend_anew(course, target, descent, known_steps)
    return descent, _Way(target, descent.nearest.at + descent.step, descent.slopes)


def _descend_anew(
    course: _Course, target: Target, descent: Descent, known_steps: np.ndarray | None
) -> tuple[Descent, Target]:
    """Return a descent in the surrogate that begins elsewhere, or the first one where that does not come nearer."""
    if known_steps is None:
        return descent, target
    # what the drives leave open lies around where it fits, with the effect in as without
    begin = known_steps / course.unit[:-1]
    anew = replace(target, center=np.append(begin, 0.0))
    way = _Way(anew, np.append(begin, descent.nearest.at[-1]), descent.slopes)
    other = course.descend(way, course.maker.in_surrogate, MOST_SURROGATE_POINTS)
    if other is not None and other.nearest.loss < descent.nearest.loss:
        return other, anew
    return descent, target


def _interval_90(
    course: _Course, best: Explained, signatures: Sequence[Signature], strength: float, error: float
) -> tuple[float, float]:
    """Return the interval of the strength; a fixed signature's reaches halfway to the next one on either side."""
    form = TRACE_ERROR * float(np.mean(course.signature.exactness)) * strength
    deviation = HALF_WIDTH_90 * float(np.hypot(error, form))
    low, high = max(strength - deviation, 0.0), max(min(strength + deviation, course.most), strength)
    if course.signature.is_fixed:
        tried = np.unique([signature.strengths[-1] for signature in signatures])
        half = 0.5 * np.diff(tried).min() if len(tried) > 1 else TANGENT_SHARE * strength
        least, greatest = sorted(course.signature.sign * bound for bound in best.interval)
        low, high = max(min(least, strength - half), 0.0), max(greatest, strength + half)
    return float(low), float(high)


def most_misfit(num_features: int) -> float:
    """Return the largest squared misfit of a good fit."""
    return float(chi2.isf(CHANCE_OF_MISFIT, num_features))


def tangent_of(signature: Signature, strength: float) -> np.ndarray:
    """Return the change of the features with the strength; 0 where a signature holds at its own strength only."""
    if signature.is_fixed:
        return np.zeros(signature.shift.shape[1])
    high, low = (1.0 + TANGENT_SHARE) * strength, (1.0 - TANGENT_SHARE) * strength
    return (signature.at(high)[0] - signature.at(low)[0]) / (high - low)
