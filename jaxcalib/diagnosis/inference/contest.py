"""The contest of the explanations: evidence on the drives to fit, as far as other drives confirm it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.cross_validation import cross_validated_gains
from jaxcalib.diagnosis.inference.evidence import NEARLY_ALL, NONE, UNKNOWN, Explained, most_misfit
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, explanations, moved, prepare
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.problem.problem import CalibrationProblem

Signatures = Mapping[str, Sequence[Signature]]


@dataclass(frozen=True)
class Contest:
    """What explanations are judged by.

    Attributes:
        problem: the problem.
        values: calibrated values.
        fitted: null model and features of the drives to fit.
        runs: SUMO runs with the calibrated values.
        trials: trials of the parameters.
        num_places: how many places were looked at for each local effect.
    """

    problem: CalibrationProblem
    values: np.ndarray
    fitted: Prepared
    runs: NullRuns
    trials: Mapping[str, DriveTallies]
    num_places: Mapping[str, int]
    _known_gains: dict[str, tuple[Sequence[Signature], float]] = field(default_factory=dict)

    def explain(self, signatures: Signatures) -> list[Explained]:
        """Return the explanations, best first: an effect's evidence counts as far as other drives confirm it."""
        gains = self._gains(signatures)
        found = explanations(self.problem, self.values, self.fitted, signatures, self.num_places)
        return without_needless_unknown(confirmed(found, gains), len(self.fitted.null.cells))

    def least_gain(self, signatures: Signatures) -> float:
        """Return the gain of the best explanation over the baseline when the drive that favours it most is left out.

        Jams come in some drives only, and their noise has a longer tail than any covariance tells; an effect shows in
        most.
        """
        gains = self._gains(signatures)
        everyone = np.arange(len(self.fitted.tallies))
        found = []
        for place in everyone:
            try:
                some = self._prepared(self.fitted.tallies.take(np.setdiff1d(everyone, [place])))
            except NotTestableError:
                continue  # the others alone show too little
            there = {name: [moved(one, self.fitted, some) for one in several] for name, several in signatures.items()}
            explained = explanations(self.problem, self.values, some, there, self.num_places)
            found.append(best_gain(without_needless_unknown(confirmed(explained, gains), len(some.null.cells))))
        return min(found, default=0.0)

    def _gains(self, signatures: Signatures) -> dict[str, float]:
        """Return the cross-validated gain of each effect; signatures that were judged before are not judged again."""
        new = [name for name, several in signatures.items() if not self._is_known(name, several)]
        gains = cross_validated_gains(new, self.fitted, self._prepared, signatures, self.num_places)
        for name, gain in gains.items():
            self._known_gains[name] = (signatures[name], gain)
        return {name: self._known_gains[name][1] for name in signatures if name in self._known_gains}

    def _is_known(self, name: str, several: Sequence[Signature]) -> bool:
        return name in self._known_gains and self._known_gains[name][0] is several

    def _prepared(self, tallies: DriveTallies) -> Prepared:
        return prepare(self.problem, tallies, self.runs, self.trials)


def confirmed(explained: Sequence[Explained], gains: Mapping[str, float]) -> list[Explained]:
    """Return explanations with what of their evidence other drives confirm, best first.

    An effect's support is its evidence or its cross-validated gain, whichever is less. The best supported keeps its
    evidence, against none and unknown, which predict nothing that could be judged so; the others lie behind it by what
    they have less of support. An effect without support is worth no more than the baseline.

    Args:
        explained: explanations.
        gains: cross-validated gains, by effect; an effect without one keeps its evidence.
    """
    none = next(one.log_evidence for one in explained if one.name == NONE)
    support = {one.name: min(one.log_evidence - none, gains[one.name]) for one in explained if one.name in gains}
    supported = [one for one in explained if support.get(one.name, 0.0) > 0.0]
    best = max(supported, key=lambda one: support[one.name], default=None)
    found = []
    for one in explained:
        if one.name not in support:
            found.append(one)
            continue
        counted = none + support[one.name]
        if best is not None and support[one.name] > 0.0:
            counted = best.log_evidence - (support[best.name] - support[one.name])
        found.append(replace(one, log_evidence=counted, cross_validated_gain=gains[one.name]))
    return sorted(found, key=lambda one: -one.log_evidence)


def without_needless_unknown(explained: Sequence[Explained], num_features: int) -> list[Explained]:
    """Return explanations without a case for unknown where a known effect will do.

    That is where one effect takes away nearly all of the misfit, since shifts of any pattern fit a strong effect better
    than its own signature, which is never exact to the last detail; and where the best effect has more evidence than
    unknown and leaves no more than chance does.

    Args:
        explained: explanations, best first, with what other drives confirm.
        num_features: behind the misfits.
    """
    none = next(one for one in explained if one.name == NONE)
    best = next((one for one in explained if one.name not in (NONE, UNKNOWN)), None)
    if best is None or best.log_evidence <= none.log_evidence:
        return list(explained)
    unknown = max((one.log_evidence for one in explained if one.name == UNKNOWN), default=-np.inf)
    fits_better = best.log_evidence > unknown and best.best_misfit <= most_misfit(num_features)
    if not (fits_better or best.best_misfit <= NEARLY_ALL * none.best_misfit):
        return list(explained)
    found = [replace(one, log_evidence=none.log_evidence) if one.name == UNKNOWN else one for one in explained]
    return sorted(found, key=lambda one: -one.log_evidence)


def best_gain(explained: Sequence[Explained]) -> float:
    """Return by how much the best explanation's log evidence exceeds the baseline's."""
    none = next(one.log_evidence for one in explained if one.name == NONE)
    return max(one.log_evidence for one in explained if one.name != NONE) - none
