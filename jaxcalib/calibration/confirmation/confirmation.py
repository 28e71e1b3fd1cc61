"""Finalists in SUMO: what the surrogate lacks is learnt from these runs, and the search goes on corrected for it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.confirmation.discrepancy import Confirmed, LearntDiscrepancy, learn_discrepancy
from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.calibration.stages.optimisation import polish_config, polish_on
from jaxcalib.calibration.stages.search_run import CourseEntry, Judged, SearchRun
from jaxcalib.calibration.stages.two_stage import TwoStageResult
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.problem.parameter_space import ParameterSpace
from jaxcalib.runs.seeds import NOISE_OFFSET
from jaxcalib.runs.session import Session
from sim_adapters.interface import RunOutcome

CONFIRMATION = "confirmation"
MAPPED, SEARCHED_ON = "space mapping", "search in SUMO"  # how a search goes on, and where such finalists come from
FOUND, NEXT_BEST = "two stages", "next best of the two stages"  # where the first finalist comes from
CORRECTED_SEARCH = "corrected_search"  # the surrogate's part of it, for the times
RADIUS = 0.12  # of the box of known widths
SAME_POINT = 0.01  # of the unit range; closer points are one point to drivers
MOST_BEGINNINGS = 3  # points of the search that SUMO is asked to run, one after the other, until it can run one


@dataclass(frozen=True)
class Finalist:
    """A candidate that SUMO has run."""

    unit: Float[np.ndarray, " parameter"]  # in the unit cube
    accuracy: float  # in SUMO
    surrogate_accuracy: float  # in the surrogate at the same values, corrected by what a corrected search knew
    origin: str  # where it comes from
    tallies: Float[np.ndarray, "run tally"]  # of its successful drives in SUMO


@dataclass(frozen=True)
class Confirmation:
    """What SUMO made of the finalists."""

    finalists: tuple[Finalist, ...]  # in the order in which they were run
    winner: int  # place of the best in SUMO
    agrees: bool  # whether the best in the surrogate, corrected, is the best in SUMO
    discrepancy: LearntDiscrepancy  # learnt from all finalists
    objective: Objective  # the objective, corrected by it
    confirmed: tuple[Confirmed, ...]  # what both simulators showed of each finalist
    outcomes: tuple[RunOutcome, ...]  # all drives of the finalists in SUMO
    # by how much the surrogate's values lie from SUMO's of the same traffic, near the winner; None unless mapped
    shift: Float[np.ndarray, " parameter"] | None = None
    judged: tuple[Judged, ...] = ()  # candidates that the surrogate ran to know it

    @property
    def best_in_surrogate(self) -> Float[np.ndarray, " parameter"]:
        """Where the surrogate drives as SUMO does at the winner, in the unit cube, as far as is known."""
        return self.best if self.shift is None else np.clip(self.best + self.shift, 0.0, 1.0)

    @property
    def best(self) -> Float[np.ndarray, " parameter"]:
        """The winner in the unit cube."""
        return self.finalists[self.winner].unit

    def joined(self, tried: "Sequence[FinalistRuns]") -> "Confirmation":
        """Return the confirmation with further candidates; those that failed in a simulator are no finalists."""
        runs = [
            (one.finalist, one.confirmed) for one in tried if one.finalist is not None and one.confirmed is not None
        ]
        outcomes = (*self.outcomes, *(outcome for one in tried for outcome in one.outcomes))
        finalists = [*self.finalists, *(finalist for finalist, _ in runs)]
        confirmed = [*self.confirmed, *(confirmed for _, confirmed in runs)]
        together = _judged(_learnt(self.objective, confirmed), finalists, confirmed, outcomes)
        return replace(together, shift=self.shift, judged=self.judged)

    @property
    def went_on_by(self) -> list[str]:
        """How the search went on with SUMO, if it did."""
        return [way for way in (MAPPED, SEARCHED_ON) if any(one.origin.startswith(way) for one in self.finalists)]


class FinalistRuns(NamedTuple):
    """What both simulators made of a candidate; it is no finalist where one of them failed."""

    outcomes: tuple[RunOutcome, ...]  # its drives in SUMO
    finalist: Finalist | None
    confirmed: Confirmed | None


@dataclass(frozen=True)
class Finals:
    """Runs candidates in both simulators, as many times each."""

    space: ParameterSpace
    surrogate: Evaluator
    sumo: Evaluator  # on seeds that no search has seen
    plan: Budget
    session: Session  # told of the time that the surrogate takes

    def run(self, unit: Float[np.ndarray, " parameter"], origin: str, objective: Objective) -> FinalistRuns:
        """Run a point of the unit cube, and judge it by SUMO's runs; the surrogate's are corrected by the objective."""
        values = self.space.values_of(unit[None])
        num_sumo, num_surrogate = self.sumo.rounds_of(self.plan.confirmation_runs), self.num_surrogate
        in_sumo, worth = self.sumo.evaluate(values, num_sumo), self.sumo.worth(num_sumo)
        with self.session.stopwatch.time(CORRECTED_SEARCH):
            in_surrogate = self.surrogate.evaluate(values, num_surrogate, NOISE_OFFSET)
        nobody = FinalistRuns(in_sumo.outcomes[0], None, None)
        if not in_sumo.is_ok[0] or not in_surrogate.is_ok[0]:
            return nobody
        rounded = self.space.unit_of(values)
        seen = objective.accuracy(objective.residuals(rounded, in_surrogate.pooled, num_surrogate))
        plain = objective.of_simulator()
        accuracy = float(plain.accuracy(plain.residuals(rounded, in_sumo.pooled, worth))[0])
        tallies = in_sumo.tally[0]
        finalist = Finalist(unit, accuracy, float(seen[0]), origin, tallies[np.isfinite(tallies).all(axis=1)])
        confirmed = Confirmed(unit, in_surrogate.pooled[0], num_surrogate, in_sumo.pooled[0], worth)
        return FinalistRuns(in_sumo.outcomes[0], finalist, confirmed)

    @property
    def num_surrogate(self) -> int:
        """Runs of a candidate in the surrogate."""
        return self.surrogate.rounds_of(self.plan.noise_runs)


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
    finals = Finals(space, surrogate, sumo, budget, session)
    course: list[CourseEntry] = found.course
    confirmed: list[Confirmed] = []
    finalists: list[Finalist] = []
    outcomes: list[RunOutcome] = []
    judged: list[Judged] = list(found.judged)
    unit, origin, beginnings = found.best, FOUND, _beginnings(found)
    for number in range(budget.confirmation_rounds):
        runs = finals.run(unit, origin, objective)
        outcomes += runs.outcomes
        while runs.finalist is None and not finalists and beginnings:
            why = f"What the search found cannot be confirmed ({_why_none(runs.outcomes)})"
            session.progress.notes([f"{why}; so the next best of its last comparison is tried."])
            unit, origin = beginnings.pop(0), NEXT_BEST
            runs = finals.run(unit, origin, objective)
            outcomes += runs.outcomes
        if runs.finalist is None or runs.confirmed is None:
            break
        finalists.append(runs.finalist)
        session.progress.best(max(one.accuracy for one in finalists))
        confirmed.append(runs.confirmed)
        objective = _learnt(objective, confirmed)
        if number + 1 == budget.confirmation_rounds:
            break
        with session.stopwatch.time(CORRECTED_SEARCH):
            run = SearchRun(surrogate, space, objective, course)
            best = max(finalists, key=lambda one: one.accuracy).unit
            num_polish, config = surrogate.rounds_of(budget.polish_runs), polish_config(RADIUS)
            polished, _ = polish_on(
                run, best, found.half_width, num_polish, config, CONFIRMATION, judged, budget.most_polishes
            )
        if np.abs(polished.best - unit).max() < SAME_POINT:
            break
        unit, origin = polished.best, f"corrected search {number + 1}"
    if not finalists:
        tail = next((outcome.log_tail for outcome in outcomes if outcome.log_tail), "")
        raise AllRunsFailedError(f"the search's result failed in SUMO: {_why_none(outcomes)}", tail)
    return _judged(objective, finalists, confirmed, tuple(outcomes))


def _beginnings(found: TwoStageResult) -> list[Float[np.ndarray, " parameter"]]:
    """Return what came next to the search's result in its last comparison, for where that cannot be confirmed."""
    last, points = found.judged[-1], [found.best]
    for place in np.argsort(-np.nan_to_num(last.accuracy, nan=-np.inf)):
        if last.is_ok[place] and all(np.abs(last.unit[place] - one).max() >= SAME_POINT for one in points):
            points.append(last.unit[place])
    return points[1:MOST_BEGINNINGS]


