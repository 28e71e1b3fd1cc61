"""The two stages in the surrogate, and what the paper lacks: Stage 1 measured again, and a joint polish."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.evidence import Evidence, evidence_of
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.objective.objective_choice import choose_objective
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.critical_parameters import critical_parameters, hold_others
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.gradient_refinement import GradientRefinement, refine
from jaxcalib.calibration.stages.local_surface import local_surface
from jaxcalib.calibration.stages.optimisation import (
    BATCH_SIZE,
    Optimisation,
    known_in,
    optimise,
    polish_config,
    polish_on,
)
from jaxcalib.calibration.stages.screening import Screening, screen, small_array
from jaxcalib.calibration.stages.search_box import SearchBox, half_width_of, search_box
from jaxcalib.calibration.stages.search_run import CourseEntry, Judged, SearchRun, best_of
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.measures.measure import Level
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.seeds import NOISE_OFFSET
from jaxcalib.runs.session import Session
from jaxcalib.search.optimiser import Setting
from jaxcalib.search.registry import OPTIMISERS

POLISH_RADIUS = 0.25  # of the box of known widths
LITERAL_EVALUATIONS = 16  # as printed, Algorithm 3 evaluates a generation more
DRIFT = 2.0  # standard deviations of Stage 1's misfit over its drives

STAGE_1 = "stage1"
EXPLORATION = "stage2_exploration"
OPTIMISATION = "stage2_optimisation"


@dataclass
class TwoStageResult:
    """What the search in the surrogate found."""

    stage_1: Screening  # SOAT on the inputs
    exploration: Screening  # SOAT and range analysis on the driver parameters
    optimised: Optimisation  # the optimiser's search of the critical ones
    polish: Optimisation  # joint polish of all
    # what gradients made of the polish's result; None where there was nothing to differentiate
    refinement: GradientRefinement | None
    critical: tuple[int, ...]  # places of the critical parameters
    best: Float[np.ndarray, " parameter"]  # result in the unit cube
    objective: Objective  # the objective at the end
    judged: list[Judged]  # candidates of the driver stages, for later surfaces
    # flow-level accuracy of Stage 1's result, of the optimiser's and of the polish's, same runs
    stage_1_accuracy: tuple[float, float, float]
    has_drifted: bool  # whether Stage 2 had undone Stage 1 beyond noise
    half_width: Float[np.ndarray, " parameter"]  # of the region that is searched around a point, for each parameter
    course: list[CourseEntry]  # all rounds


def search_two_stages(
    problem: CalibrationProblem,
    initial: InitialPoint,
    evaluator: Evaluator,
    settings: Settings,
    budget: Budget,
    session: Session,
) -> TwoStageResult:
    """Search inputs first, driver parameters with the inputs second, then all together.

    Deviation: the paper's Stage 2 keeps the inputs of Stage 1. Whether traffic jams depends on both: with drivers who
    merge too well Stage 1 finds more traffic than there is, and from there the drivers are not found.

    Args:
        problem: the problem.
        initial: where to begin.
        evaluator: of the surrogate.
        settings: the user's options.
        budget: numbers of runs.
        session: gives the searches' random numbers, and is told of each stage and its time.
    """
    search = _Search(problem, initial, evaluator, settings, budget, session, evidence_of(initial))
    with session.stopwatch.time(STAGE_1):
        session.progress.stage(STAGE_1)
        objective = search.objective_at(search.start, budget.noise_runs)
        threshold = settings.accuracy_threshold or objective.noise_floor_accuracy
        stage_1 = search.screen_inputs(objective, threshold)
    with session.stopwatch.time(EXPLORATION):
        session.progress.stage(EXPLORATION)
        session.progress.best(stage_1.best_accuracy)
        exploration = search.screen_drivers(objective, threshold, stage_1.best)
    with session.stopwatch.time(OPTIMISATION):
        session.progress.stage(OPTIMISATION)
        session.progress.best(exploration.best_accuracy)
        run = search.run_with(search.objective_at(exploration.best, budget.covariance_runs))
        critical = critical_parameters(exploration, search.num_critical, problem.layout.num_inputs)
        explored = [_again(run, exploration.cases), _again(run, exploration.shortlist)]
        optimised = search.optimise_critical(run, exploration, stage_1.best, critical, explored, threshold)
        session.progress.best(optimised.best_accuracy)
        known = [*explored, *optimised.rounds]
        polished, joint_box = search.polish_all(run, optimised, known)
        known += polished.rounds
        refined = search.refine_drivers(run.objective, joint_box, polished.best, known)
        last_point = polished.best if refined is None else refined.unit
        points = [
            stage_1.best, optimised.best, polished.best, last_point, search.start,
            search.with_scenario_inputs(last_point), search.scenario,
        ]  # fmt: skip
        last = search.compare(run, np.stack(points))
        flow_objective = run.objective.of_level(Level.TRAFFIC)
        flow = run.with_objective(flow_objective).rejudge(last.pooled, last.values, last.num_runs)
        best = _winner(last, range(1, len(points)))
        session.progress.best(float(last.accuracy[best]))
    return TwoStageResult(
        stage_1=stage_1,
        exploration=exploration,
        optimised=optimised,
        polish=polished,
        critical=tuple(int(one) for one in critical),
        best=last.unit[best],
        objective=run.objective,
        judged=[*known, last],
        refinement=refined,
        stage_1_accuracy=tuple(float(one) for one in flow.accuracy[:3]),  # pyright: ignore[reportArgumentType]
        has_drifted=_has_drifted(flow_objective, flow),
        half_width=search.half_width,
        course=search.course,
    )


@dataclass(frozen=True)
class _Search:
    """What all stages share, and what each of them does."""

    problem: CalibrationProblem
    initial: InitialPoint  # where to begin
    evaluator: Evaluator  # of the surrogate
    settings: Settings  # the user's options
    budget: Budget  # numbers of runs
    session: Session  # gives random numbers
    evidence: Evidence  # what the logs say of the parameters
    course: list[CourseEntry] = field(default_factory=list)  # all rounds so far

    @property
    def start(self) -> Float[np.ndarray, " parameter"]:
        """What the logs say, in the unit cube."""
        return self.initial.space.unit_of(self.initial.values)

    @property
    def scenario(self) -> Float[np.ndarray, " parameter"]:
        """The scenario as it is, or what is nearest to it within the bounds: no search ends with less."""
        return self.initial.space.unit_of(self.initial.scenario_values)

    def with_scenario_inputs(self, unit: Float[np.ndarray, " parameter"]) -> Float[np.ndarray, " parameter"]:
        """A point with the scenario's inflows: counts behind them may know more than a few drives."""
        num_inputs = self.problem.layout.num_inputs
        return np.concatenate([self.scenario[:num_inputs], unit[num_inputs:]])

    @property
    def half_width(self) -> Float[np.ndarray, " parameter"]:
        """How far around a point each parameter is searched."""
        return half_width_of(self.initial.unit_error)

    @property
    def num_runs(self) -> int:
        """Runs of a candidate while screening and optimising."""
        return self.evaluator.rounds_of(self.budget.runs_per_candidate)

    @property
    def num_critical(self) -> int:
        """K, at most all driver parameters."""
        return min(self.settings.num_critical, len(self.initial.space.names) - self.problem.layout.num_inputs)

    def objective_at(self, unit: Float[np.ndarray, " parameter"], noise_runs: int) -> Objective:
        """Return the objective whose noise is that of runs at a point."""
        values, rounds = self.initial.space.values_of(unit[None]), self.evaluator.rounds_of(noise_runs)
        runs = self.evaluator.evaluate(values, rounds, NOISE_OFFSET).tally[0]
        return choose_objective(self.problem, self.settings, self.evidence, runs[np.isfinite(runs).all(axis=1)])

    def run_with(self, objective: Objective) -> SearchRun:
        """Return what judges candidates by an objective."""
        return SearchRun(self.evaluator, self.initial.space, objective, self.course)

    def screen_inputs(self, objective: Objective, threshold: float) -> Screening:
        """Stage 1: screen the inputs by the flow."""
        num_inputs = self.problem.layout.num_inputs
        box = search_box(self.start, range(num_inputs), self.half_width)
        design = small_array(num_inputs)  # flow answers nearly in proportion to inflow
        run = self.run_with(objective.of_level(Level.TRAFFIC))
        return screen(
            run, box, self.start, self.num_runs, 1, STAGE_1, threshold, self.settings.literal, design,
            self.with_scenario_inputs(self.start)[None],
        )  # fmt: skip

    @property
    def inputs(self) -> range:
        """Places of the inputs that Stage 2 searches with the driver parameters; none as printed."""
        return range(0 if self.settings.literal else self.problem.layout.num_inputs)

    def screen_drivers(
        self, objective: Objective, threshold: float, start: Float[np.ndarray, " parameter"]
    ) -> Screening:
        """Screen the driver parameters around a point, and with them the inputs around what the logs say."""
        drivers = range(self.problem.layout.num_inputs, len(start))
        center = start.copy()
        center[self.inputs] = self.start[self.inputs]
        box = search_box(center, [*drivers, *self.inputs], self.half_width)
        num_critical = self.num_critical + len(self.inputs)
        return screen(self.run_with(objective), box, start, self.num_runs, num_critical, EXPLORATION, threshold)

    def optimise_critical(
        self,
        run: SearchRun,
        exploration: Screening,
        inputs_from: Float[np.ndarray, " parameter"],
        critical: np.ndarray,
        explored: Sequence[Judged],
        threshold: float,
    ) -> Optimisation:
        """Stage 2: search the critical parameters and the inputs from where the screening left them."""
        searched = np.concatenate([critical, np.asarray(self.inputs, int)])
        held = hold_others(exploration, inputs_from, searched)
        if "optimiser" in self.settings.without:
            return _left_out(held, exploration.best_accuracy)
        box = search_box(held, searched, self.half_width)
        setting = Setting(
            num_parameters=len(box.chosen),
            num_evaluations=self.budget.num_evaluations + LITERAL_EVALUATIONS * self.settings.literal,
            batch_size=BATCH_SIZE,
            start=box.box_of(held[None])[0],
            has_slopes=False,
            seed=self.session.seed,
            more_starts=box.box_of(np.vstack([self.start, best_of(explored, 4)])),
            accuracy_threshold=threshold if self.settings.literal else None,
            known=known_in(run, box, explored, self.num_runs),
        )
        optimiser = OPTIMISERS[self.settings.stage_2_optimiser]()
        return optimise(run, box, optimiser, setting, self.num_runs, OPTIMISATION)

    def polish_all(
        self, run: SearchRun, optimised: Optimisation, known: Sequence[Judged]
    ) -> tuple[Optimisation, SearchBox]:
        """Improve what Stage 2 found with all parameters at once; also returns the box around where that ended."""
        if "polish" in self.settings.without:
            box = search_box(optimised.best, range(len(optimised.best)), self.half_width)
            return _left_out(optimised.best, optimised.best_accuracy), box
        num_runs, most = self.evaluator.rounds_of(self.budget.polish_runs), self.budget.most_polishes
        config = polish_config(POLISH_RADIUS)
        return polish_on(run, optimised.best, self.half_width, num_runs, config, OPTIMISATION, known, most)

    def refine_drivers(
        self, objective: Objective, box: SearchBox, point: Float[np.ndarray, " parameter"], known: Sequence[Judged]
    ) -> GradientRefinement | None:
        """Refine a point by gradients; None where there is nothing to differentiate."""
        if objective.is_relative or "gradients" in self.settings.without:
            return None
        surface = local_surface(objective, box, known, point)
        return refine(point, self.initial, self.evidence, surface, box, len(objective.moments.names))

    def compare(self, run: SearchRun, points: Float[np.ndarray, "candidate parameter"]) -> Judged:
        """Run points once more, on the runs that measure noise."""
        return run.judge(points, self.evaluator.rounds_of(self.budget.noise_runs), OPTIMISATION, NOISE_OFFSET)


def _left_out(point: Float[np.ndarray, " parameter"], accuracy: float) -> Optimisation:
    """Return what a search that is left out has found: where it would have begun."""
    return Optimisation(point, accuracy, (), ())


def _again(run: SearchRun, judged: Judged) -> Judged:
    return run.rejudge(judged.pooled, judged.values, judged.num_runs)


def _winner(judged: Judged, places: Iterable[int]) -> int:
    accuracy = np.nan_to_num(judged.accuracy, nan=-np.inf)
    return max(places, key=lambda place: accuracy[place])


def _has_drifted(objective: Objective, flow: Judged) -> bool:
    """Return whether the optimiser's result fits the flow worse than Stage 1's by more than its noise."""
    if objective.is_relative:
        return bool(flow.accuracy[0] - flow.accuracy[1] > DRIFT * objective.relative_noise)
    misfit = np.sum(flow.residuals**2, axis=1)
    noise = np.sqrt(2.0 * len(objective.moments.names))  # of a chi-square
    return bool(misfit[1] - misfit[0] > DRIFT * noise)
