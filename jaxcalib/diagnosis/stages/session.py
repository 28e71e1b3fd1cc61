"""What all stages of a diagnosis share."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from jaxcalib.calibration.stages.budget import Budget, plan_budget
from jaxcalib.diagnosis.inference.atlas import effects_to_try
from jaxcalib.diagnosis.inference.refit import MOST_SUMO_POINTS
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import num_runs_for
from jaxcalib.diagnosis.runs.plan import DiagnosisBudget, plan_diagnosis
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.session import Session
from sim_adapters.scenario.sumo_effects import is_expressible

FIRST_LOOK_SCALE = 0.5  # of the numbers of runs of a calibration's first look: what it leaves open is open here


@dataclass(frozen=True)
class DiagnosisSession(Session):
    """The session of a command, with what all stages of a diagnosis share besides."""

    problem: CalibrationProblem  # the problem, with the sensors' range as stated
    plan: DiagnosisBudget  # the numbers of runs
    calibration: Budget  # those of the first look at both simulators
    parts: FinishedParts  # tallies of finished parts

    @property
    def is_fit(self) -> Bool[np.ndarray, " drive"]:
        """Which drives are to be fitted."""
        return np.asarray([drive.role == "fit" for drive in self.problem.drives])

    @property
    def wall_s(self) -> dict[str, float]:
        """Time of each part, and of all."""
        return self.stopwatch.wall_s | {"total": self.elapsed_s}


def begin_session(problem: CalibrationProblem, budget: float, work: Session) -> DiagnosisSession:
    """The session of a command as one of a diagnosis, whose progress has been told of the numbers of runs."""
    plan, calibration = plan_diagnosis(budget), plan_budget(problem, FIRST_LOOK_SCALE * budget)
    num_parameters = len(problem.layout.names)
    effects = effects_to_try(problem.layout)
    num_expressible = sum(is_expressible(problem.scenario, effect.name) for effect in effects)
    num_trial_runs = (2 * num_parameters + 1) * plan.slope_runs + 2 * len(effects) * plan.effect_runs
    work.progress.plan(
        calibration.noise_runs + num_trial_runs,
        calibration.final_fit_runs
        + sum(num_runs_for(problem, number) for number in (plan.null_drives, plan.default_drives))
        + num_expressible * num_runs_for(problem, plan.look_drives)
        + 2 * num_runs_for(problem, plan.check_drives)
        + MOST_SUMO_POINTS * num_runs_for(problem, plan.refit_drives),
    )
    parts = FinishedParts(work.folder.path / "stages")
    return DiagnosisSession(**vars(work), problem=problem, plan=plan, calibration=calibration, parts=parts)
