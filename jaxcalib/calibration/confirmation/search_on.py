"""The search goes on in SUMO from what the surrogate found, where the two drive unlike each other there."""

from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.confirmation.confirmation import CONFIRMATION, RADIUS, Confirmation, Finalist
from jaxcalib.calibration.confirmation.discrepancy import Confirmed
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.calibration.stages.optimisation import polish, polish_config
from jaxcalib.calibration.stages.search_box import search_box
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.calibration.stages.two_stage import TwoStageResult
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.runs.seeds import NOISE_OFFSET
from jaxcalib.runs.session import Session

SEARCHED_ON = "search in SUMO"


@dataclass(frozen=True)
class Evaluators:
    """What runs candidates."""

    surrogate: Evaluator
    in_sumo: Evaluator  # SUMO, on the seeds of the search
    confirming: Evaluator  # SUMO, on seeds that no search has seen


def search_on_in_sumo(
    confirmation: Confirmation,
    found: TwoStageResult,
    initial: InitialPoint,
    evaluators: Evaluators,
    plan: Budget,
    session: Session,
) -> Confirmation:
    """Improve the best finalist by steps that SUMO itself makes, and confirm where they lead.

    Args:
        confirmation: what SUMO made of the surrogate's finalists.
        found: what the two stages found.
        initial: for the parameter space.
        evaluators: of both simulators.
        plan: numbers of runs of a search in SUMO.
        session: told of the best.

    Returns:
        The confirmation with one finalist more; the same where that one fails.
    """
    space, objective = initial.space, replace(confirmation.objective, discrepancy=None)
    run = SearchRun(evaluators.in_sumo, space, objective, found.course)
    box = search_box(confirmation.best, range(len(space.names)), found.half_width)
    num_polish = evaluators.in_sumo.rounds_of(plan.polish_runs)
    polished = polish(run, box, confirmation.best, num_polish, polish_config(RADIUS), CONFIRMATION)
    values = space.values_of(polished.best[None])
    num_sumo = confirmation.num_drives_each
    in_sumo = evaluators.confirming.evaluate(values, num_sumo)
    num_surrogate = evaluators.surrogate.rounds_of(plan.noise_runs)
    in_surrogate = evaluators.surrogate.evaluate(values, num_surrogate, NOISE_OFFSET)
    worth = evaluators.confirming.worth(num_sumo)
    unit = space.unit_of(values)
    residuals = objective.residuals(unit, in_sumo.pooled, worth)
    accuracy = float(objective.accuracy(residuals)[0])
    if not (in_sumo.is_ok[0] and in_surrogate.is_ok[0] and np.isfinite(accuracy)):
        return confirmation
    seen = confirmation.objective.residuals(unit, in_surrogate.pooled, num_surrogate)
    expected = float(confirmation.objective.accuracy(seen)[0])
    finalists = (*confirmation.finalists, Finalist(polished.best, accuracy, expected, SEARCHED_ON))
    winner = int(np.argmax([finalist.accuracy for finalist in finalists]))
    session.progress.best(finalists[winner].accuracy)
    confirmed = Confirmed(polished.best, in_surrogate.pooled[0], num_surrogate, in_sumo.pooled[0], worth)
    return replace(
        confirmation,
        finalists=finalists,
        winner=winner,
        agrees=False,
        confirmed=(*confirmation.confirmed, confirmed),
        polishes=(*confirmation.polishes, polished),
        outcomes=(*confirmation.outcomes, *in_sumo.outcomes[0]),
    )
