"""A connection to a dask scheduler: tasks go out, and what becomes of them is a result or one line.

A worker that dies takes its tasks with it; the scheduler gives them to another. What becomes of results is up to one
process, this one: whatever workers do, nothing is lost or there twice.
"""

import logging
import queue
import time
import warnings
from collections.abc import Callable
from typing import Any, cast

from distributed import Client, Future, KilledWorker
from distributed.comm.core import CommClosedError

from jaxcalib.cluster import at_worker
from jaxcalib.errors import ResourceError

ANSWER_S = 15.0  # a scheduler that takes longer does not answer
WORKERS_S = 60.0  # the longest that a cluster may be without any worker
LOOK_S = 1.0  # between two looks at whether it is there still
CLOSE_S = 5.0  # the longest that it takes to leave it
MADE_OR_BEING_MADE = ("finished", "lost", "pending")  # lost with its worker, and to be made again
KEPT = "What was made so far is kept; give the same command again, with --resume if that asks for it."

Ended = queue.SimpleQueue[Future]  # takes tasks that have ended


class Cluster:
    """A cluster with at least one worker."""

    def __init__(self, address: str) -> None:
        """Connect.

        Args:
            address: of the scheduler, for example tcp://10.0.0.1:8786.

        Raises:
            ResourceError: nobody answers there, or no worker comes.
        """
        self._address = address
        self._log = logging.getLogger("distributed.client")
        self._log_level = self._log.level
        self._log.setLevel(logging.CRITICAL)  # what it would say of workers and scheduler is said here
        try:
            self._client = Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            self._log.setLevel(self._log_level)
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise self.error(f"expected a dask scheduler that answers; {reason}.") from None
        try:
            self._client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError:
            self.close()
            raise self.error(f"no worker within {WORKERS_S:.0f} s.") from None

    @property
    def num_workers(self) -> int:
        """Workers that are there."""
        return len(self._workers())

    @property
    def num_threads(self) -> int:
        """Threads of all workers that are there."""
        return sum(worker["nthreads"] for worker in self._workers().values())

    def keep(self, content: bytes) -> Future:
        """Send something once that many tasks take; it stays as long as the future that is returned."""
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")  # once, to be had again if a worker dies
            return self._client.submit(at_worker.keep, content, pure=False)

    def submit(self, ended: Ended, function: Callable[..., Any], *arguments: Any) -> Future:
        """Have a worker call a function; arguments may be futures.

        Args:
            ended: takes the task when it has ended.
            function: what to call, at the top of a module.
            arguments: what to call it with.

        Raises:
            ResourceError: the scheduler is gone.
        """
        self.refuse_gone()
        try:
            task = self._client.submit(function, *arguments, pure=False)
        except CommClosedError:
            raise self._gone() from None
        task.add_done_callback(ended.put)
        return task

    def next_of(self, ended: Ended) -> Future:
        """Wait for a task to end; watch that there is somebody to do it.

        Raises:
            ResourceError: the scheduler is gone, or there is no worker for a while.
        """
        watch = _Watch(self)
        while True:
            try:
                return ended.get(timeout=LOOK_S)
            except queue.Empty:
                watch.look()

    def result_of(self, task: Future, name: str) -> Any:
        """Return what a task that has ended returned.

        A result stays with the worker that made it until it is asked for here; where that worker is gone, another makes
        it again.

        Args:
            task: the task.
            name: what it is, for messages.

        Raises:
            ResourceError: the cluster is gone, the task has killed one worker after another, or a worker said so.
            CaseError: a worker has another version of the program.
        """
        watch = _Watch(self)
        while task.status in MADE_OR_BEING_MADE:
            try:
                return task.result(timeout=ANSWER_S)
            except (TimeoutError, CommClosedError):
                watch.look()
                time.sleep(LOOK_S)
            except Exception:
                if task.status in MADE_OR_BEING_MADE:
                    raise
        raise self._failure_of(task, name)

    def refuse_gone(self) -> None:
        """Refuse to go on where the scheduler is gone.

        Raises:
            ResourceError: it is.
        """
        if self._client.status != "running":
            raise self._gone()

    def error(self, message: str) -> ResourceError:
        """Return the error that says what is wrong with this cluster."""
        return ResourceError(f"--cluster {self._address}: {message}")

    def close(self) -> None:
        """Leave the cluster; tasks that wait there are dropped."""
        self._client.close(timeout=CLOSE_S)
        self._log.setLevel(self._log_level)

    def _workers(self) -> dict[str, dict[str, Any]]:
        try:
            return self._client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, TimeoutError):
            raise self._gone() from None

    def _failure_of(self, task: Future, name: str) -> BaseException:
        if task.status == "cancelled":
            self.refuse_gone()
            return self.error(f"the scheduler has dropped {name}. {KEPT}")
        error = cast(BaseException | None, task.exception(timeout=ANSWER_S))
        if isinstance(error, KilledWorker):
            return self.error(f"{name} has killed one worker after another; memory? {KEPT}")
        if isinstance(error, ImportError) or "Can't get attribute" in str(error):
            return self.error(f"a worker cannot import jaxcalib ({error}); install the same version there.")
        return error or RuntimeError(f"the task of {name} is {task.status}")

    def _gone(self) -> ResourceError:
        return self.error(f"the scheduler is gone. {KEPT}")


class _Watch:
    """Whether a cluster can still do its work, asked from time to time by whoever waits for it."""

    def __init__(self, cluster: Cluster) -> None:
        self._cluster = cluster
        self._alone_since: float | None = None

    def look(self) -> None:
        """Refuse to wait on where the scheduler is gone, or no worker was there for a while.

        Raises:
            ResourceError: so it is.
        """
        self._cluster.refuse_gone()
        if self._cluster.num_workers:
            self._alone_since = None
            return
        self._alone_since = self._alone_since or time.monotonic()
        if time.monotonic() - self._alone_since > WORKERS_S:
            raise self._cluster.error(f"no worker for {WORKERS_S:.0f} s. {KEPT}")
