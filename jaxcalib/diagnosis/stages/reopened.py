"""Between judgement and refit: values of which the logs are silent, tried elsewhere before something is missing."""

from dataclasses import replace

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.marginal_likelihood import best_gain
from jaxcalib.diagnosis.inference.silent_values import FittedAnswer, OpenValues, evidence_between, likeliest_values
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial, has_pairs, paired_difference
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.session import DiagnosisSession
from jaxcalib.diagnosis.stages.simulated import Simulated


def reopen_silent_values(
    session: DiagnosisSession, simulated: Simulated, book: TrialBook, checked: Checked, judged: Judged
) -> Simulated:
    """Return the simulation at other values of those that the logs do not show, if these explain the drives better.

    The surrogate says which values may; SUMO, whether they do so better than whatever else was tried.
    """
    baseline, maker = simulated.baseline, simulated.maker
    open_values = OpenValues(baseline.values, ~np.isfinite(maker.error), *maker.bounds)
    if judged.verdict.kind in ("no_gap", "miscalibrated") or not open_values.num_points:
        return simulated
    with session.stopwatch.time("baseline"):
        answer = _answer_in_surrogate(baseline, book, open_values, session)
        if answer is None:
            return simulated
        fitted = baseline.fitted
        values, gain = likeliest_values(answer, fitted.difference, fitted.null, session.seed)
        if gain <= LEAST_EVIDENCE:
            return simulated
        num_slope_runs = (2 * len(values) + 1) * session.plan.first_slope_runs
        try:
            moved = maker.at(values, baseline.runner)
        except (NotTestableError, AllRunsFailedError):
            return _counted(simulated, num_slope_runs)
        pairs = judged.grounds.pairs
        others = best_gain(checked.explained) + (0.0 if pairs is None else max(pairs.gain, 0.0))
        in_sumo = evidence_between(fitted.tallies.values(), fitted.null.cells, moved.fitted.null, fitted.null)
        if in_sumo - np.log(open_values.num_points) <= others:
            return _counted(simulated, num_slope_runs)
        whole = maker.whole(moved)
        counted = _counted(simulated, book.num_runs, checked.num_runs).converged
        return Simulated(maker, replace(counted, baseline=whole), whole.in_sumo.default())


def _answer_in_surrogate(
    baseline: Baseline, book: TrialBook, open_values: OpenValues, session: DiagnosisSession
) -> FittedAnswer | None:
    """Return what features answer to the open values in the surrogate; None where too few of its runs succeed."""
    points = open_values.spread(open_values.num_points, session.seed)
    trials = [Trial(f"silent {point.tolist()!r}", tuple(point.tolist()), session.plan.silent_runs) for point in points]
    tallies = book.run("silent", trials)
    null, here = baseline.fitted.null, tallies[BASELINE]
    made = [(point, tallies[trial.name]) for point, trial in zip(points, trials, strict=True)]
    shown = [(point, there) for point, there in made if has_pairs(there, here)]
    shifts = [paired_difference(there, here, null.cells)[0] / null.deviation for _, there in shown]
    return FittedAnswer.to_runs(open_values, [point for point, _ in shown], shifts)


def _counted(simulated: Simulated, num_surrogate_runs: int, num_sumo_runs: int = 0) -> Simulated:
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
