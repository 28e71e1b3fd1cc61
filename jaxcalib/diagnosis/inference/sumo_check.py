"""Effects put into SUMO itself, where it can express them: its own runs correct the signatures.

A surrogate's signature may be wrong by more than its size: of delays and noise it shows a third, of slow lane changes
what SUMO does not show. So if there is something to explain, SUMO runs every effect that it has means for and that may
still win, at medium strength, and then the best few at the strength that fits. Both simulators measure one thing, each
with its error, and are averaged by their precision, feature by feature.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, measured_shift
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    SIGNATURE_ERROR,
    Explained,
    effects_above_none,
    signature_behind,
)
from jaxcalib.diagnosis.inference.overdispersion import temperature
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import effect_named

NUM_CHECKED = 3  # explanations at most
WITHIN = 20.0  # log evidence: explanations farther behind the best are out of the race
LOOKED_AT = 10.0  # the same in units of the temperature, as long as only the surrogate has spoken
CHECKED_EXACTNESS = 0.4  # share of SIGNATURE_ERROR: on the road the same effect may come in another form


@dataclass(frozen=True)
class Check:
    """An effect in SUMO."""

    effect: str  # its name
    strength: float  # at which it was put in
    num_runs: int  # SUMO runs
    # cosine between the surrogate's signature and SUMO's, features weighed by the null model's precision; None
    # where SUMO's is not longer than its noise
    agreement: float | None
    size_ratio: float  # length of SUMO's signature over that of the surrogate's, weighed likewise, its noise taken off


@dataclass(frozen=True)
class Checked:
    """What SUMO made of the best explanations."""

    explained: Sequence[Explained]  # explanations with corrected signatures, best first
    signatures: Mapping[str, Sequence[Signature]]  # of all effects, corrected where they were checked
    checks: tuple[Check, ...]  # one for each effect that was checked, in order
    num_look_runs: int = 0  # SUMO's runs of all effects at medium strength

    @property
    def num_runs(self) -> int:
        """SUMO's runs of all effects."""
        return self.num_look_runs + sum(check.num_runs for check in self.checks)


Run = Callable[[str, EffectSetting, bool], DriveTallies | None]  # name, setting, whether a few drives will do
Explain = Callable[[Mapping[str, Sequence[Signature]]], Sequence[Explained]]


def worth_a_look(explained: Sequence[Explained], by_chance: float) -> list[str]:
    """Return the effects that may win once SUMO shows what they do, best first; `by_chance` is chance's misfit."""
    best = max(explanation.log_evidence for explanation in explained)
    least = best - LOOKED_AT * temperature(explained, by_chance)
    return [explanation.name for explanation in explained if explanation.is_effect and explanation.log_evidence > least]


def check_in_sumo(
    null: NullModel,
    plain: DriveTallies,
    signatures: Mapping[str, Sequence[Signature]],
    by_chance: float,
    explain: Explain,
    is_expressible: Callable[[str], bool],
    run: Run,
) -> Checked:
    """Run effects at medium strength, then the best and those close behind until they are checked, or exact already.

    The likeliest comes first: once SUMO has shown that one explains the drives, few others may still win. Where `run`
    returns None, SUMO's runs failed, and the surrogate's word must do. `by_chance` is the misfit that chance leaves.
    """
    known, num_look_runs, looked_at = dict(signatures), 0, set[str]()
    explained = list(explain(known))
    while left := [
        name for name in worth_a_look(explained, by_chance) if name not in looked_at and is_expressible(name)
    ]:
        name = left[0]
        looked_at.add(name)
        likelier = next(explanation.strength for explanation in explained if explanation.name == name)
        medium = effect_named(name).medium
        best = signature_behind(known[name], Explained(name, 0.0, strength=np.copysign(medium, likelier)))
        strength = best.strengths[-1] if best.is_fixed else medium
        tallies = run(name, EffectSetting(best.sign * strength), True)
        if tallies is not None:
            known[name] = _corrected(known[name], best, strength, measured_shift(tallies, plain, null))
            num_look_runs += tallies.num_runs
            explained = list(explain(known))
    checks: list[Check] = []
    done: set[str] = set()
    for _ in range(NUM_CHECKED):
        left = [rival for rival in _contenders(explained) if rival.name not in done and is_expressible(rival.name)]
        if not left:
            break
        contender = left[0]
        done.add(contender.name)
        best = signature_behind(known[contender.name], contender)
        strength = best.strengths[-1] if best.is_fixed else abs(contender.strength)
        tallies = run(contender.name, EffectSetting(best.sign * strength), False)
        if tallies is None:
            continue
        shift, error = measured_shift(tallies, plain, null)
        in_surrogate = signature_behind(signatures[contender.name], contender)
        checks.append(_check(contender.name, in_surrogate, strength, shift, error, null, tallies.num_runs))
        known[contender.name] = _corrected(known[contender.name], best, strength, (shift, error))
        explained = list(explain(known))
    return Checked(explained, known, tuple(checks), num_look_runs)


