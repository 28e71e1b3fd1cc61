"""The second stage: the calibrated simulation, to which the drives are compared, and the scenario as it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.inference.baseline import Baseline, BaselineMaker, Converged
from jaxcalib.diagnosis.runs.measured_sensors import measured_strengths
from jaxcalib.diagnosis.runs.null_runs import fine_interval_s
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.stages.calibrated import Calibrated
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from surrogate.road.drive_table import drive_table

TRIAL_SEED = 800_000


@dataclass(frozen=True)
class Simulated:
    """The calibrated simulation."""

    maker: BaselineMaker  # makes baselines at other values
    converged: Converged  # where baselines led
    default: DriveTallies | None  # tallies of SUMO runs of the scenario as it is; None where they failed
    instead_of: str = ""  # explanation that would be the best, had values that no log shows not been moved

    @property
    def baseline(self) -> Baseline:
        """The calibrated simulation, and the drives against it."""
        return self.converged.baseline

    def moved(self, names: Sequence[str]) -> list[str]:
        """Names of the parameters of which the logs are silent, and that no longer lie where they began."""
        is_moved = ~np.isfinite(self.maker.error) & (self.baseline.values != self.maker.begin)
        return [name for name, moved in zip(names, is_moved, strict=True) if moved]


def trial_book_of(baseline: Baseline, session: DiagnosisSession) -> TrialBook:
    """Return a book of trials from a baseline on, which holds those of the parameters."""
    key = repr(baseline.values.tolist())
    return TrialBook(baseline.runner, session.parts, key, baseline.trials, session.progress.surrogate_runs)


def simulate_null(session: DiagnosisSession, calibrated: Calibrated) -> Simulated:
    """Run the calibrated simulation, and move its values until no feature asks for others.

    Raises:
        NotTestableError: the drives show too little.
    """
    problem = session.problem
    interval_s = fine_interval_s(problem)
    with session.stopwatch.time("baseline"):
        maker = BaselineMaker(
            problem=problem,
            plan=session.plan,
            parts=session.parts,
            first_seed=session.first_seed,
            trial_seed=session.first_seed + TRIAL_SEED,
            tables=[drive_table(drive.frames(interval_s), interval_s) for drive in problem.drives],
            progress=session.progress,
            begin=calibrated.values,
            error=calibrated.error,
            bounds=calibrated.bounds,
            sumo_workers=session.sumo_workers,
            decision_interval_s=calibrated.decision_interval_s,
            measured=measured_strengths(problem, interval_s),
        )
        converged = maker.converged()
    with session.stopwatch.time("null"):
        default = converged.baseline.in_sumo.default()
    return Simulated(maker, converged, default)
