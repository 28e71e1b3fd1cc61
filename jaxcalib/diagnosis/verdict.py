"""From evidence to an answer: an effect, a set that cannot be told apart, something unknown, or nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.evidence import NONE, TEMPERATURE, UNKNOWN, Explained

PRIOR_NONE, PRIOR_UNKNOWN = 0.5, 0.1
# Natural logarithm of the evidence ratio that an effect needs against the baseline: "very strong" for Kass & Raftery.
# It must stay when the drive that favours it most is left out. How often null runs reach it: docs/diagnosis.md.
LEAST_EVIDENCE = 5.0
LEAST_WITHOUT_ONE = 4.0  # the same without the drive that favours it most
ALONE = 0.8  # no more than one in five effects named alone may be a wrong one
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


def probabilities(explained: Sequence[Explained], least_gain: float) -> dict[str, float]:
    """Return the probability of each explanation, none and unknown among them.

    Args:
        explained: all explanations.
        least_gain: gain of the best of them over the baseline that no single drive makes.
    """
    names = [one.name for one in explained]
    none = explained[names.index(NONE)].log_evidence
    num_effects = max(len(names) - 2, 1)
    prior = np.asarray(
        [
            {NONE: PRIOR_NONE, UNKNOWN: PRIOR_UNKNOWN}.get(name, (1.0 - PRIOR_NONE - PRIOR_UNKNOWN) / num_effects)
            for name in names
        ]
    )
    gain = np.asarray([one.log_evidence - none for one in explained])
    is_none = np.asarray([name == NONE for name in names])
    prior_of, gain_of = prior[~is_none], gain[~is_none]
    something = np.log(prior_of) + gain_of
    # whether there is something is judged untempered, but on what no single drive makes
    total = float(np.logaddexp.reduce(something)) - max(float(gain_of.max()) - least_gain, 0.0)
    share_of_none = 1.0 / (1.0 + np.exp(np.clip(total - np.log(PRIOR_NONE), -700, 700)))
    tempered = np.log(prior_of) + gain_of / TEMPERATURE
    share = np.exp(tempered - np.logaddexp.reduce(tempered))
    values = np.zeros(len(names))
    values[is_none] = share_of_none
    values[~is_none] = (1.0 - share_of_none) * share
    return dict(zip(names, values.tolist(), strict=True))


def judge(explained: Sequence[Explained], least_gain: float, shift_errors: float, few_drives: bool) -> Verdict:
    """Return the verdict.

    Args:
        explained: all explanations.
        least_gain: gain of the best of them over the baseline that no single drive makes.
        shift_errors: by how many of its errors the calibration moved the parameters away from the scenario's.
        few_drives: whether there are too few drives to name one effect.
    """
    probability = probabilities(explained, least_gain)
    by_name = {one.name: one for one in explained}
    none = by_name[NONE].log_evidence
    best_gain = max(one.log_evidence for one in explained if one.name != NONE) - none
    ranked = sorted((one for one in explained if one.name != NONE), key=lambda one: -probability[one.name])
    if best_gain < LEAST_EVIDENCE or least_gain < LEAST_WITHOUT_ONE:
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
