"""Blocks of a sweep in the engines of this machine."""

import collections
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol

from jaxcalib.calibration.confirmation.scenario_check import start_scenario_check
from jaxcalib.problem.engines import SPARE_CAPACITY, sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import checked_disk, writing_to_scratch
from jaxcalib.sweeps.plan import Engine, SweepPlan
from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.jax.simulator import JaxSimulator

CALL_S = 20.0  # about so long does a call last: the longer, the fuller are its batches, and the more is lost by a kill
FIRST_BATCHES, MOST_BATCHES = 2, 64  # of a call
ROOM_FACTORS = (1.0, 2.0, 4.0)

Done = tuple[int, list[RunOutcome]]


class BlockEngine(Protocol):
    """Makes the runs of blocks."""

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[Done]:
        """Make all runs of blocks and yield each block when it is done, in any order."""
        ...

    def close(self) -> None:
        """End what was started."""
        ...


class RoomySurrogate:
    """The surrogate with room for any candidate, and results that depend on nothing but the run.

    A sweep reaches corners in which a road holds far more vehicles than in the field. Runs that need more room than
    most are made again with twice and four times as much, whatever other runs need.
    """

    def __init__(
        self,
        problem: CalibrationProblem,
        spare_capacity: float = SPARE_CAPACITY,
        runs_per_device: int | None = None,
    ) -> None:
        """Prepare runs; nothing is compiled before the first.

        Args:
            problem: the problem.
            spare_capacity: room that most runs get, as a multiple of the vehicles in the field.
            runs_per_device: size of a device's part of a batch of those; from the room unless given.
        """
        self._problem = problem
        self._spare_capacity = spare_capacity
        self._runs_per_device = runs_per_device
        self._engines: list[JaxSimulator] = []

    def engine(self, place: int) -> JaxSimulator:
        """Return the engine with a certain room."""
        while len(self._engines) <= place:
            room = self._spare_capacity * ROOM_FACTORS[len(self._engines)]
            runs = None if self._engines else self._runs_per_device
            self._engines.append(surrogate_engine(self._problem, room, most_overfull_share=1.0, runs_per_device=runs))
        return self._engines[place]

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order; failures are outcomes, not exceptions."""
        outcomes = self.engine(0).run(requests)
        for place in range(1, len(ROOM_FACTORS)):
            again = [index for index, outcome in enumerate(outcomes) if outcome.status is Status.OVERFULL]
            if not again:
                break
            made = self.engine(place).run([requests[index] for index in again])
            for index, outcome in zip(again, made, strict=True):
                outcomes[index] = outcome
        return outcomes

    @property
    def batch(self) -> int:
        """Runs that are made together."""
        return self.engine(0).batch

    @property
    def compile_s(self) -> float:
        """Time that compilation took."""
        return sum(engine.compile_s for engine in self._engines)


class LocalSurrogate:
    """The surrogate, sharded over the devices that JAX sees."""

    def __init__(self, problem: CalibrationProblem) -> None:
        """Prepare runs."""
        self._simulator = RoomySurrogate(problem)

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[Done]:
        """Make all runs of blocks, several blocks at once."""
        waiting = collections.deque(blocks)
        num_batches = FIRST_BATCHES
        while waiting:
            together = max(1, num_batches * self._simulator.batch // plan.block_rows)
            chosen = [waiting.popleft() for _ in range(min(together, len(waiting)))]
            requests = [plan.requests(block) for block in chosen]
            began, compile_s = time.perf_counter(), self._simulator.compile_s
            made = iter(self._simulator.run([request for block in requests for request in block]))
            elapsed_s = time.perf_counter() - began - (self._simulator.compile_s - compile_s)
            for block, of_block in zip(chosen, requests, strict=True):
                yield block, [next(made) for _ in of_block]
            rows_per_s = sum(map(len, requests)) / max(elapsed_s, 1e-3)
            num_batches = min(max(FIRST_BATCHES, int(CALL_S * rows_per_s / self._simulator.batch)), MOST_BATCHES)

    def close(self) -> None:
        """Nothing was started."""


class LocalSumo:
    """SUMO in processes of this machine."""

    def __init__(self, problem: CalibrationProblem, num_processes: int | None = None) -> None:
        """Start the pool."""
        self._problem = problem
        self._simulator = sumo_engine(problem, num_processes)

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[Done]:
        """Make all runs of blocks; the next ones wait in the pool, so that no process idles.

        Raises:
            AllRunsFailedError: SUMO cannot run the scenario as it is; said before any block is done.
        """
        check = start_scenario_check(self._problem, plan.first_seed, self._start)
        ahead = 1 + -(-2 * self._simulator.num_processes // plan.block_rows)
        pending: collections.deque = collections.deque()
        waiting = iter(blocks)
        while True:
            while len(pending) < ahead and (block := next(waiting, None)) is not None:
                pending.append((block, self._start(plan.requests(block))))
            if not pending:
                return
            check()
            block, wait = pending.popleft()
            yield block, wait()

    def _start(self, requests: Sequence[RunRequest]) -> Callable[[], list[RunOutcome]]:
        with writing_to_scratch():
            runs = self._simulator.submit(requests)

        def wait() -> list[RunOutcome]:
            with writing_to_scratch():  # a run that failed is made again
                return checked_disk([run() for run in runs])

        return wait

    def close(self) -> None:
        """End the processes and remove their files."""
        self._simulator.close()


def local_engine(problem: CalibrationProblem, engine: Engine) -> BlockEngine:
    """Return an engine of this machine."""
    return LocalSurrogate(problem) if engine == "surrogate" else LocalSumo(problem)
