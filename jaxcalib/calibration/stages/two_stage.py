"""The two stages in the surrogate, and what the paper lacks: Stage 1 measured again, and a joint polish."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.evidence import evidence_of
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.objective.objective_choice import choose_objective
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.gradient_refinement import GradientRefinement, refine
from jaxcalib.calibration.stages.local_surface import local_surface
from jaxcalib.calibration.stages.optimisation import Optimisation, optimise, polish, polish_config
from jaxcalib.calibration.stages.screening import Screening, screen, small_array
from jaxcalib.calibration.stages.search_box import half_width_of, search_box
from jaxcalib.calibration.stages.search_run import CourseEntry, Judged, SearchRun, best_of
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.measures.measure import Level
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.progress import Progress
from jaxcalib.search import SagaConfig

NOISE_OFFSET = 50_000  # of the seeds of runs that only measure noise
POLISH_RADIUS = 0.25  # of the box of known widths
DRIFT = 2.0  # standard deviations of Stage 1's misfit over its drives

STAGE_1 = "stage1"
EXPLORATION = "stage2_exploration"
OPTIMISATION = "stage2_optimisation"


@dataclass
class TwoStageResult:
    """What the search in the surrogate found.

    Attributes:
        stage_1: SOAT on the inputs.
        exploration: SOAT and range analysis on the driver parameters.
        saga: SAGA on the critical ones.
        polish: joint polish of all.
        refinement: what gradients made of the polish's result; None where there was nothing to differentiate.
        critical: places of the critical parameters.
        best: result in the unit cube.
        objective: the objective at the end.
        judged: candidates of the driver stages, for later surfaces.
        stage_1_accuracy: flow-level accuracy of Stage 1's result, of SAGA's and of the polish's, same runs.
        has_drifted: whether Stage 2 had undone Stage 1 beyond noise.
        half_width: of the region that is searched around a point, for each parameter.
        course: all rounds.
        wall_s: time of each stage.
    """

    stage_1: Screening
    exploration: Screening
    saga: Optimisation
    polish: Optimisation
    refinement: GradientRefinement | None
    critical: tuple[int, ...]
    best: Float[np.ndarray, " parameter"]
    objective: Objective
    judged: list[Judged]
    stage_1_accuracy: tuple[float, float, float]
    has_drifted: bool
    half_width: Float[np.ndarray, " parameter"]
    course: list[CourseEntry]
    wall_s: dict[str, float] = field(default_factory=dict)


def search_two_stages(
    problem: CalibrationProblem,
    initial: InitialPoint,
    evaluator: Evaluator,
    settings: Settings,
    budget: Budget,
    seed: int,
    progress: Progress,
    clock: Callable[[], float] = time.perf_counter,
) -> TwoStageResult:
    """Search inputs first, driver parameters second, then all together.

    Args:
        problem: the problem.
        initial: where to begin.
        evaluator: of the surrogate.
        settings: the user's options.
        budget: numbers of runs.
        seed: of the searches' random numbers.
        progress: told of each stage.
        clock: for the time of each stage.
    """
    began = clock()
    space, num_inputs = initial.space, problem.layout.num_inputs
    everything = range(len(space.names))
    start = space.unit_of(initial.values)
    evidence = evidence_of(initial)
    half_width = half_width_of(initial.unit_error)
    num_runs = evaluator.rounds_of(budget.runs_per_candidate)

    def objective_at(unit: Float[np.ndarray, " parameter"], noise_runs: int) -> Objective:
        values, rounds = space.values_of(unit[None]), evaluator.rounds_of(noise_runs)
        runs = evaluator.evaluate(values, rounds, NOISE_OFFSET).tally[0]
        return choose_objective(problem, settings, evidence, runs[np.isfinite(runs).all(axis=1)])

    progress.stage(STAGE_1)
    objective = objective_at(start, budget.noise_runs)
    course: list[CourseEntry] = []
    flow_run = SearchRun(evaluator, space, objective.of_level(Level.TRAFFIC), course)
    inputs_box = search_box(start, everything[:num_inputs], half_width)
    threshold = settings.accuracy_threshold or objective.noise_floor_accuracy
    design = small_array(num_inputs)  # flow answers nearly in proportion to inflow
    stage_1 = screen(
        flow_run, inputs_box, start, num_runs, 1, STAGE_1, threshold, literal=settings.literal, array=design
    )
    wall_s = {STAGE_1: clock() - began}
    began = clock()

    progress.stage(EXPLORATION)
    progress.best(stage_1.best_accuracy)
    run = SearchRun(evaluator, space, objective, course)
    drivers_box = search_box(stage_1.best, everything[num_inputs:], half_width)
    num_critical = min(settings.num_critical, len(drivers_box.chosen))
    exploration = screen(run, drivers_box, stage_1.best, num_runs, num_critical, EXPLORATION, threshold)
    wall_s[EXPLORATION] = clock() - began
    began = clock()

    progress.stage(OPTIMISATION)
    progress.best(exploration.best_accuracy)
    run = run.with_objective(objective_at(exploration.best, budget.covariance_runs))
    critical = _critical(exploration, num_critical)
    held = _hold(exploration, stage_1.best, critical)
    critical_box = search_box(held, critical, half_width)
    explored = [_again(run, exploration.cases), _again(run, exploration.shortlist)]
    seeds = np.vstack([held, start, best_of(explored, 4)])
    config = SagaConfig(
        population_size=budget.population_size,
        num_generations=budget.num_generations,
        accuracy_threshold=threshold,
        stop_at_threshold=settings.literal,
        literal=settings.literal,
    )
    if "saga" in settings.without:
        saga = _left_out(held, exploration.best_accuracy)
    else:
        saga = optimise(run, critical_box, seeds, num_runs, config, seed, OPTIMISATION)
    progress.best(saga.best_accuracy)

    polish_runs = evaluator.rounds_of(budget.polish_runs)
    joint_box = search_box(saga.best, everything, half_width)
    if "polish" in settings.without:
        polished = _left_out(saga.best, saga.best_accuracy)
    else:
        polished = polish(
            run, joint_box, saga.best, polish_runs,
            polish_config(POLISH_RADIUS, budget.polish_iterations),
            OPTIMISATION, [*explored, *saga.rounds],
        )  # fmt: skip
    known = [*explored, *saga.rounds, *polished.rounds]
    surface = local_surface(run.objective, joint_box, known, polished.best)
    refined = None
    if not run.objective.is_relative and "gradients" not in settings.without:
        num_moments = len(run.objective.moments.names)
        refined = refine(polished.best, initial, evidence, surface, joint_box, num_moments)
    last_point = polished.best if refined is None else refined.unit
    candidates = np.stack([stage_1.best, saga.best, polished.best, last_point, start])
    last = run.judge(candidates, evaluator.rounds_of(budget.noise_runs), OPTIMISATION, NOISE_OFFSET)
    flow = run.with_objective(run.objective.of_level(Level.TRAFFIC)).rejudge(last.pooled, last.values, last.num_runs)
    best = _winner(last, (1, 2, 3, 4))
    progress.best(float(last.accuracy[best]))
    wall_s[OPTIMISATION] = clock() - began
    return TwoStageResult(
        stage_1=stage_1,
        exploration=exploration,
        saga=saga,
        polish=polished,
        critical=tuple(int(one) for one in critical),
        best=last.unit[best],
        objective=run.objective,
        judged=[*known, last],
        refinement=refined,
        stage_1_accuracy=tuple(float(one) for one in flow.accuracy[:3]),  # pyright: ignore[reportArgumentType]
        has_drifted=_has_drifted(run.objective.of_level(Level.TRAFFIC), flow),
        half_width=half_width,
        course=course,
        wall_s=wall_s,
    )


def _critical(exploration: Screening, num_critical: int) -> np.ndarray:
    """Return the places of the critical parameters among all."""
    return exploration.box.chosen[exploration.ranges.critical_parameters[:num_critical]]


def _hold(exploration: Screening, start: Float[np.ndarray, " parameter"], critical: np.ndarray) -> np.ndarray:
    """Return the point whose critical parameters SAGA will move: they begin where the exploration ended.

    A parameter that is not critical keeps what the logs or the scenario say, unless its best level stands out from
    noise. (The paper does not say; the best level of a parameter without effect is a random one.)
    """
    held = start.copy()
    held[critical] = exploration.best[critical]
    noise = exploration.ranges.noise
    levels = exploration.box.unit_of(exploration.ranges.best_levels[None] / (exploration.array.num_levels - 1))[0]
    for place, parameter in enumerate(exploration.box.chosen):
        stands_out = noise is not None and not noise.is_indistinguishable[place]
        if parameter not in critical and stands_out:
            held[parameter] = levels[parameter]
    return held


def _left_out(point: Float[np.ndarray, " parameter"], accuracy: float) -> Optimisation:
    """Return what a search that is left out has found: where it would have begun."""
    return Optimisation(point, accuracy, (), ())


def _again(run: SearchRun, judged: Judged) -> Judged:
    return run.rejudge(judged.pooled, judged.values, judged.num_runs)


def _winner(judged: Judged, places: tuple[int, ...]) -> int:
    accuracy = np.nan_to_num(judged.accuracy, nan=-np.inf)
    return max(places, key=lambda place: accuracy[place])


def _has_drifted(objective: Objective, flow: Judged) -> bool:
    """Return whether SAGA's result fits the flow worse than Stage 1's by more than its noise."""
    if objective.is_relative:
        return bool(flow.accuracy[0] - flow.accuracy[1] > DRIFT * objective.relative_noise)
    misfit = np.sum(flow.residuals**2, axis=1)
    noise = np.sqrt(2.0 * len(objective.moments.names))  # of a chi-square
    return bool(misfit[1] - misfit[0] > DRIFT * noise)
