"""Makes a trial: a calibration, or what stands in its place, and its errors in SUMO on drives it has not seen."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.paper import state_of_the_art
from experiments.paper.methods import NO_CALIBRATION, PRINTED, STATE_OF_THE_ART, settings_of
from experiments.paper.trial import TRIAL_FILE, Trial, read_trial, trial_json
from jaxcalib.calibration.confirmation.final_errors import FinalRuns, final_errors, runs_of_role, start_final_runs
from jaxcalib.calibration.result.simulation_health import health_of
from jaxcalib.calibration.scenario_runs import start_scenario_runs
from jaxcalib.calibration.stages.budget import plan_budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.value_search import plan_calibration, search_values
from jaxcalib.case.case import ROLES, Role
from jaxcalib.initial_values.initial_point import demand_from_logs
from jaxcalib.problem.engines import finer_surrogate_engine, sumo_engine, surrogate_engine
from jaxcalib.problem.parameter_space import parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.journal import JournaledSumo, JournaledSurrogate
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.seeds import FINAL_SEEDS, SEARCH_SEED
from jaxcalib.runs.session import Session, open_session
from sim_adapters.atomic_file import write_atomically

# From the first case of Stage 1 to the values returned (Section 5.3.3); what the logs say before is not counted there.
CALIBRATION_PARTS = ("stage1", "stage2_exploration", "stage2_optimisation", "confirmation")


@dataclass(frozen=True)
class Found:
    """What a method found, and what that cost; see `Trial`."""

    values: np.ndarray
    surrogate_runs: int = 0
    sumo_runs: int = 0
    calibration_s: float = 0.0
    critical: Sequence[str] = ()
    stage2_undid_stage1: bool | None = None
    flow_accuracy: Sequence[float] = ()


def run_trial(
    method: str,
    pattern: int,
    repetition: int,
    case: Path,
    folder: Path,
    *,
    seed: int,
    budget: float,
    settings: Settings,
    progress: Progress,
) -> Trial:
    """Make a trial, or go on with it, or return it if it has been made.

    The folder holds journal and result; pattern and repetition are numbers for the record.

    Raises:
        CaseError: the case or the folder is wrong.
        AllRunsFailedError: a simulator failed.
    """
    file = folder / TRIAL_FILE
    if file.is_file():
        return read_trial(file)
    problem = read_problem(case)
    options = {"method": method, "seed": seed, "budget": budget, "settings": repr(settings)}
    identity = identify(problem.case, options)
    with open_session(folder / "run", identity, seed=seed, progress=progress, resume=True) as session:
        result = find_values(method, problem, session, budget, settings)
        errors = errors_in_sumo(problem, session, result.values, budget)
    trial = Trial(
        method=method,
        pattern=pattern,
        repetition=repetition,
        seed=seed,
        surrogate_runs=result.surrogate_runs,
        sumo_runs=result.sumo_runs,
        calibration_s=result.calibration_s,
        parameters=dict(zip(problem.layout.names, result.values.tolist(), strict=True)),
        critical=list(result.critical),
        num_drivers=len(problem.layout.driver_parameters),
        stage2_undid_stage1=result.stage2_undid_stage1,
        flow_accuracy=list(result.flow_accuracy),
        **errors,
    )
    write_atomically(file, lambda stream: stream.write(trial_json(trial).encode()))
    return trial


def find_values(
    method: str,
    problem: CalibrationProblem,
    session: Session,
    budget: float,
    settings: Settings,
) -> Found:
    """Return the values that a method finds.

    Raises:
        AllRunsFailedError: a simulator failed.
    """
    if method == NO_CALIBRATION:
        return Found(round_values(problem.template.base_values()))
    if method == STATE_OF_THE_ART:
        return _state_of_the_art(problem, session, budget, settings)
    is_printed = method == PRINTED  # ours goes where the surrogate cannot follow, as `jaxcalib calibrate` does
    return _two_stages(problem, session, budget, settings_of(method, settings), may_leave_surrogate=not is_printed)


def _two_stages(
    problem: CalibrationProblem, session: Session, budget: float, settings: Settings, *, may_leave_surrogate: bool
) -> Found:
    plan = plan_calibration(problem, settings, budget)
    session.progress.plan(plan.num_surrogate_runs, plan.num_sumo_runs)
    engine = surrogate_engine(problem)
    with sumo_engine(problem) as pool:
        sumo = JournaledSumo(pool, session.journal)
        waiting = start_scenario_runs(problem, sumo, plan, session, shares_runs=problem.template.can_share_runs)
        searched = search_values(
            problem, settings, plan, engine, sumo, session, waiting,
            may_leave_surrogate=may_leave_surrogate,
            finer=lambda: finer_surrogate_engine(problem) if may_leave_surrogate else None,
        )  # fmt: skip
    names = searched.initial.space.names
    return Found(
        values=searched.values,
        surrogate_runs=searched.num_surrogate_runs,
        sumo_runs=searched.num_sumo_search_runs
        + (health_of(searched.confirmation.outcomes).runs if searched.confirmation.outcomes else 0),
        calibration_s=sum(session.stopwatch.wall_s.get(part, 0.0) for part in CALIBRATION_PARTS),
        critical=[names[number] for number in searched.found.critical],
        stage2_undid_stage1=bool(searched.found.has_drifted),
        flow_accuracy=[float(accuracy) for accuracy in searched.found.stage_1_accuracy],
    )


def _state_of_the_art(problem: CalibrationProblem, session: Session, budget: float, settings: Settings) -> Found:
    """Return values, runs and time of the state of the art; as many runs as our method plans at this budget."""
    plan, journal, progress = plan_budget(problem, budget), session.journal, session.progress
    progress.plan(plan.num_surrogate_runs, plan.num_sumo_runs)
    progress.stage("memetic algorithm on volumes and speeds")
    demand = demand_from_logs(problem).values_vehph
    space = parameter_space(problem.layout, problem.model, demand, settings.scaling_factor, settings.bounds)
    scenario = problem.template.base_values()
    start = space.unit_of(np.concatenate([demand, scenario[problem.layout.num_inputs :]]))
    engine = surrogate_engine(problem)
    with ThreadPoolExecutor(1) as thread:
        thread.submit(engine.prepare).result()
    first_seed = session.first_seed + SEARCH_SEED
    evaluator = Evaluator(
        JournaledSurrogate(engine, journal), problem.drive_starts("fit"), first_seed, progress.surrogate_runs
    )
    began, compiled_s = journal.clock(), engine.compile_s
    best = state_of_the_art.search(
        problem, space, start, evaluator, plan.runs_per_candidate, plan.num_surrogate_runs,
        settings.accuracy_threshold, session.seed, progress.best,
    )  # fmt: skip
    elapsed_s = journal.clock() - began - (engine.compile_s - compiled_s)
    return Found(space.values_of(best[None])[0], evaluator.num_runs, calibration_s=elapsed_s)


def errors_in_sumo(problem: CalibrationProblem, session: Session, values: np.ndarray, budget: float) -> dict:
    """Return the errors of values, pooled and numbered as in result.json; the same runs and seeds for all methods.

    Drives share runs where their departures allow it: hundreds of trials are compared, each by as many drives.
    """
    plan = plan_budget(problem, budget)
    counts: dict[Role, int] = {"held_out": plan.final_runs, "fit": plan.final_fit_runs}
    session.progress.stage("final_errors")
    with sumo_engine(problem) as pool:
        sumo = JournaledSumo(pool, session.journal)
        waiting: dict[Role, Callable[[], FinalRuns]] = {
            role: start_final_runs(
                problem, sumo, values, role, counts[role], session, shares_runs=problem.template.can_share_runs
            )
            for role in FINAL_SEEDS
        }
        runs: dict[Role, FinalRuns] = {role: wait() for role, wait in waiting.items()}
    for role in reversed(ROLES):  # held-out drives, or those to fit where there are none
        pooled = runs_of_role(problem, runs, role)
        errors = final_errors(problem, role, pooled, pooled)
        if errors is not None:
            return {
                "role": role,
                "errors": dict(errors.pooled.errors),
                "floor": errors.floor,
                "vehicle_level": errors.pooled.vehicle_level,
            }
    raise RuntimeError("no drive could be judged")
