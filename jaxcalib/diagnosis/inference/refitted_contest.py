"""Which explanations are fitted again, and the contest between them once they are."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import UNKNOWN, Explained, effects_above_none
from jaxcalib.diagnosis.inference.refit import Refit
from jaxcalib.diagnosis.inference.sumo_check import CHECKED_EXACTNESS
from jaxcalib.diagnosis.inference.verdict import Verdict

# Times what chance leaves in the mean. Of right explanations, fitted again, five left 0.3 to 1.9 times as much; of
# wrong ones one 1.6, as the right one did, and five 2.3 to 3.2.
MOST_LEFT = 2.0


def contenders(
    explained: Sequence[Explained], signatures: Mapping[str, Sequence[Signature]], verdict: Verdict
) -> list[Explained]:
    """Return the effects that a verdict names, best first, as far as they have signatures; the best one for unknown.

    A signature that only the surrogate tells may be wrong by more, and so bends to more. Where such effects alone are
    named, the best one that SUMO has shown is fitted again with them. Of two effects that are both there the likelier
    one is: whether it needs the other shows then.
    """
    effects = [each for each in effects_above_none(explained) if each.name in signatures]
    if verdict.kind == "unknown":
        return effects[:1]
    if verdict.kind == "pair":
        return [each for each in effects if each.name in verdict.effects][:1]
    named = [each for each in effects if each.name in verdict.effects]
    shown = [each for each in effects if _is_shown_by_sumo(signatures[each.name])]
    return named if any(each in shown for each in named) else [*named, *shown[:1]]


def _is_shown_by_sumo(signatures: Sequence[Signature]) -> bool:
    return all(float(np.max(signature.exactness)) <= CHECKED_EXACTNESS for signature in signatures)


def with_refits(explained: Sequence[Explained], refits: Mapping[str, Refit]) -> list[Explained]:
    """Return explanations, best first, with the strengths of those that were fitted again, and told apart by it.

    Refits tell how far apart two effects lie: signatures are linear, and those that only the surrogate tells bend to
    more. The best of them keeps the most evidence of all, against none, unknown and the rest. The interval of a
    strength holds that of both readings.
    """
    again = [explanation for explanation in explained if explanation.name in refits]
    if not again:
        return list(explained)
    most = max(explanation.log_evidence for explanation in again)
    best = max(refits[explanation.name].log_evidence for explanation in again)
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
                log_evidence=most - (best - mine.log_evidence),
                strength=mine.sign * mine.strength,
                interval=(bounds[0], bounds[-1]),
                best_misfit=mine.misfit,
            )
        )
    return sorted(counted, key=lambda explanation: -explanation.log_evidence)


def is_enough_alone(refits: Mapping[str, Refit], by_chance: float) -> bool:
    """Whether one effect, fitted again, leaves no more than one that is right does, and so needs no second one.

    Signatures of one effect are wrong in detail, and a second one mends that.
    """
    return any(refit.misfit <= MOST_LEFT * by_chance for refit in refits.values())


def without_poor_fits(
    verdict: Verdict, refits: Mapping[str, Refit], by_chance: float, never_alone: Collection[str] = ()
) -> Verdict:
    """Return a verdict without the effects that leave too much even where strength and parameters were fitted again.

    The best of all explanations may be a poor one: then what is missing is none of the effects. Their probability goes
    to the unknown.

    Args:
        verdict: names one effect, or several that cannot be told apart.
        refits: by effect; one that was not fitted again stays.
        by_chance: squared misfit that chance leaves in the mean.
        never_alone: effects that these drives cannot tell from others: none is named alone, though the others with it
            leave too much.
    """
    left = {name: refits[name].misfit / by_chance for name in verdict.effects if name in refits}
    poor = [name for name in left if left[name] > MOST_LEFT]
    if not poor:
        return verdict
    told = {name: 0.0 if name in poor else share for name, share in verdict.probability.items()}
    told[UNKNOWN] += sum(verdict.probability[name] for name in poor)
    kept = tuple(name for name in verdict.effects if name not in poor)
    if not kept or told[UNKNOWN] >= sum(told[name] for name in kept):
        reason = (
            f"Something is missing that is none of the known effects: the best of them, "
            f"{poor[0].replace('_', ' ')}, leaves {left[poor[0]]:.1f} times as much as chance does."
        )
        return Verdict("unknown", (), told, reason)
    if len(kept) != 1:
        return replace(verdict, effects=kept, probability=told)
    if kept[0] in never_alone:
        return verdict
    reason = "One effect explains the gap; what looks like it leaves too much where all are fitted again."
    return Verdict("effect", kept, told, reason)
