"""A run in a worker process that may die: it is tried once more, and then its last words are kept."""

import logging
import pickle
import shutil
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

from sim_adapters.activity import Activity, doing, sumo_took
from sim_adapters.sumo.job import LOG_FILE, SumoFailedError, SumoJob, SumoRun, oddity_of

log = logging.getLogger(__name__)

TRIES = 2  # a worker that dies is tried once more, on the same seed
LOG_TAIL_CHARACTERS = 2000


class AttemptedRun:
    """A run that has been started."""

    def __init__(self, start: Callable[[], tuple[SumoJob, Future[bytes]]], seed: int) -> None:
        """Start the run.

        Args:
            start: starts it and returns what is to be done, whose folder is removed after it, and what waits for the
                packed run.
            seed: its seed, for the log.
        """
        self._start, self._seed = start, seed
        self._job: SumoJob
        self._future: Future[bytes] | None
        self._job, self._future = start()

    def result(self) -> SumoRun | str:
        """Wait for the run and return it; the last words of SUMO where it failed for good. To be called once."""
        problem = tail = ""
        for attempt in range(TRIES):
            if attempt:
                log.info("SUMO run with seed %d failed (%s); trying it again", self._seed, problem)
                self._job, self._future = self._start()
            future, self._future = self._future, None  # it would keep the run
            assert future is not None
            try:
                with doing(Activity.WAITING):
                    run = pickle.loads(future.result())  # noqa: S301 - packed by a process of our own
                if oddity := oddity_of(run, self._job):
                    raise SumoFailedError(f"a worker answered with {oddity}")
                sumo_took(run.cpu_s)
                return run
            except Exception as error:
                problem = str(error) if isinstance(error, SumoFailedError) else f"{type(error).__name__}: {error}"
                tail = _log_tail(self._job.folder)
            finally:
                shutil.rmtree(self._job.folder, ignore_errors=True)
        return f"{problem}\n{tail}".strip() or "SUMO ended without a word."


def _log_tail(folder: Path) -> str:
    try:
        return (folder / LOG_FILE).read_text(encoding="utf-8", errors="replace")[-LOG_TAIL_CHARACTERS:]
    except OSError:
        return ""
