"""Space mapping: the surrogate drives as SUMO does at other values, and those say where SUMO drives as the field does.

Near a jam the two differ by when it begins, more than by what it looks like: what one shows, the other shows at some
hundred vehicles per hour more or less. What the surrogate's moments lack at one point then says little of the next, but
how far its values lie from SUMO's does.

Source: Bandler, Biernacki, Chen, Grobelny & Hemmers (1994), Space mapping technique for electromagnetic optimization,
    IEEE Trans. Microwave Theory Tech. 42(12); the mapping is a shift, as at the beginning of Bandler, Biernacki, Chen,
    Hemmers & Madsen (1995), Electromagnetic optimization exploiting aggressive space mapping, IEEE Trans. Microwave
    Theory Tech. 43(12).
Deviation: the shift is found anew around each of SUMO's best candidates, instead of a slope of it being updated, since
    slopes of many parameters cannot be learnt from a few noisy runs; and half of each step is tried as well.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.confirmation.confirmation import (
    CONFIRMATION,
    CORRECTED_SEARCH,
    MAPPED,
    SAME_POINT,
    Confirmation,
    Finals,
)
from jaxcalib.calibration.confirmation.discrepancy import Confirmed
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.optimisation import Optimisation, polish_config, polish_on
from jaxcalib.calibration.stages.search_run import Judged, SearchRun
from jaxcalib.calibration.stages.two_stage import POLISH_RADIUS, TwoStageResult

SHARES = (0.5, 1.0)  # of a step, tried together

Unit = Float[np.ndarray, " parameter"]


def can_be_mapped(confirmation: Confirmation) -> bool:
    """Whether there is noise to judge by; without any, what one simulator shows cannot take the place of the field."""
    return not confirmation.objective.of_simulator().is_relative


def search_mapped(confirmation: Confirmation, found: TwoStageResult, finals: Finals) -> Confirmation:
    """Take steps of space mapping from the best finalist, as long as SUMO finds them better.

    Args:
        confirmation: what SUMO made of the surrogate's finalists.
        found: what the two stages found.
        finals: both simulators, SUMO on seeds that no search has seen, and how many steps there may be.

    Returns:
        The confirmation with the points tried as further finalists; they count equally often in SUMO as all others.
    """
    if not can_be_mapped(confirmation):
        return confirmation
    objective = confirmation.objective.of_simulator()
    search = _SurrogateSearch(finals, found)
    optimum = found.best
    for number in range(finals.plan.most_mappings):
        best, seen = confirmation.best, confirmation.confirmed[confirmation.winner]
        with finals.session.stopwatch.time(CORRECTED_SEARCH):
            shift = search.polished(as_field(objective, best, seen), best).best - best
            optimum = search.polished(shifted(objective, shift), optimum).best
        step = np.clip(optimum - shift, 0.0, 1.0) - best
        if np.abs(step).max() < SAME_POINT:
            break
        tried = [
            finals.run(one, f"{MAPPED} {number + 1}, {share:.0%} of the step", objective)
            for share in SHARES
            if not is_among(one := best + share * step, confirmation)
        ]
        before = confirmation.winner
        confirmation = replace(confirmation.joined(tried), shift=shift, judged=search.judged)
        finals.session.progress.best(confirmation.finalists[confirmation.winner].accuracy)
        if confirmation.winner == before:
            break
    return confirmation


def is_among(unit: Unit, confirmation: Confirmation) -> bool:
    """Whether a point is that of a finalist, up to what drivers would notice."""
    return any(np.abs(unit - one.unit).max() < SAME_POINT for one in confirmation.finalists)


def as_field(objective: Objective, unit: Unit, seen: Confirmed) -> Objective:
    """Return the distance to what SUMO showed at a point; what is known of parameters is now that they are those.

    Args:
        objective: distance to the field, of the surrogate as it is.
        unit: the point in the unit cube.
        seen: what SUMO showed there; the usual value stands for what it never did.
    """
    shown = objective.moments.values(seen.sumo)
    return replace(
        objective,
        field=np.where(np.isnan(shown), objective.usual, shown),
        num_drives=seen.sumo_runs,
        evidence=replace(objective.evidence, unit=unit),
    )


def shifted(objective: Objective, shift: Unit) -> Objective:
    """Return the distance to the field by the surrogate's values: SUMO's, of which something is known, plus a shift."""
    return replace(objective, evidence=replace(objective.evidence, unit=objective.evidence.unit + shift))


class _SurrogateSearch:
    """Polishes points in the surrogate by one objective or another; all candidates serve all of them."""

    def __init__(self, finals: Finals, found: TwoStageResult) -> None:
        self._finals = finals
        self._half_width = found.half_width
        self._known: list[Judged] = list(found.judged)
        self._num_found = len(self._known)

    @property
    def judged(self) -> tuple[Judged, ...]:
        """The candidates that it has run."""
        return tuple(self._known[self._num_found :])

    def polished(self, objective: Objective, start: Unit) -> Optimisation:
        """Polish a point of the unit cube."""
        finals = self._finals
        run = SearchRun(finals.surrogate, finals.space, objective)  # not the user's objective: no part of the course
        num_runs, config = finals.surrogate.rounds_of(finals.plan.polish_runs), polish_config(POLISH_RADIUS)
        most = finals.plan.most_polishes
        done, _ = polish_on(run, start, self._half_width, num_runs, config, CONFIRMATION, self._known, most)
        self._known += done.rounds
        return done
