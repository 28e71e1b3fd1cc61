"""A case as a problem for optimisers: the calibration's own objective in the surrogate, on the drives to fit."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.evidence import evidence_of
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.objective.objective_choice import choose_objective
from jaxcalib.calibration.stages.budget import plan_budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.search_box import SearchBox, half_width_of, search_box
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.case.case import Role
from jaxcalib.initial_values.initial_point import InitialPoint, find_initial_point
from jaxcalib.problem.engines import surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.seeds import FINAL_SEEDS, NOISE_OFFSET, SEEDS_PER_CALIBRATION
from jaxcalib.search.optimiser import Told
from sim_adapters.jax.simulator import JaxSimulator

Points = Float[np.ndarray, "candidate parameter"]


@dataclass(frozen=True)
class PreparedCase:
    """What all searches of a case share."""

    problem: CalibrationProblem  # the case
    engine: JaxSimulator  # the surrogate
    initial: InitialPoint  # what the logs say
    box: SearchBox  # what is searched: all parameters, as far around their initial values as a calibration searches
    objective: Objective  # on the drives to fit
    num_runs: int  # of each candidate
    num_fresh_runs: int  # of each result, on seeds that no search has seen


def prepare_case(problem: CalibrationProblem) -> PreparedCase:
    """Return a case ready to be searched, with the numbers of runs of a calibration.

    Raises:
        CaseError: the case is wrong.
        AllRunsFailedError: no run at the initial values succeeded.
    """
    settings, budget = Settings(), plan_budget(problem)
    engine = surrogate_engine(problem)
    initial = find_initial_point(problem, settings.scaling_factor, settings.bounds, 0)
    start = initial.space.unit_of(initial.values)
    evaluator = Evaluator(engine, problem.drive_starts("fit"), 0)
    noise_runs = evaluator.rounds_of(budget.noise_runs)
    runs = evaluator.evaluate(initial.space.values_of(start[None]), noise_runs, NOISE_OFFSET).tally[0]
    objective = choose_objective(problem, settings, evidence_of(initial), runs[np.isfinite(runs).all(axis=1)])
    box = search_box(start, range(len(start)), half_width_of(initial.unit_error))
    num_runs = evaluator.rounds_of(budget.runs_per_candidate)
    return PreparedCase(problem, engine, initial, box, objective, num_runs, noise_runs)


class CaseProblem:
    """A case with one seed: its simulations share their random numbers over candidates, as in a calibration."""

    has_slopes = False  # tallies jump where vehicles change lanes or are counted; differences span the jumps

    def __init__(self, prepared: PreparedCase, seed: int) -> None:
        """Keep what is shared."""
        self._prepared = prepared
        self._first_seed = (seed + 1) * SEEDS_PER_CALIBRATION  # those of seed 0 made the objective
        evaluator = Evaluator(prepared.engine, prepared.problem.drive_starts("fit"), self._first_seed)
        self._run = SearchRun(evaluator, prepared.initial.space, prepared.objective)
        self.name = prepared.problem.case.name
        self.seed = seed

    @property
    def num_parameters(self) -> int:
        """Parameters that are searched."""
        return len(self._prepared.box.chosen)

    @property
    def start(self) -> Float[np.ndarray, " parameter"]:
        """What the logs say, in the box."""
        box = self._prepared.box
        return box.box_of(box.held[None])[0]

    def evaluate(self, points: Points, first: int) -> Told:
        """Return what becomes of candidates of the unit cube; all share their seeds, whatever their numbers."""
        judged = self._run.judge(self._prepared.box.unit_of(points), self._prepared.num_runs, "study")
        residuals = np.where(judged.is_ok[:, None], judged.residuals, np.nan)
        return Told(points, judged.accuracy, residuals)

    def measure(self, points: Points) -> dict[str, Float[np.ndarray, " candidate"]]:
        """Return 1 less the accuracy of points on fresh seeds, on the drives to fit and on those held out.

        Where no drive is held out, both are those on the drives to fit. What is known of the parameters themselves
        does not count: only simulated against field measures.
        """
        on_fit = self._error(points, "fit")
        has_others = bool(len(self._prepared.problem.field_of("held_out")))
        return {"error": self._error(points, "held_out") if has_others else on_fit, "error_fit": on_fit}

    def _error(self, points: Points, role: Role) -> Float[np.ndarray, " candidate"]:
        prepared = self._prepared
        problem, space, objective = prepared.problem, prepared.initial.space, prepared.objective
        field = problem.field_of(role)
        if not len(field):
            return np.full(len(points), np.nan)
        evaluator = Evaluator(prepared.engine, problem.drive_starts(role), self._first_seed + FINAL_SEEDS[role])
        num_runs = evaluator.rounds_of(prepared.num_fresh_runs)
        unit = prepared.box.unit_of(points)
        pooled = evaluator.evaluate(space.values_of(unit), num_runs).pooled
        there = objective.moments.values(field.sum(axis=0))
        observed = objective.take(np.flatnonzero(np.isfinite(there)))
        judging = replace(observed, field=there[np.isfinite(there)], num_drives=len(field))
        residuals = judging.residuals(unit, pooled, num_runs)[:, : len(judging.moments.names)]
        return 1.0 - judging.accuracy(residuals)
