"""The errors that a result is judged by: in SUMO, on seeds that no search has seen, beside those of no calibration."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jaxcalib.calibration.objective.accuracy import (
    VEHICLE_LEVEL_SUM,
    Effectiveness,
    effectiveness,
    mean_errors,
    noise_floor,
    vehicle_level_of,
)
from jaxcalib.calibration.objective.bootstrap import Samples, bootstrap_errors, interval_of
from jaxcalib.calibration.stages.evaluator import Evaluator, gather
from jaxcalib.case.case import ROLES, Role
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.journal import JournaledSumo
from jaxcalib.runs.seeds import FINAL_SEEDS
from jaxcalib.runs.session import Session
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest


@dataclass(frozen=True)
class FinalRuns:
    """SUMO runs of one point on the drives of one role."""

    tally: Float[np.ndarray, "run tally"]  # tallies of the successful runs
    drive: np.ndarray  # which drive of the role each stands for
    outcomes: tuple[RunOutcome, ...]  # all runs


@dataclass(frozen=True)
class Change:
    """By how much an error is larger than before; None where one of the two is missing."""

    value: float | None
    interval_90: tuple[float, float] | None


@dataclass(frozen=True)
class FinalErrors:
    """Errors on the drives of one role."""

    num_drives: int  # drives of the field
    pooled: Effectiveness  # errors of all runs pooled
    per_seed: dict[str, float | None]  # mean over seeds of the errors of one run per drive
    samples: Samples  # each error and Eq. 23 with drives and runs drawn again.
    floor: dict[str, float | None]  # mean errors of field-like sets of the same runs
    floor_vehicle_level: float  # mean of Eq. 23 over those sets.
    floor_high: dict[str, float | None]  # 95 % quantile of each error and of Eq. 23 over them.

    @property
    def interval(self) -> dict[str, tuple[float, float] | None]:
        """90 % interval of each error and of Eq. 23."""
        return {name: interval_of(samples, self.num_drives) for name, samples in self.samples.items()}

    def change_since(self, before: "FinalErrors") -> dict[str, Change]:
        """Return by how much each error and Eq. 23 exceed those of another simulation of the same drives."""
        changes = {}
        for name, samples in self.samples.items():
            after, other = self.error(name), before.error(name)
            value = None if after is None or other is None else after - other
            changes[name] = Change(value, interval_of(samples - before.samples[name], self.num_drives))
        return changes

    def error(self, name: str) -> float | None:
        """Return an error or Eq. 23, all runs pooled."""
        return self.pooled.vehicle_level if name == VEHICLE_LEVEL_SUM else self.pooled.errors[name]


def start_final_runs(
    problem: CalibrationProblem,
    sumo: JournaledSumo,
    values: Float[np.ndarray, " parameter"],
    role: Role,
    num_runs: int,
    session: Session,
    shares_runs: bool = False,
    may_fail: bool = False,
) -> Callable[[], FinalRuns]:
    """Start the runs of a point in the background; return what waits for them.

    Args:
        problem: the problem.
        sumo: SUMO.
        values: parameter values.
        role: drives.
        num_runs: runs, the drives in turn, each with a seed of its own.
        session: gives the seeds, and is told of each run.
        shares_runs: whether drives that depart far enough apart share a run and its seed; what counts as a run above is
            a drive then.
        may_fail: whether runs of which none succeeds are an answer, too, rather than an AllRunsFailedError: an entrance
            may be full when drives that were held out depart.
    """
    starts, first_seed = problem.drive_starts(role), session.first_seed + FINAL_SEEDS[role]
    num_runs = num_runs if starts else 0
    if shares_runs and num_runs:
        requests = Evaluator(sumo, starts, first_seed, shares_runs=True).requests(values, num_runs)
    else:
        requests = requests_in_turn(values, starts, num_runs, first_seed)
    drive = _drives_in_turn([request.drive_start for request in requests], starts)
    wait = sumo.start(requests, session.progress.sumo_runs)

    def finish() -> FinalRuns:
        outcomes = wait()
        if not outcomes or (may_fail and not any(outcome.status.is_ok for outcome in outcomes)):
            return FinalRuns(np.zeros((0, len(problem.tally_names))), drive[:0], tuple(outcomes))
        tally = gather([outcomes]).tally[0]
        is_ok = np.isfinite(tally).all(axis=1)
        return FinalRuns(tally[is_ok], drive[is_ok], tuple(outcomes))

    return finish


def requests_in_turn(
    values: Float[np.ndarray, " parameter"], starts: Sequence[DriveStart], num_runs: int, first_seed: int
) -> list[RunRequest]:
    """Return runs of one point, each with a seed and a drive of its own; the drives in turn."""
    told = tuple(float(value) for value in values)
    taken = (starts[run % len(starts)] for run in range(num_runs))
    return [RunRequest(told, first_seed + run, one.depart_s, drive=one.drive) for run, one in enumerate(taken)]


def final_errors(
    problem: CalibrationProblem, role: Role, runs: FinalRuns, floor_runs: FinalRuns | None
) -> FinalErrors | None:
    """Return the errors of runs against the field's drives of a role; None where it has none.

    Args:
        problem: the problem.
        role: drives.
        runs: runs of one point.
        floor_runs: runs of that point, these and others, from which field-like sets are drawn; None for no floor.
    """
    field = problem.field_of(role)
    if not len(field) or not len(runs.tally):
        return None
    names, measures = problem.tally_names, problem.measures
    real = field.sum(axis=0)
    singles = [effectiveness(measures, names, real, one) for one in _one_run_per_drive(runs)]
    draws = noise_floor(measures, names, floor_runs.tally, floor_runs.drive) if floor_runs else []
    pooled = effectiveness(measures, names, real, runs.tally.sum(axis=0))
    sums = vehicle_level_of(draws, pooled)
    return FinalErrors(
        num_drives=len(field),
        pooled=pooled,
        per_seed=mean_errors(singles),
        samples=bootstrap_errors(measures, names, field, runs.tally),
        floor=mean_errors(draws),
        floor_vehicle_level=float(np.mean(sums)) if sums else float("nan"),
        floor_high={
            **{name: _quantile([draw.errors[name] for draw in draws]) for name in singles[0].errors},
            VEHICLE_LEVEL_SUM: _quantile(sums),
        },
    )


def runs_of_role(problem: CalibrationProblem, runs: Mapping[Role, FinalRuns], role: Role) -> FinalRuns:
    """Return all runs that can stand for the drives of a role, each drive equally often."""
    together = all_runs_of_role(problem, runs, role)
    if not len(together.tally):
        return together
    chosen = np.sort(np.concatenate(_rounds(together)))
    return FinalRuns(together.tally[chosen], together.drive[chosen], together.outcomes)


def all_runs_of_role(
    problem: CalibrationProblem, runs: Mapping[Role, FinalRuns], role: Role, more: Iterable[RunOutcome] = ()
) -> FinalRuns:
    """Return all runs that can stand for the drives of a role, and of more runs of the same point those that can.

    Runs of drives of both roles that depart at the same time are often alike but for their seed, so those for one role
    serve the other as well.
    """
    others = [outcome for other in ROLES if other != role for outcome in runs[other].outcomes]
    return with_outcomes(runs[role], problem.drive_starts(role), (*others, *more))


def with_outcomes(runs: FinalRuns, starts: Sequence[DriveStart], more: tuple[RunOutcome, ...]) -> FinalRuns:
    """Return runs together with those among others of the same point that could stand for the same drives.

    Args:
        runs: runs that stand for drives.
        starts: when the subject vehicle departs in each drive.
        more: other runs; those that failed or stand for other drives are left out.
    """
    used = [outcome for outcome in more if outcome.status.is_ok and outcome.request.drive_start in starts]
    if not used:
        return runs
    drive = _drives_in_turn([outcome.request.drive_start for outcome in used], starts)
    tally = np.asarray([outcome.observed for outcome in used], float)
    return FinalRuns(np.vstack([runs.tally, tally]), np.concatenate([runs.drive, drive]), (*runs.outcomes, *used))


def _drives_in_turn(of_runs: Sequence[DriveStart], starts: Sequence[DriveStart]) -> np.ndarray:
    """Return which drive each run stands for: drives that are alike take runs in turn."""
    places: dict[DriveStart, list[int]] = {}
    for place, start in enumerate(starts):
        places.setdefault(start, []).append(place)
    seen: dict[DriveStart, int] = {}
    drive = []
    for start in of_runs:
        seen[start] = seen.get(start, -1) + 1
        drive.append(places[start][seen[start] % len(places[start])])
    return np.asarray(drive, int)


def _one_run_per_drive(runs: FinalRuns) -> list[Float[np.ndarray, " tally"]]:
    """Return the pooled tallies of each complete round of drives."""
    return [runs.tally[places].sum(axis=0) for places in _rounds(runs)]


def _rounds(runs: FinalRuns) -> list[np.ndarray]:
    """Return the places of the runs of each complete round of drives."""
    places = [np.flatnonzero(runs.drive == one) for one in np.unique(runs.drive)]
    rounds = min(len(place) for place in places)
    return [np.asarray([place[number] for place in places]) for number in range(rounds)]


def _quantile(errors: Sequence[float | None]) -> float | None:
    known = [error for error in errors if error is not None]
    return float(np.quantile(known, 0.95)) if known else None
