"""The calibrated simulation as a diagnosis needs it: SUMO's null runs, the parameters' slopes, the drives against it.

It begins at what the logs say of the values. Where all features of the diagnosis together would still move a parameter
far, it is moved there, within what the logs leave open, and everything is made again: else what poor values leave would
be taken for an effect. How far to go is found out in the surrogate: by what the move changes there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.features.conventions import conventions_of, expected_drivers
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, gather_tallies, joined_tallies
from jaxcalib.diagnosis.features.noise import NullModel
from jaxcalib.diagnosis.inference.atlas import parameter_trials
from jaxcalib.diagnosis.inference.investigation import NotTestableError, Prepared, prepare
from jaxcalib.diagnosis.inference.ledger import parameter_shift
from jaxcalib.diagnosis.runs.explained_runs import least_values
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import NullRuns
from jaxcalib.diagnosis.runs.parameter_steps import parameter_steps
from jaxcalib.diagnosis.runs.plan import DiagnosisBudget
from jaxcalib.diagnosis.runs.sumo_runs import SumoRuns
from jaxcalib.diagnosis.runs.trial_engine import trial_runner
from jaxcalib.diagnosis.runs.trials import Trial, TrialRunner, has_pairs, paired_difference
from jaxcalib.problem.engines import DECISION_INTERVAL_S
from jaxcalib.problem.parameter_space import round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.progress import Progress
from sim_adapters.sumo.workers import SumoWorkers
from surrogate.road.drive_table import DriveTable

MOST_ROUNDS = 3
# What stays open of a parameter, in steps: no less than what pairs of vehicles get wrong, and no more than
# slopes are linear over, where the logs are silent, or features have moved it.
LEAST_OPEN_STEPS, MOST_OPEN_STEPS = 0.5, 1.5
FAR_STEPS = 3.0  # beyond them a linear shift of parameters is no longer to be trusted
LONGEST_STEPS = 5.0  # that a parameter is moved at once
MOST_MOVES = 3  # in the surrogate, before SUMO runs where they led


@dataclass(frozen=True)
class Baseline:
    """The calibrated simulation, and the drives against it."""

    values: np.ndarray  # parameter values
    features: DriveFeatures  # what is counted
    in_sumo: SumoRuns  # makes SUMO's runs
    runs: NullRuns  # SUMO's runs without effect
    runner: TrialRunner  # makes the surrogate's trials
    trials: Mapping[str, DriveTallies]  # tallies of the parameters' trials by name
    field: DriveTallies  # tallies of all drives
    fitted: Prepared  # null model and drives to fit
    prior_steps: np.ndarray  # shift of each parameter that stays open, in steps, as a standard deviation

    def prepared(self, drives: DriveTallies) -> Prepared:
        """Return the null model for some drives.

        Raises:
            NotTestableError: the drives show too little.
        """
        return prepare(self.in_sumo.problem, drives, self.runs, self.trials, self.prior_steps)

    @cached_property
    def difference(self) -> np.ndarray:
        """Difference of the drives to fit from the null, in units of noise, less what sensors are known to make of it.

        Values must not move to where they make up for sensors.
        """
        cells, deviation = self.fitted.null.cells, self.fitted.null.deviation
        by_sensors = (self.runs.altered[each] for each in self.in_sumo.measured.items())
        known = [paired_difference(altered, self.runs.plain, cells)[0] / deviation for altered in by_sensors]
        return self.fitted.difference - np.sum([np.zeros(len(cells)), *known], axis=0)

    @property
    def shift(self) -> np.ndarray:
        """By how much all features would move the parameters, in steps."""
        return parameter_shift(self.difference, self.fitted.null)

    @property
    def by_chance(self) -> float:
        """Squared misfit that as many drives leave in the mean where nothing is missing: 1 for each feature."""
        return float(len(self.fitted.null.cells))

    @property
    def misfit(self) -> float:
        """Mean squared misfit of a feature, after that shift, in units of noise."""
        return _misfit(self.difference, self.fitted.null)


@dataclass(frozen=True)
class Converged:
    """Where baselines led."""

    first: Baseline  # where they began
    baseline: Baseline  # the one to stay with
    num_baselines: int  # how many were begun
    num_surrogate_runs: int  # runs of the surrogate that the others took, and the way between them
    num_sumo_runs: int = 0  # runs of SUMO that judging by others took


@dataclass(frozen=True)
class BaselineMaker:
    """Makes baselines."""

    problem: CalibrationProblem
    plan: DiagnosisBudget  # numbers of runs
    parts: FinishedParts  # keeps finished parts
    first_seed: int  # of SUMO's runs
    trial_seed: int  # of the surrogate's
    tables: Sequence[DriveTable]  # the drives
    progress: Progress  # told of runs
    begin: np.ndarray  # values that the drives show by themselves
    error: np.ndarray  # their standard errors; inf where the drives are silent
    # least and largest value of each parameter; features bent by an effect must not lead beyond them
    bounds: tuple[np.ndarray, np.ndarray]
    sumo_workers: SumoWorkers | None = None  # who makes SUMO's runs; None for processes of this machine
    decision_interval_s: float = DECISION_INTERVAL_S  # of the surrogate
    measured: Mapping[str, float] = field(default_factory=dict)  # strengths of sensors' effects, see `SumoRuns`

    def converged(self) -> Converged:
        """Return the baseline that agrees best with the drives to fit, with all its runs, from where it begins on.

        Raises:
            NotTestableError: the drives show too little.
        """
        return self.onward(self.at(self.begin, None))

    def onward(self, first: Baseline) -> Converged:
        """Return the same from another baseline on, of which the first runs are made.

        Which way to move takes fewer runs than to judge drives by them.

        Raises:
            NotTestableError: the drives show too little.
        """
        best, number, num_moves = first, 1, 0
        while number < MOST_ROUNDS and np.max(np.abs(best.shift)) > FAR_STEPS:
            way, tried = self.moved(best)
            num_moves += tried + bool(tried)  # where they begin is run, too
            nearer = None
            for values in way[-1:] + way[:-1][:1]:  # where the surrogate leads, or else its first step
                if nearer is not None or number == MOST_ROUNDS:
                    break
                number += 1
                try:
                    latest = self.at(values, best.runner)
                except (NotTestableError, AllRunsFailedError):
                    continue  # too little is seen there, or the subject vehicle finds no way in
                nearer = latest if latest.misfit < best.misfit else None
            if nearer is None:
                break
            best = nearer
        slope_runs = (2 * len(self.begin) + 1) * self.plan.first_slope_runs
        return Converged(first, self.whole(best), number, (number - 1) * slope_runs + num_moves * self.plan.slope_runs)

    def moved(self, best: Baseline) -> tuple[list[np.ndarray], int]:
        """Return the values to which the drives to fit would move a baseline, step by step, and how many were tried.

        After each move the surrogate says what it changed; what the drives still differ by asks for the next one. A
        move that does not come nearer is not made.
        """
        null, difference, values = best.fitted.null, best.difference, best.values
        sizes = parameter_steps(self.problem.layout, values)
        least = np.maximum(self.bounds[0], least_values(values))
        way, num_tried = [], 0
        while num_tried < MOST_MOVES:
            shift = parameter_shift(difference, null)
            if np.max(np.abs(shift)) <= FAR_STEPS:
                break
            step = sizes * np.clip(shift, -LONGEST_STEPS, LONGEST_STEPS)
            further = round_values(np.clip(values + step, least, self.bounds[1]))
            change = self._change(best, further)
            num_tried += 1
            if change is None or _misfit(best.difference - change, null) >= _misfit(difference, null):
                break
            values, difference = further, best.difference - change
            way.append(values)
        return way, num_tried

    def _change(self, best: Baseline, values: np.ndarray) -> np.ndarray | None:
        """Change of the surrogate's features from a baseline's values to others, in units of noise.

        None where runs fail.
        """
        here, there = (self._surrogate_at(each, best) for each in (best.values, values))
        if not has_pairs(there, here):
            return None
        null = best.fitted.null
        return paired_difference(there, here, null.cells)[0] / null.deviation

    def _surrogate_at(self, values: np.ndarray, best: Baseline) -> DriveTallies:
        """Return the surrogate's runs at some values, counted as for a baseline; they are made once."""
        trial = Trial("moved", tuple(float(value) for value in values), self.plan.slope_runs)
        part = f"moved {trial.values!r} from {best.values.tolist()!r}"
        return self.parts.tallies(part, lambda: best.runner.run([trial], self.progress.surrogate_runs))[trial.name]

    def whole(self, first: Baseline) -> Baseline:
        """Return a baseline with all its runs.

        Raises:
            NotTestableError: the drives show too little.
        """
        self.progress.stage("null")
        runs, trials = first.in_sumo.whole_null(first.runs), first.trials
        begin = self.plan.first_slope_runs
        if begin < self.plan.slope_runs:
            self.progress.stage("atlas")
            further = self._slopes(first.values, first.runner, self.plan.slope_runs - begin, begin)
            trials = {name: joined_tallies(tallies, further[name]) for name, tallies in trials.items()}
        fitted = self._fitted(first.field, runs, trials, first.prior_steps)
        return replace(first, runs=runs, trials=trials, fitted=fitted)

    def at(self, values: np.ndarray, runner: TrialRunner | None) -> Baseline:
        """Return the baseline at some values, with the first of its runs; the runner of an earlier one serves again.

        Raises:
            NotTestableError: the drives show too little.
        """
        problem, progress = self.problem, self.progress
        background, subject = expected_drivers(problem, values)
        features = DriveFeatures(conventions_of(problem), background, subject, problem.frame_interval_s)
        progress.stage("null")
        in_sumo = SumoRuns(
            problem, features, values, self.plan, self.parts, self.first_seed, progress.sumo_runs, self.sumo_workers,
            self.measured,
        )  # fmt: skip
        runs = in_sumo.first_null()
        progress.stage("atlas")
        if runner is None:
            runner = trial_runner(problem, features, self.trial_seed, self.decision_interval_s)
        runner = replace(runner, features=features)
        trials = self._slopes(values, runner, self.plan.first_slope_runs, 0)
        departs = [drive.depart_s for drive in problem.case.drives]
        field = gather_tallies([features.of_table(table) for table in self.tables], departs)
        prior_steps = self.prior_steps(values)
        fitted = self._fitted(field, runs, trials, prior_steps)
        return Baseline(values, features, in_sumo, runs, runner, trials, field, fitted, prior_steps)

    def _slopes(
        self, values: np.ndarray, runner: TrialRunner, num_runs: int, first_run: int
    ) -> dict[str, DriveTallies]:
        trials = parameter_trials(self.problem.layout, values, num_runs, first_run)
        part = f"slopes {values.tolist()!r} from run {first_run}"
        return self.parts.tallies(part, lambda: runner.run(trials, self.progress.surrogate_runs))

    def prior_steps(self, values: np.ndarray) -> np.ndarray:
        """Return what stays open of each parameter, in steps, as a standard deviation."""
        steps = parameter_steps(self.problem.layout, values)
        known = np.isfinite(self.error) & (values == self.begin)
        open_steps = np.hypot(np.where(known, self.error, np.inf) / steps, LEAST_OPEN_STEPS)
        return np.minimum(open_steps, MOST_OPEN_STEPS)

    def _fitted(
        self, field: DriveTallies, runs: NullRuns, trials: Mapping[str, DriveTallies], prior_steps: np.ndarray
    ) -> Prepared:
        is_fit = np.asarray([drive.role == "fit" for drive in self.problem.drives])
        return prepare(self.problem, field.take(is_fit), runs, trials, prior_steps)


def _misfit(difference: np.ndarray, null: NullModel) -> float:
    return float(difference @ np.linalg.solve(null.covariance, difference)) / len(difference)
