"""One call validates a calibrated result against the field, in SUMO alone."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jaxcalib.calibration.confirmation.scenario_check import start_scenario_check
from jaxcalib.calibration.result.result import rounded, to_json
from jaxcalib.calibration.result.simulation_health import health_of, unfinished_warnings
from jaxcalib.calibration.stages.evaluator import gather
from jaxcalib.case.case import Role
from jaxcalib.cluster.opening import sumo_workers_at
from jaxcalib.errors import CaseError
from jaxcalib.measures.measure import Moe
from jaxcalib.problem.engines import prepare_devices, sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.disk import check_out, check_outside
from jaxcalib.runs.journal import JournaledSumo
from jaxcalib.runs.profile import profile
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.session import Session, open_session
from jaxcalib.validation.calibrated_run import CalibratedRun, read_calibrated_run
from jaxcalib.validation.comparison import (
    compare_distributions,
    compare_measures,
    compare_trajectories,
    correct_together,
    cut_short,
    travel_time_table,
)
from jaxcalib.validation.counts import FieldCounts, count_criteria, count_volumes, read_counts
from jaxcalib.validation.encounters import compare_encounters
from jaxcalib.validation.equivalence import compare_within_margins
from jaxcalib.validation.errors_by_chance import error_table
from jaxcalib.validation.judgement import (
    arrival_criterion,
    chance_criteria,
    criteria_without_counts,
    health_criteria,
    travel_time_criterion,
)
from jaxcalib.validation.margins import Margin, read_margins
from jaxcalib.validation.observer import DriveObserver
from jaxcalib.validation.prediction import FEWEST_ROUNDS
from jaxcalib.validation.report import validation_html
from jaxcalib.validation.result import ValidationResult
from jaxcalib.validation.rounds import complete_rounds, round_requests, runs_of_rounds
from jaxcalib.validation.step_error import check_half_step, step_error
from jaxcalib.validation.tails import compare_tails
from jaxcalib.validation.volumes import Volume
from sim_adapters.interface import RunOutcome, RunRequest

MOST_SEEDS = 1000
FOLDER = "validation"


def validate(
    case: Path | str,
    run: Path | str,
    out: Path | str | None = None,
    *,
    seeds: int = 20,
    drives: Literal["held_out", "fit"] | None = None,
    counts: Path | str | None = None,
    margins: Path | str | None = None,
    half_step: bool = False,
    resume: bool = False,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> ValidationResult:
    """Judge a calibrated result by the field's drives, in SUMO, on seeds that the calibration has not seen.

    Args:
        case: the case's folder.
        run: RUN, the folder that the calibration has left.
        out: folder for validation.json, validation.html and the journal; RUN/validation unless given.
        seeds: rounds of drives; each drive is run once in each, on a seed of its own.
        drives: role of the drives that it is judged by; held-out drives where there are any unless given.
        counts: table of counted vehicles, for GEH and the criteria of FHWA 2019.
        margins: TOML file with margins within which quantities count as the same, instead of the usual ones.
        half_step: run the rounds with half the scenario's step, too, for the error of the step.
        resume: go on with a validation that was stopped.
        cluster: address of a dask scheduler whose workers make SUMO's runs; None for this machine.
        progress: told how far it is.

    Returns:
        The result, as in validation.json.

    Raises:
        CaseError: the case, RUN or the folder is wrong; one line says what.
        AllRunsFailedError: hardly any run succeeded.
        ResourceError: the disk is full, or the cluster does not answer.
    """
    began_s = time.perf_counter()
    if not FEWEST_ROUNDS <= seeds <= MOST_SEEDS:
        raise CaseError("command line", "--seeds", f"expected {FEWEST_ROUNDS} to {MOST_SEEDS}, got {seeds}.")
    folder = Path(run) / FOLDER if out is None else Path(out)
    check_outside(folder, Path(case))
    check_out(folder)
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case)
    calibrated = read_calibrated_run(Path(run), problem)
    role = drives or ("held_out" if problem.drive_starts("held_out") else "fit")
    if not problem.drive_starts(role):
        raise CaseError("command line", "--drives", f"expected a role that drives of the case have, got {role}.")
    counted = None if counts is None else read_counts(Path(counts), problem)
    within = read_margins(None if margins is None else Path(margins))
    if half_step:
        check_half_step(problem)
    options = {
        "validate": list(calibrated.values), "seeds": seeds, "drives": role, "first": calibrated.first_seed,
        "counts": None if counted is None else [list(counted.places), np.nan_to_num(counted.vehicles, nan=-1).tolist()],
    }  # fmt: skip
    identity = identify(problem.case, options)
    with (
        sumo_workers_at(cluster) as workers,
        open_session(
            folder, identity, progress=progress, resume=resume, began_s=began_s, sumo_workers=workers
        ) as session,
    ):
        result = _validate(problem, calibrated, role, seeds, counted, within, session, half_step=half_step)
        session.folder.write_text("validation.json", to_json(result))
        session.folder.write_text("validation.html", validation_html(result))
    return result


def _validate(
    problem: CalibrationProblem,
    calibrated: CalibratedRun,
    role: Role,
    seeds: int,
    counted: FieldCounts | None,
    margins: Mapping[Moe, Margin],
    session: Session,
    *,
    half_step: bool,
) -> ValidationResult:
    observer = DriveObserver(problem)
    logs = [drive for drive in problem.drives if drive.role == role]
    requests = round_requests(calibrated, problem.drive_starts(role), seeds)
    count_requests = [] if counted is None else _count_requests(calibrated, requests, seeds)
    half_step_requests = (
        round_requests(calibrated, problem.drive_starts(role), seeds, len(requests) + seeds) if half_step else []
    )
    session.progress.plan(0, len(requests) + len(count_requests) + len(half_step_requests))
    session.progress.stage("validation")
    with sumo_engine(problem, fold=observer, workers=session.sumo_workers) as pool:
        sumo = JournaledSumo(pool, session.journal)
        check = start_scenario_check(problem, calibrated.first_seed, sumo.start)
        wait = sumo.start(requests, session.progress.sumo_runs)
        check()
        outcomes = wait()
    rounds = complete_rounds(outcomes, len(logs))
    count_outcomes, simulated_counts = _counts_of(problem, counted, count_requests, session)
    simulated = observer.parts(rounds)
    of_step = step_error(problem, observer, margins, simulated, half_step_requests, session) if half_step else None
    session.progress.stage("report")
    field = observer.parts(np.stack([observer(drive.frames(problem.frame_interval_s)) for drive in logs]))
    measures = compare_measures(problem.measures, problem.tally_names, field, simulated)
    distributions = compare_distributions(field, simulated)
    trajectories = compare_trajectories(field, simulated)
    wasserstein = {name: entry["wasserstein"] for name, entry in distributions.items()}
    correct_together(measures, wasserstein, trajectories)
    names = tuple(drive.id for drive in problem.case.drives_of(role))
    has_left = np.asarray([[run.subject_left for run in runs] for runs in runs_of_rounds(outcomes, len(logs))])
    is_cut_short = cut_short(field, simulated, has_left, problem.scenario.end_s)
    travel_times = travel_time_table(names, field, simulated, is_cut_short)
    errors = error_table(problem, role, simulated, outcomes)
    equivalence = compare_within_margins(
        problem.measures, margins, problem.tally_names, field, simulated, np.random.default_rng(0)
    )
    health = health_of([*outcomes, *count_outcomes])
    criteria = [
        *health_criteria([*outcomes, *count_outcomes]),
        arrival_criterion(is_cut_short),
        *chance_criteria(measures, wasserstein, trajectories),
        travel_time_criterion(travel_times),
        *(count_criteria(counted, simulated_counts) if counted else criteria_without_counts()),
    ]
    return ValidationResult(
        case=problem.case.name,
        is_valid=all(criterion.passes is not False for criterion in criteria),
        drives=list(names),
        role=role,
        parameters=dict(zip(problem.layout.names, calibrated.values, strict=True)),
        criteria=criteria,
        measures=measures,
        distributions=distributions,
        trajectories=trajectories,
        travel_times=travel_times,
        errors=errors,
        equivalence=equivalence,
        encounters=compare_encounters(problem.tally_names, field, simulated),
        tails=compare_tails(problem.tally_names, field, simulated),
        volumes=_seen_volumes(problem, measures),
        counts=[_volume_entry(volume) for volume in count_volumes(counted, simulated_counts)] if counted else [],
        health=health,
        runs=len(outcomes) + len(count_requests) + len(half_step_requests),
        step_error=of_step,
        seeds=[requests[0].seed, requests[-1].seed],
        num_rounds=len(rounds),
        wall_s={"total": rounded(time.perf_counter() - session.began_s) or 0.0},
        warnings=[*calibrated.warnings, *problem.warnings(), *unfinished_warnings({"validation": health})],
        versions=versions(),
        commit=commit(),
        profile=profile(),
    )


def _seen_volumes(problem: CalibrationProblem, measures: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return volumes on all lanes, as the subject vehicle sees them while it drives along: no counts, but near them."""
    border = np.asarray(problem.road.section_border_m, float)
    lanes = np.diff(np.asarray(problem.road.lane_m_before(problem.road.section_border_m), float)) / np.diff(border)
    volumes = []
    for section, lane_count in enumerate(lanes):
        per_lane = measures[f"section_{section}_volume_vehph"]
        if per_lane["field"] is None or per_lane["simulated"] is None:
            continue
        name = f"{border[section]:.0f} to {border[section + 1]:.0f} m"
        volume = Volume(name, float(lane_count * per_lane["field"]), float(lane_count * per_lane["simulated"]))
        volumes.append(_volume_entry(volume))
    return volumes


