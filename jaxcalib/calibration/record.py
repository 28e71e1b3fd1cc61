"""All that a calibration found, for results and reports."""

from dataclasses import dataclass, field

from jaxcalib.calibration.confirmation.agreement import Agreement
from jaxcalib.calibration.confirmation.confirmation import Confirmation
from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluations
from jaxcalib.calibration.stages.two_stage import TwoStageResult
from jaxcalib.case.case import Role
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings


@dataclass
class CalibrationRecord:
    """All that a calibration found.

    Attributes:
        problem: what it started from.
        settings: options.
        budget: numbers of runs.
        seed: of all random numbers.
        initial: what the logs said before the search.
        found: the search in the surrogate.
        confirmation: the finalists in SUMO.
        calibrated: SUMO runs of the result, by role of the drives.
        uncalibrated: SUMO runs of the scenario as it was.
        search_seeds: first seed of each kind of run.
        agreements: surrogate against SUMO, at the scenario's values and at those found.
        notes: what a user should know of the runs of the scenario as it is.
        num_surrogate_runs: runs of the search in the surrogate; 0 where SUMO made the search's runs.
        num_sumo_search_runs: drives of the search in SUMO, where it made the search's runs.
        surrogate_on_held_out: the surrogate's runs of the result on held-out drives; None where no drive is held out.
        num_sumo_processes: SUMO runs side by side.
        wall_s: time of each part.
    """

    problem: CalibrationProblem
    settings: Settings
    budget: Budget
    seed: int
    initial: InitialPoint
    found: TwoStageResult
    confirmation: Confirmation
    calibrated: dict[Role, FinalRuns]
    uncalibrated: dict[Role, FinalRuns]
    search_seeds: dict[str, int]
    agreements: tuple[Agreement, ...]
    notes: tuple[str, ...]
    num_surrogate_runs: int
    surrogate_on_held_out: Evaluations | None
    num_sumo_processes: int
    wall_s: dict[str, float] = field(default_factory=dict)
    num_sumo_search_runs: int = 0
