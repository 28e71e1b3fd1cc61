"""The contest of the explanations: evidence on the drives to fit, as far as other drives confirm it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.inference.cross_validation import cross_validated_gains
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, explanations, moved, prepare
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, Explained, none_among
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.problem.problem import CalibrationProblem

Signatures = Mapping[str, Sequence[Signature]]


@dataclass(frozen=True)
class Contest:
    """What explanations are judged by."""

    problem: CalibrationProblem
    values: np.ndarray  # calibrated values
    fitted: Prepared  # null model and features of the drives to fit
    runs: NullRuns  # SUMO runs with the calibrated values
    trials: Mapping[str, DriveTallies]  # trials of the parameters
    num_places: Mapping[str, int]  # how many places were looked at for each local effect
    _known_gains: dict[str, tuple[Sequence[Signature], float]] = field(default_factory=dict)

    def explain(self, signatures: Signatures) -> list[Explained]:
        """Return the explanations, best first: an effect's evidence counts as far as other drives confirm it."""
        gains = self._gains(signatures)
        judged = explanations(self.problem, self.values, self.fitted, signatures, self.num_places)
        return confirmed(judged, gains)

    def least_gain(self, signatures: Signatures) -> float:
        """Return the gain of the best explanation over the baseline when the drive that favours it most is left out.

        Jams come in some drives only, and their noise has a longer tail than any covariance tells; an effect shows in
        most.
        """
        gains = self._gains(signatures)
        everyone = np.arange(len(self.fitted.tallies))
        judged = []
        for left_out in everyone:
            try:
                some = self._prepared(self.fitted.tallies.take(np.setdiff1d(everyone, [left_out])))
            except NotTestableError:
                continue  # the others alone show too little
            there = {
                name: [moved(signature, self.fitted, some) for signature in several]
                for name, several in signatures.items()
            }
            explained = explanations(self.problem, self.values, some, there, self.num_places)
            judged.append(best_gain(confirmed(explained, gains)))
        return min(judged, default=0.0)

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

    An effect's support is its evidence or its cross-validated gain, whichever is less; one without a gain keeps its
    evidence. The best supported keeps its evidence, against none and unknown, which predict nothing that could be
    judged so; the others lie behind it by what they have less of support. An effect without support is worth no more
    than the baseline.
    """
    none = none_among(explained).log_evidence
    support = {
        explanation.name: min(explanation.log_evidence - none, gains[explanation.name])
        for explanation in explained
        if explanation.name in gains
    }
    supported = [explanation for explanation in explained if support.get(explanation.name, 0.0) > 0.0]
    best = max(supported, key=lambda explanation: support[explanation.name], default=None)
    judged = []
    for explanation in explained:
        if explanation.name not in support:
            judged.append(explanation)
            continue
        counted = none + support[explanation.name]
        if best is not None and support[explanation.name] > 0.0:
            counted = best.log_evidence - (support[best.name] - support[explanation.name])
        judged.append(replace(explanation, log_evidence=counted, cross_validated_gain=gains[explanation.name]))
    return sorted(judged, key=lambda explanation: -explanation.log_evidence)


def best_gain(explained: Sequence[Explained]) -> float:
    """Log evidence of the best explanation less that of the baseline."""
    best = max(explanation.log_evidence for explanation in explained if explanation.name != NONE)
    return best - none_among(explained).log_evidence
