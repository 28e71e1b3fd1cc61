"""From evidence to an answer: an effect, a set that cannot be told apart, something unknown, or nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from jaxcalib.diagnosis.evidence import NONE, UNKNOWN, Explained

PRIOR_NONE, PRIOR_UNKNOWN = 0.5, 0.1
# Natural logarithm of the evidence ratio that an effect needs against the baseline; "very strong" for Kass & Raftery.
# On pseudo-fields made of null runs its maximum over all effects stays below: docs/diagnosis.md.
LEAST_EVIDENCE = 5.0
# Explanations are told apart by the shape of signatures that a surrogate made; its errors are alike in neighbouring
# features, which the model counts as independent. So differences between explanations count for less than they seem.
TEMPERATURE = 4.0
ALONE = 0.7
IN_SET = 0.9
LARGEST_SET = 3
MISCALIBRATED_ERRORS = 3.0


@dataclass(frozen=True)
class Verdict:
    """The answer.

    Attributes:
        kind: no_gap, miscalibrated, effect, class, unknown or not_testable.
        effects: one, several that cannot be told apart, or none.
        probability: of each explanation; they sum to 1.
        reason: one line for people.
    """

    kind: str
    effects: tuple[str, ...]
    probability: Mapping[str, float]
    reason: str


def probabilities(explained: Sequence[Explained]) -> dict[str, float]:
    """Return the probability of each explanation, none and unknown among them."""
    names = [one.name for one in explained]
    log_evidence = np.asarray([one.log_evidence for one in explained])
    none = log_evidence[names.index(NONE)]
    num_effects = max(len(names) - 2, 1)
    prior = np.asarray(
        [
            {NONE: PRIOR_NONE, UNKNOWN: PRIOR_UNKNOWN}.get(name, (1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / num_effects)
            for name in names
        ]
    )
    gain = log_evidence - none
    is_none = np.asarray([name == NONE for name in names])
    something = np.log(prior[~is_none]) + gain[~is_none]
    total = float(logsumexp(something))  # something is there: judged untempered
    share_of_none = 1.0 / (1.0 + np.exp(np.clip(total - np.log(PRIOR_NONE), -700, 700)))
    tempered = np.log(prior[~is_none]) + gain[~is_none] / TEMPERATURE
    share = np.exp(tempered - logsumexp(tempered))
    values = np.zeros(len(names))
    values[is_none] = share_of_none
    values[~is_none] = (1.0 - share_of_none) * share
    return dict(zip(names, values.tolist(), strict=True))


def judge(explained: Sequence[Explained], shift_errors: float, few_drives: bool) -> Verdict:
    """Return the verdict.

    Args:
        explained: all explanations.
        shift_errors: by how many of its errors the calibration moved the parameters away from the scenario's.
        few_drives: whether there are too few drives to name one effect.
    """
    probability = probabilities(explained)
    by_name = {one.name: one for one in explained}
    none = by_name[NONE].log_evidence
    ranked = sorted((one for one in explained if one.name != NONE), key=lambda one: -probability[one.name])
    if ranked[0].log_evidence - none < LEAST_EVIDENCE:
        if shift_errors > MISCALIBRATED_ERRORS:
            return Verdict("miscalibrated", (), probability, "The scenario's values differ from the road's; with "
                           "calibrated values nothing is left that noise does not explain.")  # fmt: skip
        return Verdict("no_gap", (), probability, "Simulation and road differ by no more than noise.")
    if ranked[0].name == UNKNOWN:
        return Verdict("unknown", (), probability, "Something is missing that is none of the known effects.")
    chosen: list[str] = []
    total = 0.0
    among = sum(probability[one.name] for one in ranked)
    for one in ranked:
        if one.name == UNKNOWN or len(chosen) == LARGEST_SET:
            break
        chosen.append(one.name)
        total += probability[one.name] / among
        if total >= (IN_SET if len(chosen) > 1 else ALONE):
            break
    if len(chosen) == 1 and not few_drives:
        return Verdict("effect", tuple(chosen), probability, "One effect explains the gap best.")
    return Verdict("class", tuple(chosen), probability, "These effects cannot be told apart on these drives.")
