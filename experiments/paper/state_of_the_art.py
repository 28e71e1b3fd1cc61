"""The state of the art that the paper compares with: a memetic algorithm on volumes and speeds, without screening."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from experiments.paper import memetic
from jaxcalib.calibration.objective.moments import Moments, moments_of
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.problem.parameter_space import ParameterSpace
from jaxcalib.problem.problem import CalibrationProblem

ROUND_OFFSET = 1_000  # of the seeds: each round has its own, so that nobody wins by luck for long
SHORTLIST_OFFSET = 500_000
SHORTLIST_RUNS = 4  # times as many as for a candidate, as the two-stage methods do
NUM_SHORTLISTED = 5


@dataclass(frozen=True)
class VolumesAndSpeeds:
    """The objective: normalised root mean square error of volume and speed of each section of the route."""

    moments: Moments  # volumes and speeds
    field: Float[np.ndarray, " moment"]  # their values in the field

    def accuracy(self, pooled: Float[np.ndarray, "candidate tally"]) -> Float[np.ndarray, " candidate"]:
        """Return 1 less the error; nan for a candidate that failed.

        Source: Paz et al. (2015), NRMS over links; volumes and speeds weigh the same here.
        """
        with np.errstate(invalid="ignore"):
            relative = (self.moments.values(pooled) - self.field) / self.field
        return 1.0 - np.sqrt(np.mean(relative**2, axis=1))


def volumes_and_speeds(problem: CalibrationProblem) -> VolumesAndSpeeds:
    """Return the objective of a case, on the sections that its drives to fit have seen."""
    names = [f"section_{n}_{what}" for n in range(problem.road.num_sections) for what in ("volume_vehph", "speed_mps")]
    moments = moments_of([problem.measures[name] for name in names], problem.tally_index)
    field = moments.values(problem.field_of("fit").sum(axis=0))
    seen = np.isfinite(field) & (np.nan_to_num(field) > 0.0)
    return VolumesAndSpeeds(moments.take(seen), field[seen])


def search(
    problem: CalibrationProblem,
    space: ParameterSpace,
    start: Float[np.ndarray, " parameter"],
    evaluator: Evaluator,
    runs_per_candidate: int,
    most_runs: int,
    threshold: float | None,
    seed: int,
    on_best: Callable[[float], None],
) -> Float[np.ndarray, " parameter"]:
    """Return the point of the unit cube that the memetic algorithm finds over the whole range of all parameters.

    The start is a candidate of the first generation. The search ends with the round that reaches the most runs, or the
    threshold of the accuracy, if there is one.
    """
    objective = volumes_and_speeds(problem)
    num_runs = evaluator.rounds_of(runs_per_candidate)

    def accuracy_of(unit: Float[np.ndarray, "candidate parameter"], runs: int, offset: int) -> np.ndarray:
        return objective.accuracy(evaluator.evaluate(space.values_of(unit), runs, offset).pooled)

    spared = NUM_SHORTLISTED * SHORTLIST_RUNS * num_runs
    state = memetic.init(len(space.names), seed, start[None])
    while True:
        state = memetic.tell(state, accuracy_of(memetic.ask(state), num_runs, ROUND_OFFSET * state.round))
        on_best(state.best_accuracy)
        if evaluator.num_runs + spared >= most_runs:
            break
        if threshold is not None and state.best_accuracy >= threshold:
            break
    few = [start, state.population[0]] if state.best_candidate is None else [start, state.best_candidate]
    few += list(state.population[np.argsort(-state.accuracy)][: NUM_SHORTLISTED - 2])
    shortlist = np.unique(np.stack(few), axis=0)
    accuracy = accuracy_of(shortlist, SHORTLIST_RUNS * num_runs, SHORTLIST_OFFSET)
    return shortlist[int(np.argmax(np.nan_to_num(accuracy, nan=-np.inf)))]
