"""Runs of the surrogate that show what an effect, or another parameter value, does to the features."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, TallyBook, gather_tallies
from jaxcalib.diagnosis.features.frame_recorder import FrameRecorder
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest
from sim_adapters.jax.simulator import JaxSimulator
from surrogate.effects.base import EffectSetting

BASELINE = "baseline"  # name of the trial without any effect, at the calibrated values
RUNS_PER_CALL = 128  # what is recorded of them fits into memory
FEWEST_PAIRS = 4


@dataclass(frozen=True)
class Trial:
    """One setting to run."""

    name: str
    values: tuple[float, ...]  # parameter vector
    num_runs: int  # number of runs; the same seeds for all trials
    effects: Mapping[str, EffectSetting] = field(default_factory=dict)  # effects by name
    first_run: int = 0  # number of the first run, where others of the same trial were made before


@dataclass(frozen=True)
class TrialRunner:
    """Runs trials with common random numbers: run k of each has the same seed and drive."""

    engine: JaxSimulator  # the surrogate, which records frames
    recorder: FrameRecorder  # its observer
    features: DriveFeatures  # what is counted
    starts: Sequence[DriveStart]  # taken in turn
    first_seed: int  # seed of the first run
    interval_s: float  # time between two frames

    def run(self, trials: Sequence[Trial], on_runs: Callable[[int], None]) -> dict[str, DriveTallies]:
        """Return the tallies of each trial's runs; a run that failed has none, so that runs stay paired."""
        requests = [
            RunRequest(trial.values, self.first_seed + run, own.depart_s, trial.effects, drive=own.drive)
            for trial in trials
            for run in range(trial.first_run, trial.first_run + trial.num_runs)
            for own in [self.starts[run % len(self.starts)]]
        ]
        with ThreadPoolExecutor(max_workers=1) as counting:  # one batch is counted while the next one runs
            counted = []
            for begin in range(0, len(requests), RUNS_PER_CALL):
                part = requests[begin : begin + RUNS_PER_CALL]
                if len(counted) > 1:
                    counted[-2].result()  # what is recorded of more than two does not fit into memory
                counted.append(counting.submit(self._books, self.engine.run(part)))
                on_runs(len(part))
            books = [book for future in counted for book in future.result()]
        tallies, begin = {}, 0
        for trial in trials:
            chosen = slice(begin, begin + trial.num_runs)
            departs = [request.depart_s for request in requests[chosen]]
            tallies[trial.name] = gather_tallies(books[chosen], departs)
            begin += trial.num_runs
        return tallies

    def _books(self, outcomes: Sequence[RunOutcome]) -> list[TallyBook]:
        """Return what is counted of each run; of one that failed, nothing."""
        return [
            self.features.of_table(self.recorder.table(outcome.observed, self.interval_s))
            if outcome.status.is_ok
            else TallyBook()
            for outcome in outcomes
        ]


def pairs_of(one: DriveTallies, other: DriveTallies) -> np.ndarray:
    """Return the numbers of the runs that succeeded in both of two trials."""
    num_runs = min(len(one), len(other))
    return np.flatnonzero((one.below[:num_runs].sum(axis=1) > 0) & (other.below[:num_runs].sum(axis=1) > 0))


def has_pairs(one: DriveTallies, other: DriveTallies) -> bool:
    """Whether enough runs succeeded in both of two trials to compare them."""
    return len(pairs_of(one, other)) >= FEWEST_PAIRS


def paired_difference(
    one: DriveTallies, other: DriveTallies, cells: Sequence
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Difference of the features between two trials, its standard error, and per-run influences of the first.

    Runs with the same seed are pairs; a pair of which one run failed is left out. Cells that one of the trials lacks
    get 0 and an infinite error.
    """
    runs, size = pairs_of(one, other), len(cells)
    difference, error = np.zeros(size), np.full(size, np.inf)
    influence = np.zeros((len(runs), size))
    if not has_pairs(one, other):
        return difference, error, influence
    at_one = {cell: column for column, cell in enumerate(one.cells)}
    at_other = {cell: column for column, cell in enumerate(other.cells)}
    shared = [column for column, cell in enumerate(cells) if cell in at_one and cell in at_other]
    a = DriveTallies(tuple(cells[k] for k in shared), *_columns(one, [at_one[cells[k]] for k in shared], runs))
    b = DriveTallies(tuple(cells[k] for k in shared), *_columns(other, [at_other[cells[k]] for k in shared], runs))
    moved = a.influence() - b.influence()
    shift = a.values() - b.values()
    spread = moved.std(axis=0, ddof=1) / np.sqrt(len(runs))
    known = np.isfinite(shift) & np.isfinite(spread)
    places = np.asarray(shared, int)
    difference[places] = np.where(known, shift, 0.0)
    error[places] = np.where(known, spread, np.inf)
    influence[:, places] = np.nan_to_num(a.influence())
    return difference, error, influence


def _columns(tallies: DriveTallies, places: list[int], runs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    above, below = (
        tallies.above[np.ix_(runs, np.asarray(places, int))],
        tallies.below[np.ix_(runs, np.asarray(places, int))],
    )
    return above, below, tallies.depart_s[runs]
