"""From evidence to an answer: an effect, a set that cannot be told apart, something unknown, or nothing."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, UNKNOWN, Explained, best_gain

# No simulation lacks nothing: that none of 22 effects is there at any strength is not the likeliest thing beforehand.
# An answer other than none needs the evidence below whatever these say; they decide how sure the ranking is of none.
PRIOR_NONE, PRIOR_UNKNOWN = 0.2, 0.1
# Natural logarithm of the evidence ratio that an effect needs against the baseline: "very strong" for Kass & Raftery.
# How often null runs reach it: docs/diagnosis.md.
LEAST_EVIDENCE = 5.0
ALONE = 0.8  # no more than one in five effects named alone may be a wrong one
IN_SET = 0.9
LARGEST_SET = 3
MISCALIBRATED_ERRORS = 3.0
WORTH_NAMING = 0.5  # of the probability of all that may be missing: a set that has less says nothing


@dataclass(frozen=True)
class Verdict:
    """The answer."""

    kind: str  # no_gap, miscalibrated, effect, pair, class, unknown or not_testable
    effects: tuple[str, ...]  # one, two that are both there, several that cannot be told apart, or none
    probability: Mapping[str, float]  # of each explanation; they sum to 1
    reason: str  # one line for people


def beforehand(names: Sequence[str]) -> dict[str, float]:
    """Return the probability of each explanation before any drive, none and unknown among them."""
    of_effect = (1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / max(len(names) - 2, 1)
    return {name: {NONE: PRIOR_NONE, UNKNOWN: PRIOR_UNKNOWN}.get(name, of_effect) for name in names}


def probabilities(explained: Sequence[Explained], least: float, temperature: float) -> dict[str, float]:
    """Return the probability of each explanation, none and unknown among them; for the numbers see `judge`."""
    names = [explanation.name for explanation in explained]
    none = explained[names.index(NONE)].log_evidence
    prior = np.asarray(list(beforehand(names).values()))
    gain = np.asarray([explanation.log_evidence - none for explanation in explained])
    is_none = np.asarray([name == NONE for name in names])
    prior_of, gain_of = prior[~is_none], gain[~is_none]
    something = np.log(prior_of) + gain_of
    # whether there is something is judged untempered, but on what neither a single drive makes nor chance
    total = float(np.logaddexp.reduce(something)) - max(float(gain_of.max()) - least, 0.0)
    share_of_none = 1.0 / (1.0 + np.exp(np.clip(total - np.log(PRIOR_NONE), -700, 700)))
    tempered = np.log(prior_of) + gain_of / temperature
    share = np.exp(tempered - np.logaddexp.reduce(tempered))
    values = np.zeros(len(names))
    values[is_none] = share_of_none
    values[~is_none] = (1.0 - share_of_none) * share
    return dict(zip(names, values.tolist(), strict=True))


def judge(
    explained: Sequence[Explained],
    least: float,
    temperature: float,
    shift_errors: float,
    few_drives: bool,
    aliased: Collection[str] = (),
    sure_of_pair: tuple[str, ...] | None = None,
) -> Verdict:
    """Return the verdict.

    Args:
        explained: all explanations.
        least: gain of the best of them over the baseline that neither a single drive makes nor chance.
        temperature: what evidence between explanations is divided by (see `overdispersion`).
        shift_errors: by how many of its errors the calibration moved the parameters away from the scenario's.
        few_drives: whether there are too few drives to name one effect: the next likely one is named with it.
        aliased: effects that these drives cannot tell apart; one of them is not named without another.
        sure_of_pair: effects that are surely there where two effects explain more than one does; None where not.
    """
    probability = probabilities(explained, least, temperature)
    ranked = sorted(
        (explanation for explanation in explained if explanation.name != NONE),
        key=lambda explanation: -probability[explanation.name],
    )
    if min(least, best_gain(explained)) < LEAST_EVIDENCE:
        if shift_errors > MISCALIBRATED_ERRORS:
            reason = "calibrated values the drives to fit leave nothing that noise does not explain."
            return Verdict(
                "miscalibrated", (), probability, f"The scenario's values differ from the road's; with {reason}"
            )
        return Verdict("no_gap", (), probability, "Simulation and road differ by no more than noise.")
    effects = [explanation for explanation in ranked if explanation.name != UNKNOWN]
    if sure_of_pair and not few_drives and not set(sure_of_pair) & set(aliased):
        return _verdict_of_pair(sure_of_pair, probability)
    if probability[UNKNOWN] > sum(probability[explanation.name] for explanation in effects):
        return Verdict("unknown", (), probability, "Something is missing that is none of the known effects.")
    chosen: list[str] = []
    total = 0.0
    among = sum(probability[explanation.name] for explanation in effects)
    for explanation in effects:
        if len(chosen) == LARGEST_SET:
            break
        chosen.append(explanation.name)
        total += probability[explanation.name] / among
        if total >= (IN_SET if len(chosen) > 1 else ALONE):
            break
    if sum(probability[name] for name in chosen) < WORTH_NAMING * (1.0 - probability[NONE]):
        return Verdict("unknown", (), probability, "Something is missing, and these drives do not tell what.")
    if len(chosen) == 1 and (few_drives or chosen[0] in aliased):
        others = [explanation.name for explanation in effects[1:] if few_drives or explanation.name in aliased]
        chosen += others[:1]
    if len(chosen) == 1:
        return Verdict("effect", tuple(chosen), probability, "One effect explains the gap best.")
    return Verdict("class", tuple(chosen), probability, "These effects cannot be told apart on these drives.")


def _verdict_of_pair(sure: tuple[str, ...], probability: Mapping[str, float]) -> Verdict:
    """Return the verdict where two effects are there, of which one at least is sure."""
    is_something = 1.0 - probability[NONE]
    told = {name: is_something * (name in sure) / len(sure) for name in probability} | {NONE: probability[NONE]}
    if len(sure) == 1:
        return Verdict("effect", sure, told, "This effect is there, and another one that these drives leave open.")
    return Verdict("pair", sure, told, "Two effects together explain the gap; neither does alone.")