def _corrected(
    several: Sequence[Signature], best: Signature, strength: float, measured: tuple[np.ndarray, np.ndarray]
) -> list[Signature]:
    """Return an effect's signatures, corrected but for those of the direction that SUMO has not shown."""
    return [corrected(each, best, strength, *measured) if each.sign == best.sign else each for each in several]


def corrected(
    signature: Signature, best: Signature, strength: float, shift: np.ndarray, error: np.ndarray
) -> Signature:
    """Return a signature that SUMO's corrects: at the strength that was run the precision-weighted mean of both.

    At other strengths, and for the same effect at another rhythm, the correction counts in proportion to the strength.
    The error is inf where SUMO showed nothing; where the surrogate did not, what SUMO shows is all that is known.
    """
    own, own_error = best.at(strength)
    own_variance = (SIGNATURE_ERROR * best.exactness * own) ** 2 + own_error**2
    is_measured = np.isfinite(error)
    weight = own_variance / np.maximum(own_variance + error**2, 1e-12)
    weight = np.where(is_measured & ~np.asarray(best.is_shown), 1.0, weight)
    change = weight * np.where(is_measured, shift - own, 0.0)
    remaining = np.where(weight < 1.0, np.sqrt(own_variance * (1.0 - weight)), np.where(is_measured, error, 0.0))
    share = (signature.strengths / strength)[:, None]
    return replace(
        signature,
        shift=signature.shift + share * change,
        error=np.where(share > 0.0, share * remaining, 0.0),
        exactness=np.minimum(signature.exactness, CHECKED_EXACTNESS),
        is_shown=signature.is_shown | is_measured,
    )


def _contenders(explained: Sequence[Explained]) -> list[Explained]:
    """Return the best effect and any that is close behind, best first, of those that do better than nothing."""
    effects = effects_above_none(explained)
    best = effects[0].log_evidence if effects else 0.0
    return [contender for contender in effects if contender.log_evidence > best - WITHIN]


def _check(
    effect: str,
    best: Signature,
    strength: float,
    shift: np.ndarray,
    error: np.ndarray,
    null: NullModel,
    num_runs: int,
) -> Check:
    precision = np.linalg.inv(null.covariance)
    own, _ = best.at(strength)
    seen = np.where(np.isfinite(error), shift, own)
    noise = float(np.diag(precision) @ np.where(np.isfinite(error), error, 0.0) ** 2)
    along, size = float(own @ precision @ seen), float(own @ precision @ own)
    other = float(seen @ precision @ seen) - noise
    is_above_noise = other > 0.0 and size > 0.0
    return Check(
        effect=effect,
        strength=float(best.sign * strength),
        num_runs=num_runs,
        agreement=float(np.clip(along / np.sqrt(size * other), -1.0, 1.0)) if is_above_noise else None,
        size_ratio=float(np.sqrt(other / size)) if is_above_noise else 0.0,
    )