def _why_none(outcomes: Sequence[RunOutcome]) -> str:
    """Return why a point is no finalist."""
    reasons = "; ".join(sorted({outcome.status.value for outcome in outcomes if not outcome.status.is_ok}))
    return reasons or "the surrogate, which is to be compared with it, cannot drive there"


def _learnt(objective: Objective, confirmed: list[Confirmed]) -> Objective:
    """Return the objective corrected by what candidates showed in both simulators."""
    discrepancy = learn_discrepancy(objective.moments, objective.covariance, objective.num_drives, confirmed)
    return replace(objective, discrepancy=discrepancy)


def _judged(
    objective: Objective,
    finalists: list[Finalist],
    confirmed: list[Confirmed],
    outcomes: tuple[RunOutcome, ...],
) -> Confirmation:
    """Return what finalists say together, by an objective corrected by all of them."""
    winner = int(np.argmax([one.accuracy for one in finalists]))
    corrected = [_corrected_accuracy(objective, one) for one in confirmed]
    return Confirmation(
        finalists=tuple(finalists),
        winner=winner,
        agrees=int(np.argmax(corrected)) == winner,
        discrepancy=objective.discrepancy,  # pyright: ignore[reportArgumentType]
        objective=objective,
        confirmed=tuple(confirmed),
        outcomes=outcomes,
    )


def _corrected_accuracy(objective: Objective, one: Confirmed) -> float:
    residuals = objective.residuals(one.unit[None], one.surrogate[None], one.surrogate_runs)
    return float(objective.accuracy(residuals)[0])
