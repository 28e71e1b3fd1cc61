"""Candidates in, pooled tallies out: the only place where a search's candidates meet a simulator."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from jaxcalib.runs.drives_in_turn import in_rounds, interleaved
from sim_adapters.interface import DriveStart, RunOutcome, RunRequest, Simulator
from sim_adapters.shared_runs import drives_worth, starts_apart

MOST_FAILED_SHARE = 0.1  # of a candidate's runs; with more it has failed, for what it lost need not be like the rest

OnRuns = Callable[[int], None]


@dataclass(frozen=True)
class Evaluations:
    """Runs of several candidates, the same drives and seeds for each."""

    # tallies of each run, [candidate, run, tally]; nan where a run failed
    tally: Float[np.ndarray, "candidate run tally"]
    is_ok: Bool[np.ndarray, " candidate"]  # whether a candidate may win
    outcomes: tuple[tuple[RunOutcome, ...], ...]  # all runs in order

    @property
    def pooled(self) -> Float[np.ndarray, "candidate tally"]:
        """Tallies per run, pooled over each candidate's successful runs; nan for a candidate that failed."""
        with np.errstate(invalid="ignore"):
            count = np.isfinite(self.tally[:, :, :1]).sum(axis=1)
            mean = np.nansum(self.tally, axis=1) / np.maximum(count, 1)
        return np.where(self.is_ok[:, None] & (count > 0), mean, np.nan)


class Evaluator:
    """Runs candidates in one simulator with common random numbers."""

    def __init__(
        self,
        simulator: Simulator,
        starts: Sequence[DriveStart],
        first_seed: int,
        on_runs: OnRuns | None = None,
        shares_runs: bool = False,
        num_tallies: int = 0,
    ) -> None:
        """Keep what all evaluations share.

        Args:
            simulator: engine.
            starts: of the drives that are matched; runs take them in turn.
            first_seed: seed of the first run; each run of a candidate has a seed of its own.
            on_runs: told how many runs have been made.
            shares_runs: whether subject vehicles that depart far enough apart drive in one run, with one seed; then
                what counts as a run here is a drive.
            num_tallies: length of a tally; 0 where it is not known: then a first evaluation without any success is an
                error.
        """
        self._simulator = simulator
        self._starts = interleaved(starts)
        self._dealt = starts_apart(self._starts) if shares_runs else [(one,) for one in self._starts]
        self._run_of = _numbers_of_runs(self._starts, self._dealt)
        self._first_seed = first_seed
        self._on_runs = on_runs
        self._num_tallies = num_tallies  # 0: not known before the first run that succeeds
        self.num_runs = 0

    def rounds_of(self, num_runs: int) -> int:
        """Return a number of runs near the wanted one in which each drive occurs equally often."""
        return in_rounds(self._starts, num_runs)

    def worth(self, num_runs: int) -> float:
        """Return how many independent runs tell what so many of these do."""
        return drives_worth(num_runs, num_runs * len(self._dealt) / len(self._starts))

    def requests(self, values: Float[np.ndarray, " parameter"], num_runs: int, offset: int = 0) -> list[RunRequest]:
        """Return the runs of one candidate."""
        requests = []
        for number in range(num_runs):
            begun, place = divmod(number, len(self._starts))
            own, run = self._starts[place], self._run_of[place]
            requests.append(
                RunRequest(
                    values=tuple(float(value) for value in values),
                    seed=self._first_seed + offset + begun * len(self._dealt) + run,
                    depart_s=own.depart_s,
                    also_depart_s=tuple(other.depart_s for other in self._dealt[run] if other != own),
                    drive=own.drive,
                )
            )
        return requests

    def evaluate(self, values: Float[np.ndarray, "candidate parameter"], num_runs: int, offset: int = 0) -> Evaluations:
        """Run candidates.

        Args:
            values: parameter values, one candidate per row.
            num_runs: runs per candidate.
            offset: of the seeds, so that other seeds are used than elsewhere.
        """
        requests = [request for row in values for request in self.requests(row, num_runs, offset)]
        outcomes = self._simulator.run(requests)
        self.num_runs += len(requests)
        if self._on_runs is not None:
            self._on_runs(len(requests))
        evaluations = gather([outcomes[i : i + num_runs] for i in range(0, len(outcomes), num_runs)], self._num_tallies)
        self._num_tallies = evaluations.tally.shape[2]
        return evaluations


def gather(outcomes: list[list[RunOutcome]], num_tallies: int = 0) -> Evaluations:
    """Return the runs of several candidates as arrays.

    Args:
        outcomes: runs of each candidate.
        num_tallies: length of a tally; 0 where it is not known yet.

    Raises:
        AllRunsFailedError: no run succeeded, here or before.
    """
    sizes = [len(run.observed) for runs in outcomes for run in runs if run.status.is_ok] or [num_tallies]
    if not sizes[0]:
        reasons = sorted({run.status.value for runs in outcomes for run in runs})
        tail = next((run.log_tail for runs in outcomes for run in runs if run.log_tail), "")
        raise AllRunsFailedError(f"all {sum(map(len, outcomes))} runs failed: {'; '.join(reasons)}", tail)
    nothing = np.full(sizes[0], np.nan)
    tally = np.asarray([[run.observed if run.status.is_ok else nothing for run in runs] for runs in outcomes], float)
    failed = np.asarray([[not run.status.is_ok for run in runs] for runs in outcomes]).mean(axis=1)
    return Evaluations(tally, failed <= MOST_FAILED_SHARE, tuple(tuple(runs) for runs in outcomes))


class AllRunsFailedError(RuntimeError):
    """No run succeeded; the command ends with exit code 3.

    Attributes:
        log_tail: the simulator's last words.
    """

    def __init__(self, message: str, log_tail: str) -> None:
        """Keep message and log."""
        super().__init__(message)
        self.log_tail = log_tail


def _numbers_of_runs(starts: list[DriveStart], dealt: list[tuple[DriveStart, ...]]) -> list[int]:
    """Return in which of the runs each departure is; equal departures are in different ones."""
    free = [list(one) for one in dealt]
    numbers = []
    for start in starts:
        number = next(number for number, left in enumerate(free) if start in left)
        free[number].remove(start)
        numbers.append(number)
    return numbers
