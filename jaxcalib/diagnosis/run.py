"""One call diagnoses a case: read values off the logs, see what chance and effects would do, judge the field."""

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path

from jaxcalib.cluster.opening import sumo_workers_at
from jaxcalib.diagnosis.answer.answer import Diagnosis
from jaxcalib.diagnosis.answer.conclusion import conclude
from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.stages.calibrated import Calibrated, calibrate_by_logs
from jaxcalib.diagnosis.stages.checked import check_best
from jaxcalib.diagnosis.stages.concluded import gather_findings, refuse_drives
from jaxcalib.diagnosis.stages.judged import Judged, judge_drives
from jaxcalib.diagnosis.stages.refitted import refit_best
from jaxcalib.diagnosis.stages.reopened import reopen_silent_values
from jaxcalib.diagnosis.stages.session import DiagnosisSession, begin_session
from jaxcalib.diagnosis.stages.simulated import Simulated, simulate_null, trial_book_of
from jaxcalib.diagnosis.stages.tried import Tried, try_effects
from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.problem import read_problem
from jaxcalib.runs.disk import check_out, check_outside
from jaxcalib.runs.profile import profile
from jaxcalib.runs.progress import Progress
from jaxcalib.runs.run_folder import identify
from jaxcalib.runs.seeds import MOST_SEED
from jaxcalib.runs.session import open_session
from sim_adapters.activity import Activity, doing


def diagnose(
    case: Path | str,
    out: Path | str | None = None,
    *,
    seed: int = 0,
    budget: float = 1.0,
    resume: bool = False,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose the gap between a case's scenario and its logs.

    Args:
        case: the case's folder.
        out: RUN, the folder for journal, diagnosis.json and diagnosis.html; None keeps nothing.
        seed: of all random numbers, 0 to 2000.
        budget: factor on the numbers of runs; the same budget does the same work on any machine.
        resume: go on with what `out` holds.
        cluster: address of a dask scheduler whose workers make SUMO's runs; None for this machine.
        progress: told how far it is.

    Returns:
        The diagnosis, as in diagnosis.json.

    Raises:
        CaseError: the case or RUN are wrong; one line says what.
        AllRunsFailedError: a simulator failed.
        ResourceError: a disk is full, or the cluster does not answer.
    """
    began_s = time.perf_counter()
    if not 0 <= seed <= MOST_SEED or not 0.05 <= budget <= 100.0:
        raise ValueError(f"Expected a seed of 0 to {MOST_SEED} and a budget of 0.05 to 100; got {seed} and {budget}.")
    if out is not None:
        check_outside(Path(out), Path(case))
        check_out(Path(out))
    prepare_devices(len(os.sched_getaffinity(0)))
    problem = read_problem(case, as_stated=True)
    identity = identify(problem.case, {"command": "diagnose", "seed": seed, "budget": budget})
    with (
        sumo_workers_at(cluster) as workers,
        open_session(
            out, identity, seed=seed, progress=progress, resume=resume, began_s=began_s, sumo_workers=workers
        ) as work,
    ):
        return _diagnose(begin_session(problem, budget, work))


def _diagnose(session: DiagnosisSession) -> Diagnosis:
    findings, diagnosis = answer(session, calibrate_by_logs(session))
    diagnosis = replace(diagnosis, profile=profile())
    session.folder.write_text("diagnosis.json", diagnosis.to_json())
    if findings is not None:
        session.progress.stage("report")
        from jaxcalib.diagnosis.answer.report import report_html

        with doing(Activity.REPORT):
            session.folder.write_text("diagnosis.html", report_html(findings, diagnosis))
    return diagnosis


def answer(session: DiagnosisSession, calibrated: Calibrated) -> tuple[Findings | None, Diagnosis]:
    """Return what there is to find from calibrated values on, and the answer; no findings where drives show little."""
    try:
        simulated = simulate_null(session, calibrated)
    except NotTestableError as error:
        return None, refuse_drives(session, calibrated, error)
    found = _judge(session, simulated)
    reopened = reopen_silent_values(session, simulated, found.book, found.checked, found.judged)
    if reopened.baseline is not simulated.baseline:
        found = _judge(session, reopened)
    tried, checked, judged = found.tried, found.checked, found.judged
    refitted = refit_best(session, reopened.baseline, found.book, checked, judged)
    findings = gather_findings(session, calibrated, reopened, found.book, tried, checked, judged, refitted)
    return findings, conclude(findings)


@dataclass(frozen=True)
class _Found:
    """What the drives to fit say of one calibrated simulation."""

    book: TrialBook
    tried: Tried
    checked: Checked
    judged: Judged


def _judge(session: DiagnosisSession, simulated: Simulated) -> _Found:
    baseline, book = simulated.baseline, trial_book_of(simulated.baseline, session)
    tried = try_effects(session, baseline, book)
    checked = check_best(session, baseline, tried)
    return _Found(book, tried, checked, judge_drives(session, baseline, tried.num_places, checked))
