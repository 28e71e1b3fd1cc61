"""Between judgement and refit: values of which the logs are silent, tried elsewhere before something is missing."""

from dataclasses import replace

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.marginal_likelihood import NONE, best_gain
from jaxcalib.diagnosis.inference.overdispersion import temperature
from jaxcalib.diagnosis.inference.silent_search import SilentSearch
from jaxcalib.diagnosis.inference.silent_values import OpenValues, evidence_between, shared_features
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.null_runs import num_runs_for
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import BASELINE
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.simulated import Simulated

LEAST_SHARED = 0.9  # of the features: a road that no longer shows what the drives show contradicts them


def reopen_silent_values(
    session: DiagnosisSession, simulated: Simulated, book: TrialBook, checked: Checked, judged: Judged
) -> Simulated:
    """Return the simulation at other values of those that the logs do not show, if these explain the drives better.

    The surrogate says which values may, from the present ones on and from those of the logs: what they do not show may
    have moved what they show. SUMO says whether they do so better than whatever else was tried, by as many runs as the
    present values have.
    """
    baseline, maker = simulated.baseline, simulated.maker
    is_silent = ~np.isfinite(maker.error)
    open_values = OpenValues(baseline.values, is_silent, *maker.bounds)
    if judged.verdict.kind in ("no_gap", "miscalibrated") or not open_values.num_points:
        return simulated
    with session.stopwatch.time("baseline"):
        found, num_tried = _found_in_surrogate(session, simulated, book, open_values)
        if found is None:
            return _counted(simulated, num_tried, num_baselines=0)
        try:
            first = maker.at(found, baseline.runner)
        except AllRunsFailedError:  # before the surrogate ran
            return _counted(simulated, num_tried)
        except NotTestableError:
            return _counted(simulated, num_tried + _num_slope_runs(found, session.plan.first_slope_runs))
        try:
            moved = maker.onward(first)
        except (NotTestableError, AllRunsFailedError):
            return _counted(simulated, num_tried + _num_slope_runs(found, session.plan.slope_runs))
        num_others = num_tried + moved.num_surrogate_runs
        if not _explains_best(baseline, moved.baseline, checked, judged, open_values.num_points):
            further = moved.num_sumo_runs + _num_further_runs(session, moved.baseline)
            num_runs = num_others + _num_slope_runs(found, session.plan.slope_runs)
            return _counted(simulated, num_runs, further, moved.num_baselines)
        given_up = 0 if simulated.default is None else simulated.default.num_runs
        num_sumo_runs = checked.num_runs + _num_further_runs(session, baseline) + given_up + moved.num_sumo_runs
        counted = _counted(simulated, book.num_runs + num_others, num_sumo_runs, moved.num_baselines).converged
        best = max((each for each in checked.explained if each.name != NONE), key=lambda each: each.log_evidence)
        default = moved.baseline.in_sumo.default()
        return Simulated(maker, replace(counted, baseline=moved.baseline), default, best.name)


def _found_in_surrogate(
    session: DiagnosisSession, simulated: Simulated, book: TrialBook, open_values: OpenValues
) -> tuple[np.ndarray | None, int]:
    """Return the likeliest values by the surrogate, and the runs that took beside the book's.

    None where none is likelier than the present ones.
    """
    baseline, first = simulated.baseline, simulated.converged.first
    books, num_runs = [(baseline, book)], 0
    if first.values.tolist() != baseline.values.tolist():
        books.append((first, simulated.trial_book(session, first)))
        num_runs -= books[-1][1].num_runs  # what is known was counted
    best, best_gain = None, LEAST_EVIDENCE
    for begin, its_book in books:
        null, plan = begin.fitted.null, session.plan
        search = SilentSearch(null, its_book.run, plan.silent_runs, plan.slope_runs, session.seed)
        opened = replace(open_values, values=begin.values)
        found = search.search(opened, begin.difference, its_book.run("silent", [])[BASELINE])
        there = evidence_between(null, begin.difference, baseline.fitted.null, baseline.difference)
        if found.num_moves and there + found.gain > best_gain:
            best, best_gain = found.values, there + found.gain
    return best, num_runs + sum(its_book.num_runs for _, its_book in books[1:])


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


def _num_slope_runs(values: np.ndarray, of_each: int) -> int:
    return (2 * len(values) + 1) * of_each


def _num_further_runs(session: DiagnosisSession, baseline: Baseline) -> int:
    """Return SUMO's runs of a baseline beyond its first ones."""
    return baseline.runs.plain.num_runs - num_runs_for(session.problem, session.plan.first_null_drives)


def _counted(
    simulated: Simulated, num_surrogate_runs: int = 0, num_sumo_runs: int = 0, num_baselines: int = 1
) -> Simulated:
    """The same with more baselines that were begun, and runs that were made for others."""
    known = simulated.converged
    return replace(
        simulated,
        converged=replace(
            known,
            num_baselines=known.num_baselines + num_baselines,
            num_surrogate_runs=known.num_surrogate_runs + num_surrogate_runs,
            num_sumo_runs=known.num_sumo_runs + num_sumo_runs,
        ),
    )
