"""One call diagnoses a case: recalibrate, see what chance and each effect would do, judge the field by it."""

import contextlib
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from jaxcalib.calibration.budget import plan_budget
from jaxcalib.calibration.seeds import MOST_SEED, SEEDS_PER_CALIBRATION
from jaxcalib.calibration.value_search import SearchedValues, search_values
from jaxcalib.diagnosis.answer import Diagnosis
from jaxcalib.diagnosis.atlas import EffectTrial, effect_trials
from jaxcalib.diagnosis.baseline import BaselineMaker
from jaxcalib.diagnosis.conclusion import conclude, refuse
from jaxcalib.diagnosis.contest import Contest, best_gain, without_needless_unknown
from jaxcalib.diagnosis.drive_table import drive_table
from jaxcalib.diagnosis.evidence import most_misfit
from jaxcalib.diagnosis.explained_runs import ExplainedRunner
from jaxcalib.diagnosis.features import DriveTallies
from jaxcalib.diagnosis.findings import Findings
from jaxcalib.diagnosis.investigation import NotTestableError, all_signatures, prepare, shift_in_errors
from jaxcalib.diagnosis.local_search import windows_of_effects
from jaxcalib.diagnosis.null_runs import fine_interval_s, num_runs_for
from jaxcalib.diagnosis.place_search import refine_places
from jaxcalib.diagnosis.plan import plan_diagnosis
from jaxcalib.diagnosis.recalibration import Recalibrator
from jaxcalib.diagnosis.refit import MOST_SUMO_POINTS, OTHERS_SUMO_POINTS, Refit, refit
from jaxcalib.diagnosis.refitted_contest import contenders, with_refits
from jaxcalib.diagnosis.remarks import FEW_DRIVES, aliased_effects
from jaxcalib.diagnosis.stages import Stages
from jaxcalib.diagnosis.sumo_check import Check, check_in_sumo
from jaxcalib.diagnosis.trials import Trial
from jaxcalib.diagnosis.verdict import LEAST_EVIDENCE, judge
from jaxcalib.diagnosis.visibility import atlas_of
from jaxcalib.disk import check_out, check_outside
from jaxcalib.engines import (
    prepare_devices,
    sumo_engine,
    surrogate_engine,
)
from jaxcalib.journal import JournaledSumo
from jaxcalib.problem import CalibrationProblem, drives_to_fit, read_problem
from jaxcalib.progress import Progress, Silent
from jaxcalib.run_folder import RunFolder, identify, open_run_folder
from jaxcalib.seen_range import seen_perception
from jaxcalib.settings import Settings
from jaxcalib.stopwatch import Stopwatch
from sim_adapters.sumo_effects import is_expressible
from surrogate.effects.registry import EFFECTS

RECALIBRATION_SCALE = 0.5  # of the calibration's numbers of runs; the last step is taken on all features anyway
TRIAL_SEED = 800_000


