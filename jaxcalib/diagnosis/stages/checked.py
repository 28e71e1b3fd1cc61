"""The fourth stage: the best explanations checked in SUMO, where there is something to explain."""

from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.marginal_likelihood import best_gain
from jaxcalib.diagnosis.inference.sumo_check import Checked, check_in_sumo
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.tried import Tried, explaining
from sim_adapters.scenario.sumo_effects import is_expressible


def check_best(session: DiagnosisSession, baseline: Baseline, tried: Tried) -> Checked:
    """Correct the best signatures by SUMO's own runs, and judge again."""
    if best_gain(tried.explained) <= LEAST_EVIDENCE:
        return Checked(tried.explained, tried.signatures, ())
    session.progress.stage("check")
    with session.stopwatch.time("check"):
        return check_in_sumo(
            baseline.fitted.null,
            baseline.runs.plain,
            tried.signatures,
            baseline.by_chance,
            explaining(session, baseline, tried.num_places),
            lambda name: is_expressible(session.problem.scenario, name),
            baseline.in_sumo.with_effect,
        )
