"""The best explanation fitted once more, around runs that contain it: a Gauss-Newton iteration on strength and values.

The contest judges all effects by signatures that are linear in strength and parameters, measured at the calibrated
values. A strong effect is neither: with it in, other parameter values fit, and there it does something else. So the
winner is run with the strength and the values that the drives to fit ask for, and what those drives still differ by
from these runs gives the last correction of both. How far the gap shrinks is then measured from real runs.

Source: iterated generalised least squares with a normal prior, e.g. Tarantola (2005), Inverse Problem Theory, eq. 3.51.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.diagnosis.evidence import SIGNATURE_ERROR, Explained, Signature, alike_errors, signature_behind
from jaxcalib.diagnosis.explained_runs import ExplainedRuns
from jaxcalib.diagnosis.investigation import Prepared, transfer
from jaxcalib.diagnosis.ledger import parameter_shift
from jaxcalib.diagnosis.noise import NullModel
from jaxcalib.diagnosis.sumo_check import CHECKED_EXACTNESS
from surrogate.effects.registry import effect_named

MOST_ITERATIONS = 2
CONVERGED = 0.1  # change of the strength, as a share of it, and of parameters, in prior deviations
PRIOR_SHARE = 0.5  # of the strength: how far it may still be off
LEAST_SHARE, MOST_SHARE = 0.4, 1.8  # of the strength, in one iteration
BEYOND_STRONG = 1.5  # strengths above this multiple of strong are outside what effects are made for
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
        run_strength: strength of the last runs.
        run_steps: their shift of the parameters, in steps.
        runs: the last runs.
        tangent: change of the features with the strength, in units of noise of the drives to fit.
        num_sumo_runs: runs that SUMO made for it.
    """

    effect: str
    sign: float
    strength: float
    interval_90: tuple[float, float]
    steps: np.ndarray
    run_strength: float
    run_steps: np.ndarray
    runs: ExplainedRuns
    tangent: np.ndarray
    num_sumo_runs: int

    def expected(self, null: NullModel, fitted: NullModel) -> np.ndarray:
        """Return by how much features differ from the null's under the explanation, in units of noise.

        Args:
            null: the null model for the drives in question.
            fitted: that for the drives to fit.
        """
        explained, _ = self.runs.difference(null)
        linear = null.slope @ (self.steps - self.run_steps)
        change = (self.strength - self.run_strength) * transfer(self.tangent, fitted, null)
        return explained + linear + change


Run = Callable[[Signature, np.ndarray, float], ExplainedRuns | None]


def refit(fitted: Prepared, best: Explained, signatures: Sequence[Signature], run: Run) -> Refit | None:
    """Return the refit of an explanation; None where its runs fail.

    Args:
        fitted: null model and drives to fit.
        best: the explanation, as the contest found it.
        signatures: of its effect; they say how features change with the strength.
        run: makes runs from a signature, the shift of the parameters, in steps, and the size of the strength.
    """
    assert best.shift is not None
    signature, strength, null = signature_behind(signatures, best), abs(best.strength), fitted.null
    most = max(BEYOND_STRONG * effect_named(best.name).strong, strength)
    steps = parameter_shift(fitted.difference - best.shift, null)
    found, num_sumo_runs = None, 0
    for _ in range(MOST_ITERATIONS):
        runs = run(signature, steps, strength)
        if runs is None:
            break
        num_sumo_runs += len(runs.with_effect) if runs.without is None else 0
        explained, error = runs.difference(null)
        tangent = tangent_of(signature, strength)
        wrong = SIGNATURE_ERROR * CHECKED_EXACTNESS * (explained - null.slope @ steps)
        noise = null.noise + np.outer(wrong, wrong) * alike_errors(null) + np.diag(error**2)
        left = fitted.difference - explained
        change, more, deviation = _fit(left, null, noise, steps, tangent, PRIOR_SHARE * strength)
        new = min(float(np.clip(strength + change, LEAST_SHARE * strength, MOST_SHARE * strength)), most)
        interval = (max(new - QUANTILE_90 * deviation, 0.0), new + QUANTILE_90 * deviation)
        if signature.is_fixed:
            low, high = sorted(signature.sign * one for one in best.interval)
            interval = (low, high)
        found = Refit(
            effect=best.name,
            sign=signature.sign,
            strength=new,
            interval_90=interval,
            steps=steps + more,
            run_strength=strength,
            run_steps=steps,
            runs=runs,
            tangent=tangent,
            num_sumo_runs=num_sumo_runs,
        )
        moved = np.abs(more) / null.prior_steps
        if abs(new - strength) < CONVERGED * strength and np.all(moved < CONVERGED):
            break
        strength, steps = new, steps + more
    return found


def with_refit(explained: Sequence[Explained], refitted: Refit | None) -> list[Explained]:
    """Return explanations with the strength of the one that was fitted again."""
    if refitted is None:
        return list(explained)
    low, high = sorted(refitted.sign * size for size in refitted.interval_90)
    return [
        replace(one, strength=refitted.sign * refitted.strength, interval=(low, high))
        if one.name == refitted.effect
        else one
        for one in explained
    ]


def tangent_of(signature: Signature, strength: float) -> np.ndarray:
    """Return the change of the features with the strength; 0 where a signature holds at its own strength only."""
    if signature.is_fixed:
        return np.zeros(signature.shift.shape[1])
    high, low = (1.0 + TANGENT_SHARE) * strength, (1.0 - TANGENT_SHARE) * strength
    return (signature.at(high)[0] - signature.at(low)[0]) / (high - low)


def _fit(
    difference: np.ndarray,
    null: NullModel,
    noise: np.ndarray,
    steps: np.ndarray,
    tangent: np.ndarray,
    strength_prior: float,
) -> tuple[float, np.ndarray, float]:
    """Return the change of the strength, the further shift of the parameters, and the strength's deviation.

    The parameters' prior stays around the calibrated values, so that iterations do not walk away from them.
    """
    columns = np.column_stack([null.slope, tangent])
    prior_mean = np.append(-steps, 0.0)
    prior_precision = np.append(1.0 / null.prior_steps**2, 1.0 / max(strength_prior, 1e-12) ** 2)
    weighed = np.linalg.solve(noise, columns)
    precision = columns.T @ weighed + np.diag(prior_precision)
    change = np.linalg.solve(precision, weighed.T @ difference + prior_precision * prior_mean)
    deviation = float(np.sqrt(np.linalg.inv(precision)[-1, -1]))
    return float(change[-1]), change[:-1], deviation
