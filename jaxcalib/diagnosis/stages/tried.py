"""The third stage: every effect tried, everywhere or where it may be, and judged by what it would do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.signature import Signature
from jaxcalib.diagnosis.features.windows import Window
from jaxcalib.diagnosis.inference.atlas import EffectTrial, effect_trials, effects_to_try
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import all_signatures, explanations
from jaxcalib.diagnosis.inference.local_search import windows_of_effects
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained, best_gain
from jaxcalib.diagnosis.inference.place_search import refine_places
from jaxcalib.diagnosis.inference.sumo_check import Explain
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.stages.session import DiagnosisSession


@dataclass(frozen=True)
class Tried:
    """The effects, tried and judged."""

    num_places: Mapping[str, int]  # how many places were looked at for each local effect
    windows: Mapping[str, Sequence[Window]]  # where local effects were tried
    signatures: Mapping[str, Sequence[Signature]]  # what each effect does to the features
    explained: Sequence[Explained]  # explanations, best first


def explaining(session: DiagnosisSession, baseline: Baseline, num_places: Mapping[str, int]) -> Explain:
    """Return what judges the drives to fit by signatures."""
    return partial(explanations, session.problem, baseline.values, baseline.fitted, num_places=num_places)


def try_effects(session: DiagnosisSession, baseline: Baseline, book: TrialBook) -> Tried:
    """Try every effect of the registry and judge the drives to fit by it."""
    values, plan, fitted = baseline.values, session.plan, baseline.fitted
    effects = effects_to_try(session.problem.layout)
    session.progress.stage("atlas")
    with session.stopwatch.time("atlas"):
        everywhere = effect_trials(values, plan.effect_runs, {}, effects)
        book.run("effects", [tried.trial for tried in everywhere])
    session.progress.stage("evidence")
    with session.stopwatch.time("evidence"):
        windows, num_places = windows_of_effects(fitted.difference, fitted.null, baseline.features.road)
        local = [
            tried for tried in effect_trials(values, plan.local_runs, windows, effects) if tried.window is not None
        ]
        tallies = book.run("local", [tried.trial for tried in local])
        signatures = all_signatures(fitted, baseline.runs, [*everywhere, *local], tallies)
        explain = explaining(session, baseline, num_places)
        tried = Tried(num_places, windows, signatures, explain(signatures))
        return _refined(session, baseline, book, tried) if best_gain(tried.explained) > LEAST_EVIDENCE else tried


def _refined(session: DiagnosisSession, baseline: Baseline, book: TrialBook, tried: Tried) -> Tried:
    """The same with better places of the local effects among the best."""

    def run(trials: Sequence[EffectTrial]) -> Mapping[str, DriveTallies]:
        return book.run("nearby", [nearby.trial for nearby in trials])

    fitted = baseline.fitted
    lanes = sorted({int(lane) for lane in baseline.features.road.lane_from_left})
    signatures = refine_places(
        fitted.difference,
        fitted.null,
        fitted.disagrees,
        tried.explained,
        tried.signatures,
        baseline.values,
        session.plan.local_runs,
        lanes,
        run,
    )
    explain = explaining(session, baseline, tried.num_places)
    return replace(tried, signatures=signatures, explained=explain(signatures))
