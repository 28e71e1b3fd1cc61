"""Who makes SUMO's runs: processes of this machine, one run in each at a time, or others that do the same elsewhere."""

import multiprocessing
import os
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Protocol

from pebble import ProcessPool

from sim_adapters.errors import WorkersEndedError
from sim_adapters.sumo.attempted_run import AttemptedRun
from sim_adapters.sumo.job import SumoJob, SumoRun
from sim_adapters.sumo.worker import begin_worker, packed_run, run_job

RUNS_PER_PROCESS = 200
LONGEST_RUN_S = 1200.0

WriteRun = Callable[[Path], SumoJob]  # writes the files of a run into a folder and returns what there is to do


class BegunRun(Protocol):
    """A run that has been begun."""

    def result(self) -> SumoRun | str:
        """Wait for the run and return it; the last words of SUMO where it failed for good. To be called once."""
        ...


class SumoWorkers(Protocol):
    """Whoever makes runs."""

    @property
    def num_processes(self) -> int:
        """Runs that are made side by side."""
        ...

    def begin(self, write: WriteRun, seed: int) -> BegunRun:
        """Begin a run in the background.

        Args:
            write: writes its files; it may be asked to more than once.
            seed: of the run, to name it by in messages.
        """
        ...


class LocalWorkers:
    """Processes of this machine, in a pool that outlives those that die and kills those that hang."""

    def __init__(
        self,
        num_processes: int | None = None,
        longest_run_s: float = LONGEST_RUN_S,
        scratch: Path | None = None,
    ) -> None:
        """Prepare the pool; processes start with the first run.

        Args:
            num_processes: how many; one for each core unless given.
            longest_run_s: a run that takes longer is killed.
            scratch: where files of runs lie while they are made; the system's folder unless given.
        """
        self._num_processes = num_processes or len(os.sched_getaffinity(0))
        self._longest_run_s = longest_run_s
        self._scratch = Path(tempfile.mkdtemp(prefix="jaxcalib-", dir=scratch))
        self._pool = ProcessPool(
            max_workers=self._num_processes,
            max_tasks=RUNS_PER_PROCESS,
            context=multiprocessing.get_context("spawn"),
            initializer=begin_worker,
        )

    @property
    def num_processes(self) -> int:
        """Runs that are made side by side."""
        return self._num_processes

    def begin(self, write: WriteRun, seed: int) -> AttemptedRun:
        """Begin a run in the background; one whose process dies is tried once more.

        Raises:
            WorkersEndedError: processes die at their start.
        """
        return AttemptedRun(partial(self.start, write), seed)

    def start(self, write: WriteRun) -> tuple[SumoJob, Future[bytes]]:
        """Start a run once; return what is to be done, whose folder the caller removes, and what brings it packed.

        Raises:
            WorkersEndedError: processes die at their start.
        """
        folder = Path(tempfile.mkdtemp(prefix="run-", dir=self._scratch))
        job = write(folder)
        try:
            with _interrupts_held():
                return job, self._pool.schedule(packed_run, args=(run_job, job), timeout=self._longest_run_s)
        except RuntimeError as error:  # of a pool whose processes have all died at their start
            raise WorkersEndedError from error

    def close(self) -> None:
        """End the processes and remove their files."""
        self._pool.stop()
        self._pool.join()
        shutil.rmtree(self._scratch, ignore_errors=True)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold a terminal's Ctrl-C back from processes that start meanwhile, and from threads that start others later.

    It is the command's, which ends them; they would say at which line they were. It comes when this is over.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
