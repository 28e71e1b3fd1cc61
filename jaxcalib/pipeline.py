"""One call calibrates a case: initial values, two stages in the surrogate, confirmation in SUMO, final errors."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxcalib.calibration.budget import Budget
from jaxcalib.calibration.confirmation import Confirmation
from jaxcalib.calibration.evaluator import Evaluations, Evaluator
from jaxcalib.calibration.final_errors import FinalRuns, start_final_runs
from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.seeds import CONFIRMATION_SEED, FINAL_SEEDS, MOST_SEED, SEARCH_SEED, SEEDS_PER_CALIBRATION
from jaxcalib.calibration.value_search import plan_calibration, search_values
from jaxcalib.case import Role
from jaxcalib.disk import check_out, check_outside
from jaxcalib.engines import prepare_devices, sumo_engine, surrogate_engine
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.journal import Journal, JournaledSumo, JournaledSurrogate
from jaxcalib.outputs import write_outputs
from jaxcalib.parameter_space import parameter_space, round_values
from jaxcalib.problem import CalibrationProblem, read_problem
from jaxcalib.progress import Progress, Silent
from jaxcalib.result import CalibrationResult
from jaxcalib.result_tables import build_result
from jaxcalib.run_folder import RunFolder, identify, open_run_folder
from jaxcalib.settings import Settings, read_settings
from jaxcalib.stopwatch import Stopwatch
from sim_adapters.jax_simulator import JaxSimulator


def calibrate(
    case: Path | str,
    out: Path | str | None = None,
    *,
    seed: int = 0,
    budget: float = 1.0,
    resume: bool = False,
    settings: Settings | Path | None = None,
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
        progress: told how far it is.

    Returns:
        The result, as in result.json.

    Raises:
        CaseError: the case, the settings or RUN are wrong; one line says what.
        AllRunsFailedError: a simulator failed.
        ResourceError: a disk is full.
    """
    began = time.perf_counter()
    if not 0 <= seed <= MOST_SEED or not 0.05 <= budget <= 100.0:
        raise ValueError(f"Expected a seed of 0 to {MOST_SEED} and a budget of 0.05 to 100; got {seed} and {budget}.")
    if out is not None:
        check_outside(Path(out), Path(case))
        check_out(Path(out))
    chosen = settings if isinstance(settings, Settings) else read_settings(settings)
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    demand = problem.template.base_demand_vehph()
    parameter_space(problem.layout, problem.model, demand, chosen.scaling_factor, chosen.bounds)  # are they sound?
    options = {"seed": seed, "budget": budget, "settings": repr(chosen)}
    if out is None:
        with tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder:
            run_folder = open_run_folder(Path(folder) / "run", identify(problem.case, options), False)
            with run_folder:
                return _calibrate(problem, chosen, seed, budget, run_folder, progress or Silent(), began)
    with open_run_folder(Path(out), identify(problem.case, options), resume) as run_folder:
        return _calibrate(problem, chosen, seed, budget, run_folder, progress or Silent(), began)


def _calibrate(
    problem: CalibrationProblem,
    settings: Settings,
    seed: int,
    scale: float,
    run_folder: RunFolder,
    progress: Progress,
    began: float,
) -> CalibrationResult:
    plan = plan_calibration(problem, settings, scale)
    first_seed = seed * SEEDS_PER_CALIBRATION
    stopwatch = Stopwatch(run_folder.journal.clock)
    stopwatch.add("reading", time.perf_counter() - began)
    progress.plan(plan.num_surrogate_runs, plan.num_sumo_runs)
    journal = run_folder.journal
    engine = surrogate_engine(problem)
    with sumo_engine(problem) as sumo_pool:
        sumo = JournaledSumo(sumo_pool, journal)

        def start_final(values: np.ndarray) -> dict[Role, Callable[[], FinalRuns]]:
            counts: dict[Role, int] = {"held_out": plan.final_runs, "fit": plan.final_fit_runs}
            return {
                role: start_final_runs(
                    problem, sumo, values, role, counts[role], first_seed + first, progress.sumo_runs
                )
                for role, first in FINAL_SEEDS.items()
            }

        searched = search_values(problem, settings, plan, seed, engine, sumo, journal, progress, stopwatch)
        initial, found, confirmation = searched.initial, searched.found, searched.confirmation
        surrogate = searched.surrogate
        on_held_out = surrogate_on_held_out(problem, engine, journal, initial, confirmation, plan, first_seed)
        progress.stage("final_errors")
        with stopwatch.time("final_errors"):
            calibrated = start_final(initial.space.values_of(confirmation.best[None])[0])
            uncalibrated = start_final(round_values(problem.template.base_values()))
            final: dict[str, dict[Role, FinalRuns]] = {
                name: {role: wait() for role, wait in waiting.items()}
                for name, waiting in (("calibrated", calibrated), ("uncalibrated", uncalibrated))
            }
        processes = sumo_pool.num_processes
    stopwatch.add("compile", engine.compile_s)
    record = CalibrationRecord(
        problem=problem,
        settings=settings,
        budget=plan,
        seed=seed,
        initial=initial,
        found=found,
        confirmation=confirmation,
        calibrated=final["calibrated"],
        uncalibrated=final["uncalibrated"],
        search_seeds={
            "search": first_seed + SEARCH_SEED,
            "confirmation": first_seed + CONFIRMATION_SEED,
            **{f"final_{role}": first_seed + one for role, one in FINAL_SEEDS.items()},
        },
        num_surrogate_runs=surrogate.num_runs,
        surrogate_on_held_out=on_held_out,
        num_sumo_processes=processes,
        wall_s=stopwatch.wall_s,
    )
    progress.stage("report")
    record.wall_s["total"] = journal.clock() - began
    result = build_result(record)
    write_outputs(record, result, run_folder)
    return result


def surrogate_on_held_out(
    problem: CalibrationProblem,
    engine: JaxSimulator,
    journal: Journal,
    initial: InitialPoint,
    confirmation: Confirmation,
    plan: Budget,
    first_seed: int,
) -> Evaluations | None:
    """Return the surrogate's runs of the result on held-out drives, if there are any: nothing is chosen by them."""
    departs_s = problem.departs_s("held_out")
    if not departs_s:
        return None
    evaluator = Evaluator(JournaledSurrogate(engine, journal), departs_s, first_seed + FINAL_SEEDS["held_out"])
    values = initial.space.values_of(confirmation.best[None])
    return evaluator.evaluate(values, evaluator.rounds_of(plan.noise_runs))
