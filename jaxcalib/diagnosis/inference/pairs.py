"""Two effects at once as an explanation: what neither of them explains alone, and no third one either.

The traces of two effects add up to one that may look like that of a third. So pairs are judged beside single effects,
all among the best few, both strengths together, with what both signatures may be wrong by.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    TEMPERATURE,
    UNKNOWN,
    Explained,
    interval_90,
    knees_of,
    log_density,
    open_form,
    signature_behind,
    squeezed,
    strengths_of,
    told_strength,
    uncertainty,
)
from jaxcalib.diagnosis.inference.overdispersion import temperature_at
from jaxcalib.diagnosis.inference.verdict import ALONE, LEAST_EVIDENCE
from surrogate.effects.registry import effect_named

AMONG_BEST = 8
EVERY_STRENGTH = 2  # of those at which a single effect is judged: both together are judged at each pair of them


@dataclass(frozen=True)
class Pair:
    """Two effects."""

    names: tuple[str, str]
    log_evidence: float  # logarithm of the marginal likelihood
    strengths: tuple[float, float]  # posterior means, with their signs
    intervals: tuple[tuple[float, float], tuple[float, float]]  # their 90 % intervals
    shift: np.ndarray  # expected signature of both together, at the posterior
    misfit: float  # whitened squared misfit at the best strengths


@dataclass(frozen=True)
class Pairs:
    """The best pair, and what it tells of its two effects."""

    best: Pair
    gain: float  # log evidence of the best pair above that of the best single explanation
    sure: tuple[str, ...]  # its effects that are in most of what pairs believe


def judge_pairs(
    difference: np.ndarray,
    null: NullModel,
    explained: Sequence[Explained],
    signatures: Mapping[str, Sequence[Signature]],
    num_places: Mapping[str, int],
    by_chance: float,
) -> Pairs | None:
    """Return the pairs where one explains far more than any single effect, or something unknown, does; None otherwise.

    Args:
        difference: the drives' features less the baseline's, in units of noise.
        null: the null model.
        explained: single explanations, best first.
        signatures: of all effects.
        num_places: how many places and times were looked at for each local effect.
        by_chance: squared misfit that chance leaves.
    """
    best = [each for each in explained if each.is_effect and each.name in signatures][:AMONG_BEST]
    if len(best) < 2:
        return None
    knees = knees_of(null.cells)
    traces = {each.name: _traces(signatures[each.name], each, knees) for each in best}
    looked = {each.name: float(np.log(num_places.get(each.name, 1))) for each in best}
    pairs = []
    for one, other in combinations(best, 2):
        pair = _judged(difference, null, (one.name, other.name), traces)
        pairs.append((pair.log_evidence - looked[one.name] - looked[other.name], pair))
    evidence = np.asarray([value for value, _ in pairs])
    at = int(np.argmax(evidence))
    rivals = {UNKNOWN, *traces}
    gain = float(evidence[at]) - max(each.log_evidence for each in explained if each.name in rivals)
    chosen = pairs[at][1]
    temperature = temperature_at(chosen.misfit, by_chance)
    if gain / temperature - np.log(len(pairs)) < LEAST_EVIDENCE:  # each of the others had its chance
        return None
    share = np.exp(evidence / temperature - np.logaddexp.reduce(evidence / temperature))
    believed = {name: sum(s for s, (_, p) in zip(share, pairs, strict=True) if name in p.names) for name in traces}
    sure = tuple(name for name in chosen.names if believed[name] >= ALONE)
    return Pairs(chosen, gain, sure if best[0].name in sure else ())


def with_pair(explained: Sequence[Explained], pair: Pair) -> list[Explained]:
    """Return explanations with the strengths that a pair's two effects have beside each other."""
    told = dict(zip(pair.names, zip(pair.strengths, pair.intervals, strict=True), strict=True))
    changed = []
    for each in explained:
        strength, interval = told.get(each.name, (each.strength, each.interval))
        changed.append(replace(each, strength=strength, interval=interval))
    return changed


class _Trace(NamedTuple):
    """An effect at a strength."""

    strength: float  # as it is told
    shift: np.ndarray  # its signature, in units of noise
    uncertain: np.ndarray  # covariance of that one's error
    open_form: float  # how far its form is open


def _traces(several: Sequence[Signature], explanation: Explained, knees: np.ndarray) -> list[_Trace]:
    """Return an effect at several strengths, at the place where it alone agrees best."""
    own = signature_behind(several, explanation)
    medium = effect_named(explanation.name).medium
    return [
        _trace(signature, strength, knees)
        for signature in ([each for each in several if each.is_fixed] if own.is_fixed else [own])
        for strength in strengths_of(signature, medium)[:: 1 if own.is_fixed else EVERY_STRENGTH]
    ]


def _trace(signature: Signature, strength: float, knees: np.ndarray) -> _Trace:
    shift, error = signature.at(strength)
    uncertain = uncertainty(signature, shift, error, knees)
    return _Trace(told_strength(signature, strength), shift, uncertain, open_form(signature))


def _judged(
    difference: np.ndarray, null: NullModel, names: tuple[str, str], traces: Mapping[str, Sequence[_Trace]]
) -> Pair:
    both = list(product(*(traces[name] for name in names)))
    knees = knees_of(null.cells)
    seen = squeezed(difference, knees)
    judged = [
        log_density(seen - squeezed(one.shift + other.shift, knees), null.covariance + one.uncertain + other.uncertain)
        for one, other in both
    ]
    log_values = np.asarray([value for value, _ in judged])
    tempered = log_values / TEMPERATURE
    posterior = np.exp(tempered - np.logaddexp.reduce(tempered))
    best = int(np.argmax(log_values))
    strengths = np.asarray([[trace.strength for trace in combined] for combined in both])
    first, second = posterior @ strengths
    low_high = [interval_90(strengths[:, place], posterior, both[best][place].open_form) for place in (0, 1)]
    return Pair(
        names=names,
        log_evidence=float(logsumexp(log_values) - np.log(len(both))),
        strengths=(float(first), float(second)),
        intervals=(low_high[0], low_high[1]),
        shift=posterior @ np.asarray([one.shift + other.shift for one, other in both]),
        misfit=judged[best][1],
    )
