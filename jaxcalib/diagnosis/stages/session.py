"""What all stages of a diagnosis share."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from jaxcalib.calibration.stages.budget import Budget, plan_budget
from jaxcalib.diagnosis.inference.refit import MOST_SUMO_POINTS
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import num_runs_for
from jaxcalib.diagnosis.runs.plan import DiagnosisBudget, plan_diagnosis
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.journal import Journal
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.run_folder import RunFolder
from jaxcalib.runs.seeds import SEEDS_PER_CALIBRATION
from jaxcalib.runs.stopwatch import Stopwatch
from surrogate.effects.registry import EFFECTS

RECALIBRATION_SCALE = 0.5  # of the calibration's numbers of runs; the last step is taken on all features anyway


@dataclass(frozen=True)
class DiagnosisSession:
    """What all stages of a diagnosis share.

    Attributes:
        problem: the problem, with the sensors' range as stated.
        seed: of the diagnosis.
        plan: its numbers of runs.
        calibration: those of the recalibration.
        journal: of the calibrations' runs.
        parts: tallies of finished parts.
        progress: told how far it is.
        stopwatch: adds up the time of each part.
        began_s: when it began, by the journal's clock.
    """

    problem: CalibrationProblem
    seed: int
    plan: DiagnosisBudget
    calibration: Budget
    journal: Journal
    parts: FinishedParts
    progress: Progress
    stopwatch: Stopwatch
    began_s: float

    @property
    def first_seed(self) -> int:
        """Seed behind which those of all runs lie."""
        return self.seed * SEEDS_PER_CALIBRATION

    @property
    def is_fit(self) -> Bool[np.ndarray, " drive"]:
        """Which drives are to be fitted."""
        return np.asarray([drive.role == "fit" for drive in self.problem.drives])

    @property
    def wall_s(self) -> dict[str, float]:
        """Time of each part, and of all."""
        return self.stopwatch.wall_s | {"total": self.journal.clock() - self.began_s}


def begin_session(
    problem: CalibrationProblem, seed: int, budget: float, folder: RunFolder, progress: Progress, began_s: float
) -> DiagnosisSession:
    """A session, whose numbers of runs `progress` has been told of.

    Args:
        problem: the problem.
        seed: of the diagnosis.
        budget: factor on the numbers of runs.
        folder: keeps journal and finished parts.
        progress: told how far it is.
        began_s: when the diagnosis began.
    """
    plan, calibration = plan_diagnosis(budget), plan_budget(problem, RECALIBRATION_SCALE * budget)
    num_parameters = len(problem.layout.names)
    num_trial_runs = (2 * num_parameters + 1) * plan.slope_runs + 2 * len(EFFECTS) * plan.effect_runs
    progress.plan(
        calibration.num_surrogate_runs + num_trial_runs,
        calibration.confirmation_runs * calibration.confirmation_rounds
        + sum(num_runs_for(problem, number) for number in (plan.null_drives, plan.default_drives))
        + 2 * num_runs_for(problem, plan.check_drives)
        + MOST_SUMO_POINTS * num_runs_for(problem, plan.refit_drives),
    )
    return DiagnosisSession(
        problem=problem,
        seed=seed,
        plan=plan,
        calibration=calibration,
        journal=folder.journal,
        parts=FinishedParts(folder.path / "stages"),
        progress=progress,
        stopwatch=Stopwatch(folder.journal.clock),
        began_s=began_s,
    )