def diagnose(
    case: Path | str,
    out: Path | str | None = None,
    *,
    seed: int = 0,
    budget: float = 1.0,
    resume: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose the gap between a case's scenario and its logs.

    Args:
        case: the case's folder.
        out: RUN, the folder for journal, diagnosis.json and diagnosis.html; None keeps nothing.
        seed: of all random numbers, 0 to 2000.
        budget: factor on the numbers of runs; the same budget does the same work on any machine.
        resume: go on with what `out` holds.
        progress: told how far it is.

    Returns:
        The diagnosis, as in diagnosis.json.

    Raises:
        CaseError: the case or RUN are wrong; one line says what.
        AllRunsFailedError: a simulator failed.
        ResourceError: a disk is full.
    """
    began = time.perf_counter()
    if not 0 <= seed <= MOST_SEED or not 0.05 <= budget <= 100.0:
        raise ValueError(f"Expected a seed of 0 to {MOST_SEED} and a budget of 0.05 to 100; got {seed} and {budget}.")
    if out is not None:
        check_outside(Path(out), Path(case))
        check_out(Path(out))
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case, as_stated=True)
    identity = identify(problem.case, {"command": "diagnose", "seed": seed, "budget": budget})
    if out is None:
        with (
            tempfile.TemporaryDirectory(prefix="jaxcalib-") as folder,
            open_run_folder(Path(folder) / "run", identity, False) as run_folder,
        ):
            return _diagnose(problem, seed, budget, run_folder, progress or Silent(), began)
    with open_run_folder(Path(out), identity, resume) as run_folder:
        return _diagnose(problem, seed, budget, run_folder, progress or Silent(), began)


def _diagnose(
    problem: CalibrationProblem, seed: int, budget: float, run_folder: RunFolder, progress: Progress, began: float
) -> Diagnosis:
    first_seed = seed * SEEDS_PER_CALIBRATION
    plan = plan_diagnosis(budget)
    calibration = plan_budget(problem, RECALIBRATION_SCALE * budget)
    num_parameters = len(problem.layout.names)
    num_trial_runs = (2 * num_parameters + 1) * plan.slope_runs + 2 * len(EFFECTS) * plan.effect_runs
    progress.plan(
        calibration.num_surrogate_runs + num_trial_runs,
        calibration.confirmation_runs * calibration.confirmation_rounds
        + sum(num_runs_for(problem, number) for number in (plan.null_drives, plan.default_drives))
        + 2 * num_runs_for(problem, plan.check_drives)
        + MOST_SUMO_POINTS * num_runs_for(problem, plan.refit_drives),
    )
    first_null_runs = num_runs_for(problem, plan.first_null_drives)
    journal = run_folder.journal
    stopwatch = Stopwatch(journal.clock)
    stages = Stages(run_folder.path / "stages")

    # What a short range hides must not bend the values: it is an effect of its own, to be found with the stated range.
    seen = problem
    if seen_perception(drives_to_fit(problem.drives), problem.case.perception) != problem.case.perception:
        seen = read_problem(problem.case.folder)
    with sumo_engine(seen) as pool:
        engine = surrogate_engine(seen)
        searched = search_values(
            seen, Settings(), calibration, seed, engine, JournaledSumo(pool, journal), journal, progress, stopwatch
        )
    interval_s = fine_interval_s(problem)
    is_fit = np.asarray([drive.role == "fit" for drive in problem.drives])
    with stopwatch.time("baseline"):
        tables = [drive_table(drive.frames(interval_s), interval_s) for drive in problem.drives]
        making = BaselineMaker(
            problem, plan, stages, first_seed, first_seed + TRIAL_SEED, tables, progress, _bounds(searched)
        )
        try:
            converged = making.converged(searched.values)
        except NotTestableError as error:
            num_sumo = searched.confirmation.num_sumo_runs + first_null_runs
            num_surrogate = searched.surrogate.num_runs + (2 * num_parameters + 1) * plan.first_slope_runs
            wall_s = stopwatch.wall_s | {"total": journal.clock() - began}
            counts = {"surrogate": num_surrogate, "sumo": num_sumo}
            diagnosis = refuse(problem, searched.values, str(error), counts, wall_s)
            run_folder.write_text("diagnosis.json", diagnosis.to_json())
            return diagnosis
    baseline = converged.baseline
    values, features, in_sumo, runs = baseline.values, baseline.features, baseline.in_sumo, baseline.runs
    runner, found, field, fitted = baseline.runner, baseline.found, baseline.field, baseline.fitted
    key = repr(values.tolist())
    with stopwatch.time("null"):
        default = in_sumo.default()

    progress.stage("atlas")
    with stopwatch.time("atlas"):
        everywhere = effect_trials(values, plan.effect_runs, {})
        found |= stages.tallies(
            f"effects {key}", lambda: runner.run([one.trial for one in everywhere], progress.surrogate_runs)
        )

    progress.stage("evidence")
    with stopwatch.time("evidence"):
        windows, num_places = windows_of_effects(fitted.difference, fitted.null, features.road)
        local = [one for one in effect_trials(values, plan.local_runs, windows) if one.window is not None]
        found |= stages.tallies(
            f"local {key} {windows!r}", lambda: runner.run([one.trial for one in local], progress.surrogate_runs)
        )
        trials = [*everywhere, *local]
        signatures = all_signatures(fitted, runs, trials, found)
        contest = Contest(problem, values, fitted, runs, found, num_places)
        explained = contest.explain(signatures)

        if best_gain(explained) > LEAST_EVIDENCE:

            def run_nearby(several: Sequence[EffectTrial]) -> Mapping[str, DriveTallies]:
                """Return tallies of trials at other places, with the baseline's."""
                made = [one.trial for one in several]
                part = f"nearby {key} {[one.name for one in made]!r}"
                found.update(stages.tallies(part, lambda: runner.run(made, progress.surrogate_runs)))
                return found

            lanes = sorted({int(lane) for lane in features.road.lane_from_left})
            signatures = refine_places(
                fitted.difference, fitted.null, explained, signatures, values, plan.local_runs, lanes, run_nearby
            )
            explained = contest.explain(signatures)

    checks: tuple[Check, ...] = ()
    if best_gain(explained) > LEAST_EVIDENCE:
        progress.stage("check")
        with stopwatch.time("check"):
            checked = check_in_sumo(
                fitted.null,
                runs.plain,
                signatures,
                contest.explain,
                lambda name: is_expressible(problem.scenario, name),
                in_sumo.with_effect,
            )
            explained, signatures, checks = checked.explained, checked.signatures, checked.checks

    with stopwatch.time("evidence"):
        gain = best_gain(explained)
        if gain > LEAST_EVIDENCE and is_fit.sum() > 1:
            gain = min(gain, contest.least_gain(signatures))
        held_out = None
        if not is_fit.all():
            with contextlib.suppress(NotTestableError):
                held_out = prepare(problem, field.take(~is_fit), runs, found)
        shift, few_drives = shift_in_errors(problem, values, fitted), int(is_fit.sum()) < FEW_DRIVES
        aliased = aliased_effects(problem)
        verdict = judge(explained, gain, len(fitted.null.cells), shift, few_drives, aliased)

    refits: dict[str, Refit] = {}
    if verdict.kind not in ("no_gap", "miscalibrated"):
        progress.stage("refit")

        def run_explained(several: Sequence[Trial]) -> Mapping[str, DriveTallies]:
            """Return tallies of trials, with the baseline's; those made before are not made again."""
            fresh = [one for one in several if one.name not in found]
            part = f"explained {key} {[one.name for one in fresh]!r}"
            found.update(stages.tallies(part, lambda: runner.run(fresh, progress.surrogate_runs)))
            return found

        with stopwatch.time("refit"):
            recalibrator = Recalibrator(seen, searched, searched.values, calibration, seed, journal, progress)
            maker = ExplainedRunner(
                problem, values, in_sumo, fitted.null, recalibrator.values, run_explained, plan.effect_runs
            )
            found_steps = None  # those of the first that fits: the others need no search of their own
            for rank, one in enumerate(contenders(explained, signatures)):
                most_points = OTHERS_SUMO_POINTS if rank else MOST_SUMO_POINTS
                refitted = refit(fitted, one, signatures[one.name], maker, most_points, found_steps)
                if refitted is not None:
                    refits[one.name] = refitted
                    if found_steps is None and refitted.misfit <= most_misfit(len(fitted.null.cells)):
                        found_steps = refitted.steps
            explained = without_needless_unknown(with_refits(explained, refits), len(fitted.null.cells))
            verdict = judge(explained, gain, len(fitted.null.cells), shift, few_drives, aliased)

    num_surrogate = searched.surrogate.num_runs + sum(len(tallies) for tallies in found.values())
    num_surrogate += converged.num_surrogate_runs
    num_sumo = (
        searched.confirmation.num_sumo_runs + runs.plain.num_runs + (converged.num_baselines - 1) * first_null_runs
    )
    num_sumo += 0 if default is None else default.num_runs
    num_sumo += sum(one.num_runs for one in checks) + sum(one.num_sumo_runs for one in refits.values())
    stopwatch.add("reading", 0.0)
    findings = Findings(
        problem=problem,
        seed=seed,
        values=values,
        fitted=fitted,
        held_out=held_out,
        num_places=num_places,
        null_runs=runs.plain,
        default=default,
        explained=explained,
        verdict=verdict,
        refit=refits.get(verdict.effects[0]) if verdict.effects else None,
        signatures=signatures,
        atlas=atlas_of(signatures, fitted.null, int(is_fit.sum()), num_places),
        windows=windows,
        checks=checks,
        runs={"surrogate": num_surrogate, "sumo": num_sumo},
        wall_s=stopwatch.wall_s | {"total": journal.clock() - began},
    )
    progress.stage("report")
    diagnosis = conclude(findings)
    run_folder.write_text("diagnosis.json", diagnosis.to_json())
    from jaxcalib.diagnosis.report import report_html

    run_folder.write_text("diagnosis.html", report_html(findings, diagnosis))
    return diagnosis


def _bounds(searched: SearchedValues) -> tuple[np.ndarray, np.ndarray]:
    """Return the driver parameters' ranges; inflows may turn out to lie beyond those that the search looked at."""
    space = searched.initial.space
    is_inflow = np.arange(len(space.lower)) < space.layout.num_inputs
    return np.where(is_inflow, 0.0, space.lower), np.where(is_inflow, np.inf, space.upper)
