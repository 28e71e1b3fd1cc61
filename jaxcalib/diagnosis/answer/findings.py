"""All that a diagnosis has found out before it is put into words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window
from jaxcalib.diagnosis.inference.investigation import Prepared
from jaxcalib.diagnosis.inference.ledger import LedgerEntry, make_ledger
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.pairs import Pairs
from jaxcalib.diagnosis.inference.refit import Refit
from jaxcalib.diagnosis.inference.sumo_check import Check
from jaxcalib.diagnosis.inference.verdict import Verdict
from jaxcalib.diagnosis.inference.visibility import AtlasEntry
from jaxcalib.problem.problem import CalibrationProblem


@dataclass(frozen=True)
class Findings:
    """All that a diagnosis knows."""

    problem: CalibrationProblem
    seed: int  # of the random numbers
    values: np.ndarray  # calibrated values
    moved: Sequence[str]  # names of those that no log shows, and that the features have moved from the scenario's
    instead_of: str  # explanation that would be the best without that; empty where it would have been none
    fitted: Prepared  # null model and features of the drives to fit
    held_out: Prepared | None  # the same of held-out drives; None where there are none
    num_places: Mapping[str, int]  # how many places were looked at for each local effect
    null_runs: DriveTallies  # tallies of SUMO runs with the calibrated values
    default: DriveTallies | None  # tallies of SUMO runs of the scenario as it is; None where they failed
    explained: Sequence[Explained]  # explanations, best first
    verdict: Verdict  # the answer
    # the effect that is named first, fitted once more around runs that contain it; None where there is none
    refit: Refit | None
    pairs: Pairs | None  # two effects at once; None where they explain no more than one does
    signatures: Mapping[str, Sequence[Signature]]  # of all effects that were tried
    atlas: Mapping[str, AtlasEntry]  # what is known of each effect beforehand
    windows: Mapping[str, Sequence[Window]]  # where local effects were tried
    checks: Sequence[Check]  # effects that were put into SUMO, and how well its signatures agree with the surrogate's
    runs: Mapping[str, int]  # numbers of runs
    wall_s: Mapping[str, float]  # time of each part

    def ledger(self) -> list[LedgerEntry]:
        """The ledger of the gap on the drives to fit."""
        return make_ledger(self.fitted.tallies.values(), self.fitted.null, np.random.default_rng(self.seed))
