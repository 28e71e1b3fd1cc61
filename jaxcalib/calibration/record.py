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
    """All that a calibration found."""

    problem: CalibrationProblem  # what it started from
    settings: Settings  # options
    budget: Budget  # numbers of runs
    seed: int  # of all random numbers
    initial: InitialPoint  # what the logs said before the search
    found: TwoStageResult  # the search in the surrogate
    confirmation: Confirmation  # the finalists in SUMO
    calibrated: dict[Role, FinalRuns]  # SUMO runs of the result, by role of the drives
    uncalibrated: dict[Role, FinalRuns]  # SUMO runs of the scenario as it was
    search_seeds: dict[str, int]  # first seed of each kind of run
    agreements: tuple[Agreement, ...]  # surrogate against SUMO, at the scenario's values and at those found
    notes: tuple[str, ...]  # what a user should know of the runs of the scenario as it is
    is_in_sumo: bool  # whether SUMO made the search's runs
    num_surrogate_runs: int  # of the search and of its comparison with SUMO
    num_sumo_search_runs: int  # drives of the search in SUMO
    # the surrogate's runs of the result on held-out drives; None where no drive is held out
    surrogate_on_held_out: Evaluations | None
    num_sumo_processes: int  # SUMO runs side by side
    wall_s: dict[str, float] = field(default_factory=dict)  # time of each part
