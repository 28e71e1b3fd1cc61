"""Between judgement and refit: values of which the logs are silent, tried elsewhere before something is missing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from jaxcalib.diagnosis.stages.simulated import Simulated, trial_book_of

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
        found, tried = _found_in_surrogate(session, simulated, book, open_values)
        first, tried = _best_in_sumo(session, simulated, found, tried)
        if first is None:
            return tried.added_to(simulated)
        try:
            moved = maker.onward(first)
        except (NotTestableError, AllRunsFailedError):
            return tried.plus(_num_slope_runs(first.values, session.plan.slope_runs)).added_to(simulated)
        # the first baseline of the way was counted with those that were tried
        tried = tried.plus(moved.num_surrogate_runs, moved.num_sumo_runs, moved.num_baselines - 1)
        num_chances = len(found) * open_values.num_points
        if not _explains_best(baseline, moved.baseline, checked, judged, num_chances):
            num_runs = _num_slope_runs(first.values, session.plan.slope_runs)
            return tried.plus(num_runs, _num_further_runs(session, moved.baseline)).added_to(simulated)
        given_up = 0 if simulated.default is None else simulated.default.num_runs
        tried = tried.plus(book.num_runs, checked.num_runs + _num_further_runs(session, baseline) + given_up)
        best = max((each for each in checked.explained if each.name != NONE), key=lambda each: each.log_evidence)
        counted = tried.added_to(simulated).converged
        default = moved.baseline.in_sumo.default()
        return Simulated(maker, replace(counted, baseline=moved.baseline), default, best.name)


@dataclass(frozen=True)
class _Tried:
    """What was run beside the trials of the book."""

    num_surrogate_runs: int = 0
    num_sumo_runs: int = 0  # beside the first ones of baselines
    num_baselines: int = 0  # that were begun

    def plus(self, num_surrogate_runs: int = 0, num_sumo_runs: int = 0, num_baselines: int = 0) -> "_Tried":
        return _Tried(
            self.num_surrogate_runs + num_surrogate_runs,
            self.num_sumo_runs + num_sumo_runs,
            self.num_baselines + num_baselines,
        )

    def added_to(self, simulated: Simulated) -> Simulated:
        """Return a simulation that counts it."""
        known = simulated.converged
        return replace(
            simulated,
            converged=replace(
                known,
                num_baselines=known.num_baselines + self.num_baselines,
                num_surrogate_runs=known.num_surrogate_runs + self.num_surrogate_runs,
                num_sumo_runs=known.num_sumo_runs + self.num_sumo_runs,
            ),
        )


def _found_in_surrogate(
    session: DiagnosisSession, simulated: Simulated, book: TrialBook, open_values: OpenValues
) -> tuple[list[np.ndarray], _Tried]:
    """Return the likeliest values by the surrogate from each beginning on, where they are likelier than there."""
    baseline, first = simulated.baseline, simulated.converged.first
    books, num_known = [(baseline, book)], 0
    if first.values.tolist() != baseline.values.tolist():
        books.append((first, trial_book_of(first, session)))
        num_known = books[-1][1].num_runs  # counted when it was made
    likeliest = []
    for begin, its_book in books:
        plan = session.plan
        search = SilentSearch(begin.fitted.null, its_book.run, plan.silent_runs, plan.slope_runs, session.seed)
        opened = replace(open_values, values=begin.values)
        found = search.search(opened, begin.difference, its_book.run("silent", [])[BASELINE])
        if found.gain > LEAST_EVIDENCE:
            likeliest.append(found.values)
    return likeliest, _Tried(sum(its_book.num_runs for _, its_book in books[1:]) - num_known)


def _best_in_sumo(
    session: DiagnosisSession, simulated: Simulated, several: Sequence[np.ndarray], tried: _Tried
) -> tuple[Baseline | None, _Tried]:
    """Return the baseline from which the drives are likeliest in SUMO, with its first runs; None where all fail.

    By how much the surrogate prefers one says little where both begin at other values: it is SUMO that is held against
    the drives.
    """
    baseline, best, most = simulated.baseline, None, -np.inf
    for values in several:
        tried = tried.plus(num_baselines=1)
        try:
            first = simulated.maker.at(values, baseline.runner)
        except AllRunsFailedError:  # before the surrogate ran
            continue
        except NotTestableError:
            tried = tried.plus(_num_slope_runs(values, session.plan.first_slope_runs))
            continue
        null = baseline.fitted.null
        evidence = evidence_between(first.fitted.null, first.difference, null, baseline.difference)
        if best is not None:  # one of them is given up
            tried = tried.plus(_num_slope_runs(values, session.plan.first_slope_runs))
        if evidence > most:
            best, most = first, evidence
    return best, tried


def _explains_best(baseline: Baseline, moved: Baseline, checked: Checked, judged: Judged, num_chances: int) -> bool:
    """Return whether moved values explain the drives better than all else does, by as many chances as points had.

    Evidence is as sure as that between explanations.
    """
    null = baseline.fitted.null
    if len(shared_features(moved.fitted.null, null)) < LEAST_SHARED * len(null.cells):
        return False
    pairs = judged.grounds.pairs
    others = best_gain(checked.explained) + (0.0 if pairs is None else max(pairs.gain, 0.0))
    gain = evidence_between(moved.fitted.null, moved.difference, null, baseline.difference) - others
    return gain / temperature(checked.explained, baseline.by_chance) - np.log(num_chances) >= LEAST_EVIDENCE


def _num_slope_runs(values: np.ndarray, of_each: int) -> int:
    return (2 * len(values) + 1) * of_each


def _num_further_runs(session: DiagnosisSession, baseline: Baseline) -> int:
    """Return SUMO's runs of a baseline beyond its first ones."""
    return baseline.runs.plain.num_runs - num_runs_for(session.problem, session.plan.first_null_drives)
