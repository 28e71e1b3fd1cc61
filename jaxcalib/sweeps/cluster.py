"""Blocks of a sweep on the workers of a dask.distributed cluster.

A worker that dies takes its tasks with it; the scheduler gives them to another. The rows of a block are written here,
by one process, when its task is done: whatever workers do, no row is lost or there twice.
"""

import io
import queue
import time
import zipfile
from collections.abc import Iterable, Iterator
from typing import Any, cast

from distributed import Client, Future, KilledWorker

from jaxcalib.calibration.confirmation.scenario_check import refuse_failed, scenario_requests
from jaxcalib.errors import CaseError, ResourceError, quote
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import checked_disk
from jaxcalib.runs.run_folder import files_elsewhere
from jaxcalib.sweeps import cluster_worker
from jaxcalib.sweeps.local_engines import Done
from jaxcalib.sweeps.plan import Engine, SweepPlan
from sim_adapters.interface import RunRequest

ANSWER_S = 15.0  # a scheduler that takes longer does not answer
WORKERS_S = 60.0  # the longest that a cluster may be without any worker
TASKS_PER_WORKER = 2  # one at work, one waiting
SCENARIO_CHECK = -1  # number of the block that is no part of the sweep: runs of the scenario as it is
KEPT = "Rows made so far are kept; give the same command again to go on."


class ClusterEngine:
    """Sends blocks to a cluster."""

    def __init__(self, address: str, problem: CalibrationProblem, engine: Engine, identity: dict[str, str]) -> None:
        """Connect.

        Args:
            address: of the scheduler, for example tcp://10.0.0.1:8786.
            problem: the problem; its case is sent along.
            engine: name of the simulator.
            identity: what rows depend on; workers check that they have the same program.

        Raises:
            ResourceError: nobody answers there, or no worker comes.
        """
        self._address = address
        self._problem = problem
        self._engine = engine
        self._identity = identity
        self._case = archive_of(problem)
        try:
            self._client = Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ResourceError(f"--cluster {address}: expected a dask scheduler that answers; {reason}.") from None
        self._wait_for_workers()

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[Done]:
        """Make all runs of blocks and yield each block when it is done.

        Raises:
            ResourceError: the cluster is gone, or a block has killed one worker after another.
            CaseError: a worker has another version of the program.
            AllRunsFailedError: SUMO cannot run the scenario as it is.
        """
        waiting = iter(blocks)
        case = self._client.submit(cluster_worker.keep, self._case, pure=False)
        block_of: dict[object, int] = {}
        done: queue.SimpleQueue[Future] = queue.SimpleQueue()

        def send(block: int, requests: list[RunRequest]) -> None:
            task = self._client.submit(
                cluster_worker.run_block, case, self._identity, self._engine, requests, pure=False
            )
            block_of[task.key] = block
            task.add_done_callback(done.put)

        def send_more() -> None:
            most = TASKS_PER_WORKER * max(1, self._num_workers())
            while len(block_of) < most and (block := next(waiting, None)) is not None:
                send(block, plan.requests(block))

        if self._engine == "sumo":
            send(SCENARIO_CHECK, scenario_requests(self._problem, plan.first_seed))
        send_more()
        while block_of:
            task = self._next(done)
            block = block_of.pop(task.key)
            made = checked_disk(self._result(task, block))
            task.release()
            send_more()
            if block == SCENARIO_CHECK:
                refuse_failed(made)
            else:
                yield block, made

    def close(self) -> None:
        """Leave the cluster; tasks that wait there are dropped."""
        self._client.close(timeout=5)

    def _next(self, done: "queue.SimpleQueue[Future]") -> Future:
        """Wait for a task; watch that there is somebody to do it."""
        alone_since = None
        while True:
            try:
                return done.get(timeout=1.0)
            except queue.Empty:
                pass
            if self._client.status != "running":
                raise ResourceError(f"--cluster {self._address}: the scheduler is gone. {KEPT}")
            if self._num_workers():
                alone_since = None
                continue
            alone_since = alone_since or time.monotonic()
            if time.monotonic() - alone_since > WORKERS_S:
                raise ResourceError(f"--cluster {self._address}: no worker for {WORKERS_S:.0f} s. {KEPT}")

    def _result(self, task: Future, block: int) -> Any:
        if task.status == "finished":
            return task.result(timeout=ANSWER_S)
        if task.status in ("cancelled", "lost"):
            raise ResourceError(f"--cluster {self._address}: the scheduler is gone or has dropped a task. {KEPT}")
        error = cast(BaseException | None, task.exception(timeout=ANSWER_S))
        if isinstance(error, CaseError | ResourceError):
            raise error
        if isinstance(error, KilledWorker):
            raise ResourceError(
                f"--cluster {self._address}: block {block} has killed one worker after another; memory? {KEPT}"
            )
        if isinstance(error, ImportError):
            raise ResourceError(
                f"--cluster {self._address}: a worker cannot import jaxcalib ({error}); install the same version there."
            )
        raise error if error is not None else RuntimeError(f"a task of block {block} is {task.status}")

    def _wait_for_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError:
            self._client.close(timeout=5)
            raise ResourceError(f"--cluster {self._address}: no worker within {WORKERS_S:.0f} s.") from None

    def _num_workers(self) -> int:
        return len(self._client.scheduler_info(n_workers=-1)["workers"])


def archive_of(problem: CalibrationProblem) -> bytes:
    """Return a case's folder as one piece, for workers that may not see this machine's disks.

    Raises:
        CaseError: files of the case lie elsewhere.
    """
    if elsewhere := files_elsewhere(problem.case):
        expected = f"expected a case whose files all lie in its folder; {quote(elsewhere[0].name)} does not."
        raise CaseError("command line", "--cluster", f"{expected} Copy it there.")
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", strict_timestamps=False) as archive:
        for file in sorted(problem.case.folder.rglob("*")):
            if file.is_file():
                archive.write(file, str(file.relative_to(problem.case.folder)))
    return stream.getvalue()