def _volume_entry(volume: Volume) -> dict[str, Any]:
    return {
        "place": volume.place,
        "field_vehph": rounded(volume.field_vehph),
        "simulated_vehph": rounded(volume.simulated_vehph),
        "geh": rounded(volume.geh),
    }


def _count_requests(calibrated: CalibratedRun, requests: Sequence[RunRequest], seeds: int) -> list[RunRequest]:
    """Return runs in which vehicles are counted to the end, on seeds after those of the rounds."""
    first_seed, own = requests[-1].seed + 1, min(request.drive_start for request in requests)
    return [
        RunRequest(calibrated.values, first_seed + number, own.depart_s, drive=own.drive) for number in range(seeds)
    ]


def _counts_of(
    problem: CalibrationProblem,
    counted: FieldCounts | None,
    requests: Sequence[RunRequest],
    session: Session,
) -> tuple[list[RunOutcome], np.ndarray]:
    """Return runs to the scenario's end, and what is counted in each of them that succeeded, [seed, place].

    Raises:
        AllRunsFailedError: none did.
    """
    if counted is None:
        return [], np.zeros((0, 0))
    with sumo_engine(problem, counter=counted, workers=session.sumo_workers) as sumo:
        outcomes = list(JournaledSumo(sumo, session.journal).start(requests, session.progress.sumo_runs)())
    return outcomes, gather([outcomes]).tally[0][[outcome.status.is_ok for outcome in outcomes]]
