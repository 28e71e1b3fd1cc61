"""What every stage needs: candidates of the unit cube in, residuals and accuracy out, and a record of all of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.calibration.objective.objective import Objective
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.problem.parameter_space import ParameterSpace


@dataclass(frozen=True)
class Judged:
    """Candidates and what became of them."""

    unit: Float[np.ndarray, "candidate parameter"]  # in the unit cube, as they were run (rounded values)
    values: Float[np.ndarray, "candidate parameter"]
    pooled: Float[np.ndarray, "candidate tally"]  # pooled tallies; nan if a candidate failed
    residuals: Float[np.ndarray, "candidate moment"]  # whitened residuals; nan if it failed
    accuracy: Float[np.ndarray, " candidate"]  # nan if it failed
    num_runs: int  # runs behind each

    @property
    def is_ok(self) -> Bool[np.ndarray, " candidate"]:
        """Whether a candidate may win."""
        return np.isfinite(self.accuracy)

    @property
    def best(self) -> int:
        """Place of the best candidate.

        Raises:
            AllRunsFailedError: all failed.
        """
        if not self.is_ok.any():
            raise AllRunsFailedError(
                "all candidates of a shortlist failed; narrow the bounds, or doubt the scenario", ""
            )
        return int(np.nanargmax(self.accuracy))


@dataclass(frozen=True)
class CourseEntry:
    """One round of a stage, for the report."""

    stage: str  # name of the stage
    num_runs: int  # runs made up to the end of this round
    accuracy: tuple[float, ...]  # of the round's candidates; nan where one failed
    best_accuracy: float  # best of the stage so far


@dataclass
class SearchRun:
    """An evaluator with an objective, and the course of the search so far."""

    evaluator: Evaluator
    space: ParameterSpace
    objective: Objective
    course: list[CourseEntry] = field(default_factory=list)

    def with_objective(self, objective: Objective) -> "SearchRun":
        """Return the same run with another objective; it goes on with the same record."""
        return replace(self, objective=objective)

    def judge(
        self, unit: Float[np.ndarray, "candidate parameter"], num_runs: int, stage: str, offset: int = 0
    ) -> Judged:
        """Run candidates and judge them.

        Args:
            unit: candidates.
            num_runs: runs for each.
            stage: name of the stage, for the record.
            offset: of the seeds.
        """
        values = self.space.values_of(unit)
        judged = self.rejudge(self.evaluator.evaluate(values, num_runs, offset).pooled, values, num_runs)
        before = [entry.best_accuracy for entry in self.course if entry.stage == stage]
        best = np.nanmax(np.append(judged.accuracy, before or -np.inf), initial=-np.inf)
        accuracy = tuple(float(one) for one in judged.accuracy)
        self.course.append(CourseEntry(stage, self.evaluator.num_runs, accuracy, float(best)))
        return judged

    def shortlist(
        self, unit: Float[np.ndarray, "candidate parameter"], num_runs: int, stage: str, offset: int
    ) -> Judged:
        """Run the few candidates that may win once more, longer and on other seeds.

        The best of many noisy accuracies is the luckiest rather than the best, so none of them decides.
        """
        return self.judge(np.unique(unit, axis=0), num_runs, stage, offset)

    def rejudge(
        self,
        pooled: Float[np.ndarray, "candidate tally"],
        values: Float[np.ndarray, "candidate parameter"],
        num_runs: int,
    ) -> Judged:
        """Judge candidates that have been run already, by the present objective."""
        unit = self.space.unit_of(values)
        residuals = self.objective.residuals(unit, pooled, num_runs)
        return Judged(unit, values, pooled, residuals, self.objective.accuracy(residuals), num_runs)


def best_of(judged: Sequence[Judged], count: int) -> Float[np.ndarray, "candidate parameter"]:
    """Return the best candidates of several rounds, best first."""
    unit = np.vstack([one.unit for one in judged])
    accuracy = np.concatenate([one.accuracy for one in judged])
    order = np.argsort(-np.nan_to_num(accuracy, nan=-np.inf), kind="stable")
    return unit[order[:count]]
