"""Which explanations are fitted again, and the contest between them once they are."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.evidence import NONE, UNKNOWN, Explained
from jaxcalib.diagnosis.inference.refit import Refit
from jaxcalib.diagnosis.inference.sumo_check import NUM_CHECKED, WITHIN


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
