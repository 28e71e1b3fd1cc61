"""What is left once the best effect is in: a second effect, a ceiling for all of them together, what to try next."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    TEMPERATURE,
    Explained,
    alike_errors,
    log_density,
    predicted,
    signature_behind,
    strengths_of,
)
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE, Verdict
from surrogate.effects.registry import effect_named

FLEXIBLE_STRENGTHS = 1.0  # prior standard deviation of each effect's strength, in medium ones


def second_effect(
    difference: np.ndarray,
    null: NullModel,
    first: Explained,
    signatures: Mapping[str, Sequence[Signature]],
    num_places: Mapping[str, int],
) -> Explained | None:
    """Return the effect that, together with the first, explains more than the first alone; None where none does.

    Both strengths are judged together, and what both signatures may be wrong by counts as noise: a first effect whose
    strength took in part of the second gives it back. The log evidence of the second is the gain over the first alone.
    """
    if first.name not in signatures:
        return None
    alike = alike_errors(null)
    own = signature_behind(signatures[first.name], first)
    firsts = [predicted(own, strength, alike) for strength in strengths_of(own, effect_named(first.name).medium)]
    alone = _evidence([log_density(difference - s, null.covariance + c)[0] for s, c in firsts])
    candidates = []
    others = [name for name in signatures if name != first.name]
    for name in others:
        values, strengths = [], []
        for signature in signatures[name]:
            for strength in strengths_of(signature, effect_named(name).medium):
                shift, uncertain = predicted(signature, strength, alike)
                values += [log_density(difference - s - shift, null.covariance + c + uncertain)[0] for s, c in firsts]
                strengths += [signature.sign * strength] * len(firsts)
        gain = _evidence(values) - alone - np.log(num_places.get(name, 1))
        share = np.exp((np.asarray(values) - max(values)) / TEMPERATURE)
        candidates.append(Explained(name, float(gain), float(share @ np.asarray(strengths) / share.sum())))
    best = max(candidates, key=lambda explanation: explanation.log_evidence, default=None)
    if best is None:
        return None
    # Between explanations evidence counts a part only, and each of the others had its chance.
    counted = best.log_evidence / TEMPERATURE - np.log(len(others))
    return best if counted >= LEAST_EVIDENCE else None


def _evidence(values: Sequence[float]) -> float:
    return float(logsumexp(values) - np.log(len(values)))


def most_flexible_shift(
    difference: np.ndarray, null: NullModel, signatures: Mapping[str, Sequence[Signature]]
) -> np.ndarray:
    """Shift by all effects together, each of the strength, of either sign, that fits best.

    No single answer: the most that the library could explain, as a ceiling for the answers.
    """
    columns = [
        signature.shift[-1] * effect_named(name).medium / signature.strengths[-1]
        for name, several in signatures.items()
        for signature in several
    ]
    if not columns:
        return np.zeros_like(difference)
    all_of_them = FLEXIBLE_STRENGTHS * np.stack(columns, axis=1)
    covariance = null.covariance + all_of_them @ all_of_them.T
    return all_of_them @ (all_of_them.T @ np.linalg.solve(covariance, difference))


def next_steps(
    verdict: Verdict,
    second: Explained | None,
    alike: Mapping[str, Sequence[str]],
    largest: Sequence[str],
    visible_with_more: Mapping[str, float | None],
    visible: Mapping[str, float | None],
) -> list[str]:
    """Advice on what to try next, in sentences; `largest` names the largest parts of the gap."""
    lines = []
    if verdict.kind == "effect":
        lines.append(f"Put {_words(verdict.effects[0])} into the simulation and calibrate again with it.")
        for name in verdict.effects:
            if alike.get(name):
                lines.append(f"{_words(name)} looks like {_list(alike[name])} on this road: measure it directly.")
    if verdict.kind == "class":
        lines.append(
            f"Tell {_list(verdict.effects)} apart: drives on other stretches, at other times or in other traffic, or a "
            "measurement of one of them."
        )
    if second is not None and verdict.effects:
        lines.append(
            f"{_words(second.name)} would explain part of what is left (log evidence {second.log_evidence:.1f}); test "
            "it once the first is in."
        )
    if verdict.kind == "unknown":
        lines.append(f"Look at {_list(largest)}: they hold the largest parts of what no known effect explains.")
    if verdict.kind in ("no_gap", "miscalibrated"):
        gains = [
            (name, now, then)
            for name, then in visible_with_more.items()
            if then is not None and ((now := visible.get(name)) is None or then < 0.9 * now)
        ]
        if verdict.kind == "miscalibrated":
            lines.append("Take the calibrated values over into the scenario.")
        if gains:
            some = ", ".join(f"{_words(name)} from {then:.2g} on" for name, _, then in gains[:4])
            lines.append(f"Three more drives would show weaker effects, for example {some}.")
    return lines


def best_effect(explained: Sequence[Explained], verdict: Verdict) -> Explained | None:
    """Return the explanation behind the first effect that is named; None where none is."""
    named = [
        explanation for explanation in explained if explanation.is_effect and explanation.name in verdict.effects[:1]
    ]
    return named[0] if named else None


def _words(name: str) -> str:
    return name.replace("_", " ")


def _list(names: Sequence[str]) -> str:
    words = [_words(name) for name in names]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
