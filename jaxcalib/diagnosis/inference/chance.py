"""What of the evidence no single drive makes, and how much of it drives without any effect have by chance.

Jams come in some drives only, and their noise has a longer tail than any covariance tells; an effect shows in most. So
evidence counts without the drive that favours it most, and it has to exceed what nearly all sets of drives without
effect have, which are judged as the field is, by the runs that they are not of.

Source: the jackknife's deletions, Efron (1982), The Jackknife, the Bootstrap and Other Resampling Plans, ch. 2; a test
by what simulated sets of data have, Barnard (1963), J. R. Stat. Soc. B 25, 294.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.left_out import LeftOut
from jaxcalib.diagnosis.inference.marginal_likelihood import (
    effect_evidence,
    effect_likelihoods,
    groups_of,
    knees_of,
    log_densities,
    mean_likelihood,
    squeezed,
    unknown_likelihoods,
)
from surrogate.effects.registry import effect_named

CHANCE_LEVEL = 0.95  # share of sets without effect whose evidence the field's has to exceed

Signatures = Mapping[str, Sequence[Signature]]


def best_gains(
    differences: np.ndarray, null: NullModel, signatures: Signatures, num_places: Mapping[str, int]
) -> np.ndarray:
    """Return the log evidence of the best explanation less that of the baseline, [set].

    Args:
        differences: those of sets of drives, [set, feature], in units of noise.
        null: the null model.
        signatures: of all effects.
        num_places: how many places and times were looked at for each local effect.
    """
    judged = squeezed(differences, knees_of(null.cells))
    evidence = [mean_likelihood(unknown_likelihoods(judged, null, groups_of(null.cells))[0])]
    for name, several in signatures.items():
        likelihoods = effect_likelihoods(judged, null, several, effect_named(name).medium)
        evidence.append(effect_evidence(likelihoods, num_places.get(name, 1)))
    return np.max(evidence, axis=0) - log_densities(judged, null.covariance)[0]


def gain_by_chance(
    left_out: Sequence[LeftOut], null: NullModel, signatures: Signatures, num_places: Mapping[str, int]
) -> float:
    """Return the gain, without the drive that favours it most, that few sets of drives without effect exceed.

    Args:
        left_out: the sets; none say that chance has nothing.
        null: the field's null model, in whose units the signatures are.
        signatures: of all effects.
        num_places: how many places and times were looked at for each local effect.
    """
    gains: list[float] = []
    for each in left_out:
        ratio = each.null.deviation / null.deviation
        theirs = replace(null, covariance=each.null.covariance * np.outer(ratio, ratio))
        flat = (ratio * each.differences).reshape(-1, len(ratio))
        found = best_gains(flat, theirs, signatures, num_places)
        gains += found.reshape(each.differences.shape[:2]).min(axis=1).tolist()
    return float(np.quantile(gains, CHANCE_LEVEL)) if gains else 0.0
