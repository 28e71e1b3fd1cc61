"""The calibrated simulation as a diagnosis needs it: SUMO's null runs, the parameters' slopes, the drives against it.

Nothing is tested before the recalibration has converged. The calibration matches its own measures; where all features
of the diagnosis together would still move a parameter far, it is moved there and everything is made again. Else what a
poor calibration leaves would be taken for an effect.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxcalib.calibration.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.atlas import parameter_steps, parameter_trials
from jaxcalib.diagnosis.conventions import conventions_of, expected_drivers
from jaxcalib.diagnosis.drive_features import DriveFeatures
from jaxcalib.diagnosis.drive_table import DriveTable
from jaxcalib.diagnosis.explained_runs import moved_values
from jaxcalib.diagnosis.features import DriveTallies, gather_tallies, joined_tallies
from jaxcalib.diagnosis.investigation import NotTestableError, Prepared, prepare
from jaxcalib.diagnosis.ledger import parameter_shift
from jaxcalib.diagnosis.null_runs import NullRuns
from jaxcalib.diagnosis.plan import DiagnosisBudget
from jaxcalib.diagnosis.stages import Stages
from jaxcalib.diagnosis.sumo_runs import SumoRuns
from jaxcalib.diagnosis.trial_engine import trial_runner
from jaxcalib.diagnosis.trials import TrialRunner
from jaxcalib.problem import CalibrationProblem
from jaxcalib.progress import Progress

MOST_ROUNDS = 3
FAR_STEPS = 3.0  # beyond them a linear shift of parameters is no longer to be trusted
LONGEST_STEPS = 5.0  # that a parameter is moved at once


@dataclass(frozen=True)
class Baseline:
    """The calibrated simulation, and the drives against it.

    Attributes:
        values: parameter values.
        features: what is counted.
        in_sumo: makes SUMO's runs.
        runs: SUMO's runs without effect.
        runner: makes the surrogate's trials.
        found: tallies of the parameters' trials by name.
        field: tallies of all drives.
        fitted: null model and drives to fit.
    """

    values: np.ndarray
    features: DriveFeatures
    in_sumo: SumoRuns
    runs: NullRuns
    runner: TrialRunner
    found: dict[str, DriveTallies]
    field: DriveTallies
    fitted: Prepared

    @property
    def shift(self) -> np.ndarray:
        """By how much all features would move the parameters, in steps."""
        return parameter_shift(self.fitted.difference, self.fitted.null)

    @property
    def misfit(self) -> float:
        """Mean squared misfit of a feature, after that shift, in units of noise."""
        difference, null = self.fitted.difference, self.fitted.null
        return float(difference @ np.linalg.solve(null.covariance, difference)) / len(difference)


@dataclass(frozen=True)
class BaselineMaker:
    """Makes baselines.

    Attributes:
        problem: the problem.
        plan: numbers of runs.
        stages: keeps finished parts.
        first_seed: of SUMO's runs.
        trial_seed: of the surrogate's.
        tables: the drives.
        progress: told of runs.
        bounds: least and largest value of each parameter; features bent by an effect must not lead beyond them.
    """

    problem: CalibrationProblem
    plan: DiagnosisBudget
    stages: Stages
    first_seed: int
    trial_seed: int
    tables: Sequence[DriveTable]
    progress: Progress
    bounds: tuple[np.ndarray, np.ndarray]

    def converged(self, values: np.ndarray) -> tuple[Baseline, int]:
        """Return the baseline that agrees best with the drives to fit, with all its runs, and how many were begun.

        Which way to move takes fewer runs than to judge drives by them.

        Args:
            values: calibrated values, to begin with.

        Raises:
            NotTestableError: the drives show too little.
        """
        best, number = self.at(values, None), 1
        while number < MOST_ROUNDS and np.max(np.abs(best.shift)) > FAR_STEPS:
            number += 1
            steps = np.clip(best.shift, -LONGEST_STEPS, LONGEST_STEPS)
            sizes = parameter_steps(self.problem.layout, best.values)
            moved = np.clip(moved_values(best.values, sizes, steps), *self.bounds)
            try:
                latest = self.at(moved, best.runner)
            except (NotTestableError, AllRunsFailedError):
                break  # too little is seen there, or the subject vehicle finds no way in
            if latest.misfit >= best.misfit:
                break
            best = latest
        return self.whole(best), number

    def whole(self, first: Baseline) -> Baseline:
        """Return a baseline with all its runs.

        Raises:
            NotTestableError: the drives show too little.
        """
        self.progress.stage("null")
        runs, found = first.in_sumo.whole_null(first.runs), first.found
        begin = self.plan.first_slope_runs
        if begin < self.plan.slope_runs:
            self.progress.stage("atlas")
            further = self._slopes(first.values, first.runner, self.plan.slope_runs - begin, begin)
            found = {name: joined_tallies(tallies, further[name]) for name, tallies in found.items()}
        return replace(first, runs=runs, found=found, fitted=self._fitted(first.field, runs, found))

    def at(self, values: np.ndarray, runner: TrialRunner | None) -> Baseline:
        """Return the baseline at some values, with the first of its runs.

        Args:
            values: the values.
            runner: of an earlier baseline, whose program serves again; None for a new one.

        Raises:
            NotTestableError: the drives show too little.
        """
        problem, progress = self.problem, self.progress
        background, subject = expected_drivers(problem, values)
        features = DriveFeatures(conventions_of(problem), background, subject)
        progress.stage("null")
        in_sumo = SumoRuns(problem, features, values, self.plan, self.stages, self.first_seed, progress.sumo_runs)
        runs = in_sumo.first_null()
        progress.stage("atlas")
        if runner is None:
            runner = trial_runner(problem, features, self.trial_seed)
        runner = replace(runner, features=features)
        found = self._slopes(values, runner, self.plan.first_slope_runs, 0)
        departs = [drive.depart_s for drive in problem.case.drives]
        field = gather_tallies([features.of_table(table) for table in self.tables], departs)
        fitted = self._fitted(field, runs, found)
        return Baseline(values, features, in_sumo, runs, runner, found, field, fitted)

    def _slopes(
        self, values: np.ndarray, runner: TrialRunner, num_runs: int, first_run: int
    ) -> dict[str, DriveTallies]:
        trials = parameter_trials(self.problem.layout, values, num_runs, first_run)
        part = f"slopes {values.tolist()!r} from run {first_run}"
        return self.stages.tallies(part, lambda: runner.run(trials, self.progress.surrogate_runs))

    def _fitted(self, field: DriveTallies, runs: NullRuns, found: Mapping[str, DriveTallies]) -> Prepared:
        is_fit = np.asarray([drive.role == "fit" for drive in self.problem.drives])
        return prepare(self.problem, field.take(is_fit), runs, found)
