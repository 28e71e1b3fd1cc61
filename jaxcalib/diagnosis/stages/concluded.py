"""The last stage: what was found, put together for answer and report."""

from jaxcalib.diagnosis.answer.answer import Diagnosis
from jaxcalib.diagnosis.answer.conclusion import refuse
from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.pairs import with_pair
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.visibility import atlas_of
from jaxcalib.diagnosis.runs.null_runs import num_runs_for
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.stages.calibrated import Calibrated
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.refitted import Refitted
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.simulated import Simulated
from jaxcalib.diagnosis.stages.tried import Tried


def gather_findings(
    session: DiagnosisSession,
    calibrated: Calibrated,
    simulated: Simulated,
    book: TrialBook,
    tried: Tried,
    checked: Checked,
    judged: Judged,
    refitted: Refitted,
) -> Findings:
    """Put together what all stages found."""
    baseline = simulated.baseline
    num_places, pairs = tried.num_places, judged.grounds.pairs
    explained = refitted.explained
    if refitted.verdict.kind == "pair" and pairs is not None:
        explained = with_pair(explained, pairs.best)
    session.stopwatch.add("reading", 0.0)
    return Findings(
        problem=session.problem,
        seed=session.seed,
        values=baseline.values,
        moved=simulated.moved(session.problem.layout.names),
        instead_of=simulated.instead_of,
        fitted=baseline.fitted,
        held_out=judged.held_out,
        num_places=num_places,
        null_runs=baseline.runs.plain,
        default=simulated.default,
        explained=explained,
        verdict=refitted.verdict,
        refit=refitted.named,
        pairs=pairs,
        signatures=checked.signatures,
        atlas=atlas_of(
            checked.signatures,
            baseline.fitted.null,
            int(session.is_fit.sum()),
            1.0 / baseline.runs.plain.num_independent,
            num_places,
            judged.grounds.needed_gain,
        ),
        windows=tried.windows,
        checks=checked.checks,
        runs={
            "surrogate": _num_surrogate_runs(calibrated, simulated, book),
            "sumo": _num_sumo_runs(session, calibrated, simulated, checked, refitted),
        },
        wall_s=session.wall_s,
    )


def refuse_drives(session: DiagnosisSession, calibrated: Calibrated, error: NotTestableError) -> Diagnosis:
    """The diagnosis of drives that show too little."""
    plan = session.plan
    num_trials = 2 * len(session.problem.layout.names) + 1
    runs = {
        "surrogate": calibrated.num_surrogate_runs + num_trials * plan.first_slope_runs,
        "sumo": calibrated.num_sumo_runs + num_runs_for(session.problem, plan.first_null_drives),
    }
    return refuse(session.problem, calibrated.values, str(error), runs, session.wall_s)


def _num_surrogate_runs(calibrated: Calibrated, simulated: Simulated, book: TrialBook) -> int:
    return calibrated.num_surrogate_runs + book.num_runs + simulated.converged.num_surrogate_runs


def _num_sumo_runs(
    session: DiagnosisSession, calibrated: Calibrated, simulated: Simulated, checked: Checked, refitted: Refitted
) -> int:
    num_given_up = simulated.converged.num_baselines - 1
    return (
        calibrated.num_sumo_runs
        + simulated.converged.num_sumo_runs
        + simulated.baseline.runs.plain.num_runs
        + num_given_up * num_runs_for(session.problem, session.plan.first_null_drives)
        + (0 if simulated.default is None else simulated.default.num_runs)
        + checked.num_runs
        + sum(refit.num_sumo_runs for refit in refitted.refits.values())
    )
