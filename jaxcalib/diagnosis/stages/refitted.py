"""The sixth stage: the best explanations fitted again around runs that contain them, and the last verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.refit import MOST_SUMO_POINTS, OTHERS_SUMO_POINTS, Refit, most_misfit, refit
from jaxcalib.diagnosis.inference.refitted_contest import contenders, is_enough_alone, with_refits, without_poor_fits
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import Verdict
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRunner
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.session import DiagnosisSession


@dataclass(frozen=True)
class Refitted:
    """The explanations after the best were fitted again."""

    explained: Sequence[Explained]  # explanations, best first
    verdict: Verdict  # the answer
    refits: Mapping[str, Refit]  # by effect

    @property
    def named(self) -> Refit | None:
        """The refit of the effect that is named first; None where there is none, or two are there together."""
        if self.verdict.kind == "pair":
            return None
        return self.refits.get(self.verdict.effects[0]) if self.verdict.effects else None


def refit_best(
    session: DiagnosisSession,
    baseline: Baseline,
    book: TrialBook,
    checked: Checked,
    judged: Judged,
) -> Refitted:
    """Fit the best explanations again, where the verdict says that there is something to explain."""
    if judged.verdict.kind in ("no_gap", "miscalibrated"):
        return Refitted(checked.explained, judged.verdict, {})
    session.progress.stage("refit")
    with session.stopwatch.time("refit"):
        chosen = contenders(checked.explained, checked.signatures, judged.verdict)
        refits = _refits(baseline, checked, chosen, _runner(session, baseline, book))
        grounds = judged.grounds
        if grounds.is_sure_of_two and is_enough_alone(refits, grounds.by_chance):
            grounds = replace(grounds, pairs=None)
        explained = with_refits(checked.explained, refits)
        verdict = grounds.verdict_on(explained)
        if not grounds.is_sure_of_two:  # each of two leaves what the other does
            verdict = without_poor_fits(verdict, refits, grounds.by_chance, grounds.never_alone)
        return Refitted(explained, verdict, refits)


def _runner(session: DiagnosisSession, baseline: Baseline, book: TrialBook) -> ExplainedRunner:
    return ExplainedRunner(
        problem=session.problem,
        values=baseline.values,
        sumo=baseline.in_sumo,
        null=baseline.fitted.null,
        run_trials=lambda trials: book.run("explained", trials),
        num_runs=session.plan.effect_runs,
    )


def _refits(
    baseline: Baseline, checked: Checked, chosen: Sequence[Explained], runner: ExplainedRunner
) -> dict[str, Refit]:
    fitted = baseline.fitted
    refits: dict[str, Refit] = {}
    fitting_steps = None  # those of the first that fits: the others need no search of their own
    for rank, contender in enumerate(chosen):
        most_points = OTHERS_SUMO_POINTS if rank else MOST_SUMO_POINTS
        signatures = checked.signatures[contender.name]
        refitted = refit(fitted, contender, signatures, runner, most_points, fitting_steps)
        if refitted is None:
            continue
        refits[contender.name] = refitted
        if fitting_steps is None and refitted.misfit <= most_misfit(len(fitted.null.cells)):
            fitting_steps = refitted.steps
    return refits
