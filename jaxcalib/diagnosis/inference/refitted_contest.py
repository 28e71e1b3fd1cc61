"""Which explanations are fitted again, and the contest between them once they are."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import UNKNOWN, Explained, effects_above_none
from jaxcalib.diagnosis.inference.refit import Refit
from jaxcalib.diagnosis.inference.verdict import Verdict

# Times what chance leaves in the median. Of fourteen right explanations, fitted again, one left 6.7 times as much, the
# others 1.3 to 3.6; of six wrong ones each left 4.3 to 20.
MOST_LEFT = 4.0


def contenders(
    explained: Sequence[Explained], signatures: Mapping[str, Sequence[Signature]], verdict: Verdict
) -> list[Explained]:
    """Return the effects that a verdict names, best first, as far as they have signatures; the best one for unknown.

    Two effects that are both there are not fitted again one by one.
    """
    effects = [each for each in effects_above_none(explained) if each.name in signatures]
    if verdict.kind == "unknown":
        return effects[:1]
    return [] if verdict.kind == "pair" else [each for each in effects if each.name in verdict.effects]


def with_refits(explained: Sequence[Explained], refits: Mapping[str, Refit]) -> list[Explained]:
    """Return explanations, best first, with the strengths of those that were fitted again, and told apart by it.

    The signatures' evidence and the refits' are two readings of one quantity, each with errors of its own, and their
    mean says how far apart two effects lie. The best of them keeps the most evidence of all, against none, unknown and
    the rest. The interval of a strength holds that of both readings.
    """
    again = [explanation for explanation in explained if explanation.name in refits]
    if not again:
        return list(explained)
    most = max(explanation.log_evidence for explanation in again)
    mean = {
        explanation.name: 0.5 * (explanation.log_evidence + refits[explanation.name].log_evidence)
        for explanation in again
    }
    counted = []
    for explanation in explained:
        if explanation.name not in refits:
            counted.append(explanation)
            continue
        mine = refits[explanation.name]
        bounds = sorted((*(mine.sign * size for size in mine.interval_90), *explanation.interval))
        counted.append(
            replace(
                explanation,
                log_evidence=most - (max(mean.values()) - mean[explanation.name]),
                strength=mine.sign * mine.strength,
                interval=(bounds[0], bounds[-1]),
                best_misfit=min(explanation.best_misfit, mine.misfit),
            )
        )
    return sorted(counted, key=lambda explanation: -explanation.log_evidence)


def without_poor_fits(verdict: Verdict, refits: Mapping[str, Refit], by_chance: float) -> Verdict:
    """Return a verdict without the effects that leave too much even where strength and parameters were fitted again.

    The best of all explanations may be a poor one: then what is missing is none of the effects. Their probability goes
    to the unknown.

    Args:
        verdict: names one effect, or several that cannot be told apart.
        refits: by effect; one that was not fitted again stays.
        by_chance: squared misfit that chance leaves in the median.
    """
    left = {name: refits[name].misfit / by_chance for name in verdict.effects if name in refits}
    poor = [name for name in left if left[name] > MOST_LEFT]
    if not poor:
        return verdict
    told = {name: 0.0 if name in poor else share for name, share in verdict.probability.items()}
    told[UNKNOWN] += sum(verdict.probability[name] for name in poor)
    kept = tuple(name for name in verdict.effects if name not in poor)
    if told[UNKNOWN] >= sum(told[name] for name in kept):
        reason = (
            f"Something is missing that is none of the known effects: the best of them, "
            f"{poor[0].replace('_', ' ')}, leaves {left[poor[0]]:.1f} times as much as chance does."
        )
        return Verdict("unknown", (), told, reason)
    return replace(verdict, kind="effect" if len(kept) == 1 else "class", effects=kept, probability=told)
