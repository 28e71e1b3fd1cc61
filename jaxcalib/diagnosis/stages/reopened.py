"""Between judgement and refit: values of which the logs are silent, tried elsewhere before something is missing."""

from dataclasses import replace

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, best_gain
from jaxcalib.diagnosis.inference.overdispersion import temperature
from jaxcalib.diagnosis.inference.silent_values import (
    FittedAnswer,
    OpenValues,
    evidence_between,
    likeliest_values,
    shared_features,
)
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.null_runs import num_runs_for
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial, has_pairs, paired_difference
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.simulated import Simulated

LEAST_SHARED = 0.9  # of the features: a road that no longer shows what the drives show contradicts them


def reopen_silent_values(
    session: DiagnosisSession, simulated: Simulated, book: TrialBook, checked: Checked, judged: Judged
) -> Simulated:
    """Return the simulation at other values of those that the logs do not show, if these explain the drives better.

    The surrogate says which values may; SUMO, whether they do so better than whatever else was tried, by as many runs
    as the present values have.
    """
    baseline, maker = simulated.baseline, simulated.maker
    open_values = OpenValues(baseline.values, ~np.isfinite(maker.error), *maker.bounds)
    if judged.verdict.kind in ("no_gap", "miscalibrated") or not open_values.num_points:
        return simulated
    with session.stopwatch.time("baseline"):
        answer = _answer_in_surrogate(baseline, book, open_values, session)
        if answer is None:
            return simulated
        values, gain = likeliest_values(answer, baseline.difference, baseline.fitted.null, session.seed)
        if gain <= LEAST_EVIDENCE:
            return simulated
        try:
            first = maker.at(values, baseline.runner)
        except AllRunsFailedError:  # before the surrogate ran
            return _counted(simulated)
        except NotTestableError:
            return _counted(simulated, _num_slope_runs(values, session.plan.first_slope_runs))
        try:
            moved = maker.whole(first)
        except (NotTestableError, AllRunsFailedError):
            return _counted(simulated, _num_slope_runs(values, session.plan.slope_runs))
        if not _explains_best(baseline, moved, checked, judged, open_values.num_points):
            further = _num_further_runs(session, moved)
            return _counted(simulated, _num_slope_runs(values, session.plan.slope_runs), further)
        given_up = 0 if simulated.default is None else simulated.default.num_runs
        num_sumo_runs = checked.num_runs + _num_further_runs(session, baseline) + given_up
        counted = _counted(simulated, book.num_runs, num_sumo_runs).converged
        best = max((each for each in checked.explained if each.name != NONE), key=lambda each: each.log_evidence)
        return Simulated(maker, replace(counted, baseline=moved), moved.in_sumo.default(), best.name)


def _explains_best(baseline: Baseline, moved: Baseline, checked: Checked, judged: Judged, num_points: int) -> bool:
    """Return whether moved values explain the drives better than all else does, each of the points having its chance.

    Evidence is as sure as that between explanations.
    """
    null = baseline.fitted.null
    if len(shared_features(moved.fitted.null, null)) < LEAST_SHARED * len(null.cells):
        return False
    pairs = judged.grounds.pairs
    others = best_gain(checked.explained) + (0.0 if pairs is None else max(pairs.gain, 0.0))
    gain = evidence_between(moved.fitted.null, moved.difference, null, baseline.difference) - others
    return gain / temperature(checked.explained, baseline.by_chance) - np.log(num_points) >= LEAST_EVIDENCE


def _answer_in_surrogate(
    baseline: Baseline, book: TrialBook, open_values: OpenValues, session: DiagnosisSession
) -> FittedAnswer | None:
    """Return what features answer to the open values in the surrogate; None where too few of its runs succeed."""
    points = open_values.spread(open_values.num_points, session.seed)
    trials = [Trial(f"silent {point.tolist()!r}", tuple(point.tolist()), session.plan.silent_runs) for point in points]
    tallies = book.run("silent", trials)
    null, here = baseline.fitted.null, tallies[BASELINE]
    made = [(point, tallies[trial.name]) for point, trial in zip(points, trials, strict=True)]
    shown, shifts = [], []
    for point, there in made:
        if has_pairs(there, here):
            shift, error, _ = paired_difference(there, here, null.cells)
            shown.append(point)
            shifts.append(np.where(np.isfinite(error), shift, np.nan) / null.deviation)
    return FittedAnswer.to_runs(open_values, shown, shifts)


def _num_slope_runs(values: np.ndarray, of_each: int) -> int:
    return (2 * len(values) + 1) * of_each


def _num_further_runs(session: DiagnosisSession, baseline: Baseline) -> int:
    """Return SUMO's runs of a baseline beyond its first ones."""
    return baseline.runs.plain.num_runs - num_runs_for(session.problem, session.plan.first_null_drives)


def _counted(simulated: Simulated, num_surrogate_runs: int = 0, num_sumo_runs: int = 0) -> Simulated:
    """The same with one more baseline that was begun, and runs that were made for another one."""
    known = simulated.converged
    return replace(
        simulated,
        converged=replace(
            known,
            num_baselines=known.num_baselines + 1,
            num_surrogate_runs=known.num_surrogate_runs + num_surrogate_runs,
            num_sumo_runs=known.num_sumo_runs + num_sumo_runs,
        ),
    )
