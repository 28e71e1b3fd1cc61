"""One call calibrates a case: initial values, two stages in the surrogate, confirmation in SUMO, final errors."""

import functools
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from jaxcalib.calibration.confirmation.final_errors import FinalRuns, start_final_runs
from jaxcalib.calibration.objective.moments import all_moments
from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.result.outputs import write_outputs
from jaxcalib.calibration.result.result import CalibrationResult
from jaxcalib.calibration.result.result_tables import build_result
from jaxcalib.calibration.scenario_runs import start_scenario_runs
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluations, Evaluator
from jaxcalib.calibration.value_search import SearchedValues, plan_calibration, search_values
from jaxcalib.case.case import Role
from jaxcalib.cluster.opening import sumo_workers_at
from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import (
    DECISION_INTERVAL_S,
    finer_surrogate_engine,
    prepare_devices,
    sumo_engine,
    surrogate_engine,
)
from jaxcalib.problem.parameter_space import parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.problem.settings import Settings, naming, read_settings
from jaxcalib.runs.disk import check_out, check_outside
from jaxcalib.runs.journal import JournaledSumo, JournaledSurrogate
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.seeds import CONFIRMATION_SEED, FINAL_SEEDS, MOST_SEED, SEARCH_SEED
from jaxcalib.runs.session import Session, open_session
from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.scenario.finding import Level

SearchEngine = Literal["auto", "surrogate", "sumo"]


def calibrate(
    case: Path | str,
    out: Path | str | None = None,
    *,
    seed: int = 0,
    budget: float = 1.0,
    resume: bool = False,
    settings: Settings | Path | None = None,
    engine: SearchEngine = "auto",
    cluster: str | None = None,
    progress: Progress | None = None,
) -> CalibrationResult:
    """Calibrate demand and driver behaviour of a case.

    Args:
        case: the case's folder.
        out: RUN, the folder for journal, result.json, report.html and scenario/; None keeps nothing.
        seed: of all random numbers, 0 to 2000.
        budget: factor on the numbers of runs; the same budget does the same work on any machine.
        resume: go on with what `out` holds.
        settings: further options, or a TOML file of them.
        engine: which simulator makes the search's runs: the surrogate wherever it can follow the scenario ("auto"), or
            SUMO alone.
        cluster: address of a dask scheduler whose workers make SUMO's runs; None for this machine.
        progress: told how far it is.

    Returns:
        The result, as in result.json.

    Raises:
        CaseError: the case, the settings or RUN are wrong; one line says what.
        AllRunsFailedError: a simulator failed.
        ResourceError: a disk is full, or the cluster does not answer.
    """
    began_s = time.perf_counter()
    if not 0 <= seed <= MOST_SEED or not 0.05 <= budget <= 100.0:
        raise ValueError(f"Expected a seed of 0 to {MOST_SEED} and a budget of 0.05 to 100; got {seed} and {budget}.")
    if out is not None:
        check_outside(Path(out), Path(case))
        check_out(Path(out))
    chosen = settings if isinstance(settings, Settings) else read_settings(settings)
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    demand = problem.template.base_demand_vehph()
    with naming(settings):  # are they sound?
        parameter_space(problem.layout, problem.model, demand, chosen.scaling_factor, chosen.bounds)
        all_moments(problem.measures, problem.tally_index, chosen.also_match)
    in_sumo = is_searched_in_sumo(problem, engine)
    options = {"seed": seed, "budget": budget, "settings": repr(chosen)} | ({"engine": "sumo"} if in_sumo else {})
    identity = identify(problem.case, options)
    with (
        sumo_workers_at(cluster) as workers,
        open_session(
            out, identity, seed=seed, progress=progress, resume=resume, began_s=began_s, sumo_workers=workers
        ) as session,
    ):
        record = find_and_judge_values(
            problem, chosen, budget, session, in_sumo=in_sumo, may_leave_surrogate=engine == "auto"
        )
        session.progress.stage("report")
        record.wall_s["total"] = session.elapsed_s
        result = build_result(record)
        write_outputs(record, result, session.folder)
        return result


def is_searched_in_sumo(problem: CalibrationProblem, engine: SearchEngine) -> bool:
    """Whether SUMO makes the search's runs: because it was asked for, or because the surrogate cannot follow.

    Raises:
        CaseError: the surrogate was asked for, and cannot.
    """
    reasons = [str(one) for one in problem.scenario.findings if one.level is Level.SUMO_ALONE]
    if engine == "surrogate" and reasons:
        raise CaseError("command line", "--engine", f"expected auto or sumo; the surrogate cannot follow: {reasons[0]}")
    return engine == "sumo" or (engine == "auto" and bool(reasons))


