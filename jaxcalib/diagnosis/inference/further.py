"""What is left once the best effect is in: a ceiling for all effects together, and what to try next."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.verdict import Verdict
from surrogate.effects.registry import effect_named

FLEXIBLE_STRENGTHS = 1.0  # prior standard deviation of each effect's strength, in medium ones


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
    if verdict.kind == "pair":
        lines.append(f"Put {_list(verdict.effects)} into the simulation, both at once, and calibrate again with them.")
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
