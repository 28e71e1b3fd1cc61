"""The best explanations fitted once more, around runs that contain them: a few Gauss-Newton steps each.

The contest judges all effects by signatures that are linear in strength and parameters, measured at the calibrated
values. A strong effect is neither: with it in, other parameter values fit, and there it does something else. So the
best few are run with the strength and the values that the drives to fit ask for, and what those drives still differ
by from these runs corrects both, with slopes measured anew where the effect is in; what runs at two points differ by
corrects the slopes further. A step that does not come nearer is taken back, and the next is half as long. How well
each of them fits then is evidence between them beside that of the signatures, and how far the gap shrinks is measured
from real runs.

Sources: generalised least squares with a normal prior, e.g. Tarantola (2005), Inverse Problem Theory, eq. 3.51; the
slopes' correction, Broyden (1965), Math. Comp. 19, eq. 4.5.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from jaxcalib.diagnosis.evidence import (
    MOST_STRENGTH,
    NONE,
    SIGNATURE_ERROR,
    UNKNOWN,
    Explained,
    Signature,
    alike_errors,
    signature_behind,
)
from jaxcalib.diagnosis.explained_runs import ExplainedRuns
from jaxcalib.diagnosis.investigation import Prepared, transfer
from jaxcalib.diagnosis.noise import NullModel
from jaxcalib.diagnosis.sumo_check import CHECKED_EXACTNESS, NUM_CHECKED, WITHIN
from surrogate.effects.registry import effect_named

MOST_ITERATIONS = 3
WORTH_A_STEP = 4.0  # gain in log-likelihood that a further step promises; the runs' noise alone promises 1 to 2
LONGEST_STEP = 3.0  # in prior deviations: slopes are not trusted farther
SHORTEST_SECANT = 0.3  # likewise: noise would make the slopes of shorter ones
PRIOR_SHARE = 0.7  # of the contest's strength: how far it may be off
LEAST_SHARE = 0.3  # of the contest's strength
TANGENT_SHARE = 0.25  # of the strength: over which the change with strength is measured
QUANTILE_90 = 1.645


@dataclass(frozen=True)
class Refit:
    """An explanation at its last fit.

    Attributes:
        effect: its name.
        sign: of the strength.
        strength: its size.
        interval_90: its 90 % interval.
        steps: shift of the parameters from the calibrated values, in steps.
        runs: the runs nearest to the drives to fit.
        correction: what the last step, that was not run any more, adds to their features, in units of noise.
        num_sumo_runs: runs that SUMO made for it.
        misfit: whitened squared difference between the drives to fit and the nearest runs, with the prior's part.
        log_evidence: logarithm of the marginal likelihood around the nearest runs, by Laplace's approximation.
    """

    effect: str
    sign: float
    strength: float
    interval_90: tuple[float, float]
    steps: np.ndarray
    runs: ExplainedRuns
    correction: np.ndarray
    num_sumo_runs: int
    misfit: float
    log_evidence: float

    def expected(self, null: NullModel, fitted: NullModel) -> np.ndarray:
        """Return by how much features differ from the null's under the explanation, in units of noise.

        Args:
            null: the null model for the drives in question.
            fitted: that for the drives to fit.
        """
        return self.runs.difference(null)[0] + transfer(self.correction, fitted, null)


class MakesRuns(Protocol):
    """Makes runs that contain an effect; see `ExplainedRunner`."""

    def run(self, signature: Signature, steps: np.ndarray, strength: float) -> ExplainedRuns | None:
        """Return runs; None where they fail."""
        ...

    def slopes(self, signature: Signature, steps: np.ndarray, strength: float, known: np.ndarray) -> np.ndarray:
        """Return how features change with parameters and strength there."""
        ...


@dataclass(frozen=True)
class _Point:
    """Where runs were made: in prior deviations, with the runs, their features, and how well those agree."""

    at: np.ndarray
    runs: ExplainedRuns
    features: np.ndarray
    loss: float


def refit(fitted: Prepared, best: Explained, signatures: Sequence[Signature], maker: MakesRuns) -> Refit | None:
    """Return the refit of an explanation; None where its runs fail.

    Args:
        fitted: null model and drives to fit.
        best: the explanation, as the contest found it.
        signatures: of its effect; they say how features change with the strength.
        maker: makes runs from a signature, the shift of the parameters, in steps, and the size of the strength.
    """
    assert best.shift is not None
    null, drives = fitted.null, fitted.difference
    signature, strength = signature_behind(signatures, best), abs(best.strength)
    unit = np.append(null.prior_steps, PRIOR_SHARE * strength)
    slopes = np.column_stack([null.slope, tangent_of(signature, strength)]) * unit
    most = max(MOST_STRENGTH * effect_named(best.name).strong, strength)
    low = np.append(np.full(len(unit) - 1, -np.inf), (LEAST_SHARE - 1.0) * strength / unit[-1])
    high = np.append(np.full(len(unit) - 1, np.inf), (most - strength) / unit[-1])

    start = np.zeros(len(unit))
    noise = _noise(null, best.shift, signature.exactness)
    at = _shortened(_step(drives - best.shift, noise, slopes, start), LONGEST_STEP)
    at = np.clip(at, low, high)
    nearest, num_sumo_runs = None, 0
    for iteration in range(MOST_ITERATIONS):
        runs = maker.run(signature, at[:-1] * unit[:-1], strength + at[-1] * unit[-1])
        if runs is None:
            break
        if runs.without is None:
            num_sumo_runs += len(runs.with_effect)
            noise = _noise(null, best.shift, CHECKED_EXACTNESS)
        features, error = runs.difference(null)
        noise_now = noise + np.diag(error**2)
        left = drives - features
        point = _Point(at, runs, features, float(left @ np.linalg.solve(noise_now, left) + at @ at))
        longest = LONGEST_STEP
        if nearest is not None:
            slopes = _corrected(slopes, point, nearest)
            if point.loss >= nearest.loss:
                longest = 0.5 * float(np.linalg.norm(point.at - nearest.at))
        if nearest is None or point.loss < nearest.loss:
            nearest = point
        left = drives - nearest.features
        step = _shortened(_step(left, noise_now, slopes, nearest.at), longest)
        is_worth_it = 0.5 * step @ _precision(noise_now, slopes) @ step > WORTH_A_STEP
        if is_worth_it and nearest is point and iteration < MOST_ITERATIONS - 1:
            there = nearest.at * unit + np.append(np.zeros(len(unit) - 1), strength)
            slopes = maker.slopes(signature, there[:-1], there[-1], slopes / unit) * unit
            step = _shortened(_step(left, noise_now, slopes, nearest.at), longest)
        at = np.clip(nearest.at + step, low, high)
        if not is_worth_it:
            break
    if nearest is None:
        return None
    found = strength + at[-1] * unit[-1]
    precision = _precision(noise, slopes)
    deviation = unit[-1] * np.sqrt(np.linalg.inv(precision)[-1, -1])
    log_determinants = np.linalg.slogdet(noise)[1] + np.linalg.slogdet(precision)[1]
    interval = (max(found - QUANTILE_90 * deviation, 0.0), max(min(found + QUANTILE_90 * deviation, most), found))
    if signature.is_fixed:
        interval = tuple(sorted(signature.sign * one for one in best.interval))
    return Refit(
        effect=best.name,
        sign=signature.sign,
        strength=float(found),
        interval_90=(float(interval[0]), float(interval[1])),
        steps=at[:-1] * unit[:-1],
        runs=nearest.runs,
        correction=slopes @ (at - nearest.at),
        num_sumo_runs=num_sumo_runs,
        misfit=nearest.loss,
        log_evidence=-0.5 * float(nearest.loss + log_determinants),
    )


def contenders(explained: Sequence[Explained], signatures: Mapping[str, Sequence[Signature]]) -> list[Explained]:
    """Return the best effect and those close behind it, best first, as far as they have signatures."""
    none = next(one.log_evidence for one in explained if one.name == NONE)
    effects = [one for one in explained if one.name not in (NONE, UNKNOWN) and one.log_evidence > none]
    near = [one for one in effects if one.log_evidence > effects[0].log_evidence - WITHIN]
    return [one for one in near[:NUM_CHECKED] if one.name in signatures]


def with_refits(explained: Sequence[Explained], refits: Mapping[str, Refit]) -> list[Explained]:
    """Return explanations, best first, with the strengths of those that were fitted again, and told apart by it.

    The signatures' evidence and the refits' are two readings of one quantity, each with errors of its own, and their
    mean says how far apart two effects lie. The best of them keeps the most evidence of all, against none, unknown and
    the rest.
    """
    again = [one for one in explained if one.name in refits]
    if not again:
        return list(explained)
    most = max(one.log_evidence for one in again)
    mean = {one.name: 0.5 * (one.log_evidence + refits[one.name].log_evidence) for one in again}
    found = []
    for one in explained:
        if one.name not in refits:
            found.append(one)
            continue
        mine = refits[one.name]
        low, high = sorted(mine.sign * size for size in mine.interval_90)
        found.append(
            replace(
                one,
                log_evidence=most - (max(mean.values()) - mean[one.name]),
                strength=mine.sign * mine.strength,
                interval=(low, high),
                best_misfit=min(one.best_misfit, mine.misfit),
            )
        )
    return sorted(found, key=lambda one: -one.log_evidence)


def tangent_of(signature: Signature, strength: float) -> np.ndarray:
    """Return the change of the features with the strength; 0 where a signature holds at its own strength only."""
    if signature.is_fixed:
        return np.zeros(signature.shift.shape[1])
    high, low = (1.0 + TANGENT_SHARE) * strength, (1.0 - TANGENT_SHARE) * strength
    return (signature.at(high)[0] - signature.at(low)[0]) / (high - low)


def _noise(null: NullModel, shift: np.ndarray, exactness: float) -> np.ndarray:
    """Return the covariance of chance and of what the model of an effect may be wrong by: the road has another form."""
    wrong = SIGNATURE_ERROR * exactness * shift
    return null.noise + np.outer(wrong, wrong) * alike_errors(null)


def _precision(noise: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    return slopes.T @ np.linalg.solve(noise, slopes) + np.eye(slopes.shape[1])


def _step(left: np.ndarray, noise: np.ndarray, slopes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the most likely further step, in prior deviations; the prior stays around the contest's point, 0."""
    return np.linalg.solve(_precision(noise, slopes), slopes.T @ np.linalg.solve(noise, left) - at)


def _shortened(step: np.ndarray, longest: float) -> np.ndarray:
    return step * min(1.0, longest / max(float(np.linalg.norm(step)), 1e-12))


def _corrected(slopes: np.ndarray, point: _Point, other: _Point) -> np.ndarray:
    """Return slopes that give what runs at two points differ by."""
    way = point.at - other.at
    length = float(way @ way)
    if length < SHORTEST_SECANT**2:
        return slopes
    return slopes + np.outer(point.features - other.features - slopes @ way, way) / length