def find_and_judge_values(
    problem: CalibrationProblem,
    settings: Settings,
    scale: float,
    session: Session,
    *,
    in_sumo: bool = False,
    may_leave_surrogate: bool = False,
) -> CalibrationRecord:
    """Search the values of a problem, and run the result and the scenario as it was in SUMO.

    Args:
        problem: the problem.
        settings: the user's options.
        scale: factor on the numbers of runs.
        session: seeds, journal, progress and time of the command.
        in_sumo: whether SUMO makes the search's runs.
        may_leave_surrogate: whether it makes them where the surrogate turns out to drive unlike it.
    """
    plan = plan_calibration(problem, settings, scale, in_sumo=in_sumo)
    session.stopwatch.add("reading", time.perf_counter() - session.began_s)
    session.progress.plan(plan.num_surrogate_runs, plan.num_sumo_runs)
    engine = None if in_sumo else surrogate_engine(problem)
    finer = functools.cache(lambda: finer_surrogate_engine(problem))
    with sumo_engine(problem, workers=session.sumo_workers) as sumo_pool:
        sumo = JournaledSumo(sumo_pool, session.journal)
        waiting = start_scenario_runs(problem, sumo, plan, session)
        searched = search_values(
            problem, settings, plan, engine, sumo, session, waiting,
            may_leave_surrogate=may_leave_surrogate, finer=finer,
        )  # fmt: skip
        engine = engine if searched.decision_interval_s == DECISION_INTERVAL_S else finer()
        on_held_out = None
        if engine is not None and not searched.is_in_sumo:
            on_held_out = surrogate_on_held_out(problem, engine, searched, plan, session)
        session.progress.stage("final_errors")
        with session.stopwatch.time("final_errors"):
            calibrated, uncalibrated = (
                start_final_runs_of_roles(problem, sumo, values, plan, session)
                for values in (searched.values, round_values(problem.template.base_values()))
            )
            final: list[dict[Role, FinalRuns]] = [
                {role: wait() for role, wait in waiting.items()} for waiting in (calibrated, uncalibrated)
            ]
        processes = sumo_pool.num_processes
    session.stopwatch.add("compile", engine.compile_s if engine else 0.0)
    return CalibrationRecord(
        problem=problem,
        settings=settings,
        budget=searched.plan,
        seed=session.seed,
        initial=searched.initial,
        found=searched.found,
        confirmation=searched.confirmation,
        calibrated=final[0],
        uncalibrated=final[1],
        search_seeds={
            "search": session.first_seed + SEARCH_SEED,
            "confirmation": session.first_seed + CONFIRMATION_SEED,
            **{f"final_{role}": session.first_seed + one for role, one in FINAL_SEEDS.items()},
        },
        agreements=searched.agreements,
        notes=searched.warnings,
        is_in_sumo=searched.is_in_sumo,
        num_surrogate_runs=searched.num_surrogate_runs,
        num_sumo_search_runs=searched.num_sumo_search_runs,
        surrogate_on_held_out=on_held_out,
        num_sumo_processes=processes,
        wall_s=session.stopwatch.wall_s,
    )


def start_final_runs_of_roles(
    problem: CalibrationProblem, sumo: JournaledSumo, values: np.ndarray, plan: Budget, session: Session
) -> dict[Role, Callable[[], FinalRuns]]:
    """Start the runs of a point on the drives of each role in the background; return what waits for them."""
    counts: dict[Role, int] = {"held_out": plan.final_runs, "fit": plan.final_fit_runs}
    return {
        role: start_final_runs(problem, sumo, values, role, counts[role], session, may_fail=role == "held_out")
        for role in FINAL_SEEDS
    }


def surrogate_on_held_out(
    problem: CalibrationProblem, engine: JaxSimulator, searched: SearchedValues, plan: Budget, session: Session
) -> Evaluations | None:
    """Return the surrogate's runs of the result on held-out drives, if there are any: nothing is chosen by them."""
    starts = problem.drive_starts("held_out")
    if not starts:
        return None
    first_seed = session.first_seed + FINAL_SEEDS["held_out"]
    evaluator = Evaluator(JournaledSurrogate(engine, session.journal), starts, first_seed)
    return evaluator.evaluate(searched.values[None], evaluator.rounds_of(plan.noise_runs))
