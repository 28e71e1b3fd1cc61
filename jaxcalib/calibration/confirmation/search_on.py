"""The search goes on in SUMO from what the surrogate found, where the two drive unlike each other there."""

import numpy as np
from scipy.stats import chi2

from jaxcalib.calibration.confirmation.confirmation import CONFIRMATION, RADIUS, SEARCHED_ON, Confirmation, Finals
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.optimisation import SIGNIFICANT, polish_config, polish_on
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.calibration.stages.two_stage import TwoStageResult


def leaves_more_than_noise(confirmation: Confirmation) -> bool:
    """Whether the best finalist's misfit in SUMO is more than chance explains (chi-square, 5 %).

    Relative errors have no noise that could tell: there it always may be.
    """
    objective, seen = confirmation.objective.of_simulator(), confirmation.confirmed[confirmation.winner]
    if objective.is_relative:
        return True
    residuals = objective.residuals(seen.unit[None], seen.sumo[None], seen.sumo_runs)[0]
    return bool(chi2.sf(np.sum(residuals**2), len(residuals)) < SIGNIFICANT)


def search_on_in_sumo(
    confirmation: Confirmation, found: TwoStageResult, in_sumo: Evaluator, finals: Finals, plan: Budget
) -> Confirmation:
    """Improve the best finalist by steps that SUMO itself makes, and confirm where they lead.

    Args:
        confirmation: what SUMO made of the surrogate's finalists.
        found: what the two stages found.
        in_sumo: SUMO, on the seeds of the search.
        finals: both simulators, SUMO on seeds that no search has seen.
        plan: numbers of runs of a search in SUMO.

    Returns:
        The confirmation with one finalist more; the same where that one fails.
    """
    run = SearchRun(in_sumo, finals.space, confirmation.objective.of_simulator(), found.course)
    num_runs, config = in_sumo.rounds_of(plan.polish_runs), polish_config(RADIUS)
    polished, _ = polish_on(
        run, confirmation.best, found.half_width, num_runs, config, CONFIRMATION, most=plan.most_polishes
    )
    tried = finals.run(polished.best, SEARCHED_ON, confirmation.objective)
    confirmation = confirmation.joined([tried])
    finals.session.progress.best(confirmation.finalists[confirmation.winner].accuracy)
    return confirmation
