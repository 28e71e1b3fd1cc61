"""Finalists in SUMO: what the surrogate lacks is learnt from these runs, and the search goes on corrected for it."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.confirmation.discrepancy import Confirmed, LearntDiscrepancy, learn_discrepancy
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.calibration.stages.optimisation import Optimisation, polish, polish_config
from jaxcalib.calibration.stages.search_box import search_box
from jaxcalib.calibration.stages.search_run import CourseEntry, Judged, SearchRun
from jaxcalib.calibration.stages.two_stage import TwoStageResult
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.runs.seeds import NOISE_OFFSET
from jaxcalib.runs.session import Session
from sim_adapters.interface import RunOutcome
from sim_adapters.shared_runs import shared_runs

CONFIRMATION = "confirmation"
CORRECTED_SEARCH = "corrected_search"  # the surrogate's part of it, for the times
RADIUS = 0.12  # of the box of known widths
SAME_POINT = 0.01  # of the unit range; closer points are one point to drivers


@dataclass(frozen=True)
class Finalist:
    """A candidate that SUMO has run."""

    unit: Float[np.ndarray, " parameter"]  # in the unit cube
    accuracy: float  # in SUMO
    surrogate_accuracy: float  # in the surrogate, as the search saw it, corrected by what was known before
    origin: str  # where it comes from


@dataclass(frozen=True)
class Confirmation:
    """What SUMO made of the finalists."""

    finalists: tuple[Finalist, ...]  # in the order in which they were run
    winner: int  # place of the best in SUMO
    agrees: bool  # whether the best in the surrogate, corrected, is the best in SUMO
    discrepancy: LearntDiscrepancy  # learnt from all finalists
    objective: Objective  # the objective, corrected by it
    confirmed: tuple[Confirmed, ...]  # what both simulators showed of each finalist
    polishes: tuple[Optimisation, ...]  # what each corrected search reported
    outcomes: tuple[RunOutcome, ...]  # all drives of the finalists in SUMO
    num_drives_each: int  # drives of one finalist in SUMO

    def tallies_of(self, place: int) -> Float[np.ndarray, "run tally"]:
        """Return the tallies of a finalist's successful drives in SUMO."""
        first = place * self.num_drives_each
        outcomes = self.outcomes[first : first + self.num_drives_each]
        return np.asarray([outcome.observed for outcome in outcomes if outcome.status.is_ok], float)

    @property
    def best(self) -> Float[np.ndarray, " parameter"]:
        """The winner in the unit cube."""
        return self.finalists[self.winner].unit

    @property
    def num_sumo_runs(self) -> int:
        """SUMO runs of the finalists; drives may have shared some."""
        return len(shared_runs([outcome.request for outcome in self.outcomes]))


def confirm(
    found: TwoStageResult,
    initial: InitialPoint,
    surrogate: Evaluator,
    sumo: Evaluator,
    budget: Budget,
    session: Session,
) -> Confirmation:
    """Confirm the search's result in SUMO, and search on where the two disagree.

    Args:
        found: what the search found.
        initial: for the parameter space.
        surrogate: evaluator of the surrogate.
        sumo: evaluator of SUMO, on seeds that no search has seen.
        budget: numbers of runs.
        session: told of the stage, and of the time that the surrogate takes in it.
    """
    session.progress.stage(CONFIRMATION)
    space, objective = initial.space, found.objective
    num_sumo = sumo.rounds_of(budget.confirmation_runs)
    worth = sumo.worth(num_sumo)
    num_surrogate = surrogate.rounds_of(budget.noise_runs)
    course: list[CourseEntry] = found.course
    confirmed: list[Confirmed] = []
    finalists: list[Finalist] = []
    polishes: list[Optimisation] = []
    outcomes: list[RunOutcome] = []
    judged: list[Judged] = list(found.judged)
    unit, origin = found.best, "two stages"
    for number in range(budget.confirmation_rounds):
        values = space.values_of(unit[None])
        in_sumo = sumo.evaluate(values, num_sumo)
        outcomes += in_sumo.outcomes[0]
        with session.stopwatch.time(CORRECTED_SEARCH):
            in_surrogate = surrogate.evaluate(values, num_surrogate, NOISE_OFFSET)
        if not in_sumo.is_ok[0] or not in_surrogate.is_ok[0]:
            break
        run = SearchRun(surrogate, space, objective, course)
        seen = run.rejudge(in_surrogate.pooled, values, num_surrogate)
        plain = replace(objective, discrepancy=None)
        residuals = plain.residuals(seen.unit, in_sumo.pooled, worth)
        accuracy = float(plain.accuracy(residuals)[0])
        if not np.isfinite(accuracy):
            break  # SUMO never showed one of the moments: nothing can be said of these values, as of a failed run
        finalists.append(Finalist(unit, accuracy, float(seen.accuracy[0]), origin))
        session.progress.best(max(one.accuracy for one in finalists))
        confirmed.append(Confirmed(unit, in_surrogate.pooled[0], num_surrogate, in_sumo.pooled[0], worth))
        discrepancy = learn_discrepancy(objective.moments, objective.covariance, objective.num_drives, confirmed)
        objective = replace(objective, discrepancy=discrepancy)
        if number + 1 == budget.confirmation_rounds:
            break
        with session.stopwatch.time(CORRECTED_SEARCH):
            run = run.with_objective(objective)
            best = max(finalists, key=lambda one: one.accuracy).unit
            box = search_box(best, range(len(space.names)), found.half_width)
            num_polish = surrogate.rounds_of(budget.polish_runs)
            polishes.append(polish(run, box, best, num_polish, polish_config(RADIUS), CONFIRMATION, judged))
        if np.abs(polishes[-1].best - unit).max() < SAME_POINT:
            break
        unit, origin = polishes[-1].best, f"corrected search {number + 1}"
    if not finalists:
        reasons = "; ".join(sorted({outcome.status.value for outcome in outcomes if not outcome.status.is_ok}))
        reasons = reasons or "a measure that is matched was never observed in its runs"
        tail = next((outcome.log_tail for outcome in outcomes if outcome.log_tail), "")
        raise AllRunsFailedError(f"the search's result failed in SUMO: {reasons}", tail)
    winner = int(np.argmax([one.accuracy for one in finalists]))
    corrected = [_corrected_accuracy(objective, one) for one in confirmed]
    return Confirmation(
        finalists=tuple(finalists),
        winner=winner,
        agrees=int(np.argmax(corrected)) == winner,
        discrepancy=objective.discrepancy,  # pyright: ignore[reportArgumentType]
        objective=objective,
        confirmed=tuple(confirmed),
        polishes=tuple(polishes),
        outcomes=tuple(outcomes),
        num_drives_each=num_sumo,
    )


def _corrected_accuracy(objective: Objective, one: Confirmed) -> float:
    residuals = objective.residuals(one.unit[None], one.surrogate[None], one.surrogate_runs)
    return float(objective.accuracy(residuals)[0])
