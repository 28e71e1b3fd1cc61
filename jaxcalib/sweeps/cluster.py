"""Blocks of a sweep on the workers of a cluster, which have the whole case and send rows' numbers back.

A sweep's runs are many: what they come to is counted where they are made. Runs of other commands go out one by one.
"""

import queue
from collections.abc import Iterable, Iterator

from jaxcalib.calibration.confirmation.scenario_check import refuse_failed, scenario_requests
from jaxcalib.cluster.archive import packed
from jaxcalib.cluster.connection import Cluster, Ended
from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import checked_disk
from jaxcalib.runs.run_folder import files_elsewhere
from jaxcalib.sweeps import cluster_worker
from jaxcalib.sweeps.local_engines import Done
from jaxcalib.sweeps.plan import Engine, SweepPlan
from sim_adapters.interface import RunRequest

TASKS_PER_WORKER = 2  # one at work, one waiting
SCENARIO_CHECK = -1  # number of the block that is no part of the sweep: runs of the scenario as it is


class ClusterEngine:
    """Sends blocks to a cluster."""

    def __init__(self, cluster: Cluster, problem: CalibrationProblem, engine: Engine, identity: dict[str, str]) -> None:
        """Keep the connection, which is closed with this.

        Args:
            cluster: where blocks go.
            problem: the problem; its case is sent along.
            engine: name of the simulator.
            identity: what rows depend on; workers check that they have the same program.
        """
        self._cluster = cluster
        self._problem = problem
        self._engine = engine
        self._identity = identity

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[Done]:
        """Make all runs of blocks and yield each block when it is done.

        Raises:
            ResourceError: the cluster is gone, or a block has killed one worker after another.
            CaseError: a worker has another version of the program, or files of the case lie elsewhere.
            AllRunsFailedError: SUMO cannot run the scenario as it is.
        """
        waiting = iter(blocks)
        case = self._cluster.keep(archive_of(self._problem))
        block_of: dict[object, int] = {}
        ended: Ended = queue.SimpleQueue()

        def send(block: int, requests: list[RunRequest]) -> None:
            what = (case, self._identity, self._engine, requests)
            block_of[self._cluster.submit(ended, cluster_worker.run_block, *what).key] = block

        def send_more() -> None:
            most = TASKS_PER_WORKER * max(1, self._cluster.num_workers)
            while len(block_of) < most and (block := next(waiting, None)) is not None:
                send(block, plan.requests(block))

        if self._engine == "sumo":
            send(SCENARIO_CHECK, scenario_requests(self._problem, plan.first_seed))
        send_more()
        while block_of:
            task = self._cluster.next_of(ended)
            block = block_of.pop(task.key)
            made = checked_disk(self._cluster.result_of(task, f"block {block}"))
            task.release()
            send_more()
            if block == SCENARIO_CHECK:
                refuse_failed(made)
            else:
                yield block, made

    def close(self) -> None:
        """Leave the cluster; tasks that wait there are dropped."""
        self._cluster.close()


def archive_of(problem: CalibrationProblem) -> bytes:
    """Return a case's folder as one piece.

    Raises:
        CaseError: files of the case lie elsewhere.
    """
    if elsewhere := files_elsewhere(problem.case):
        expected = f"expected a case whose files all lie in its folder; {quote(elsewhere[0].name)} does not."
        raise CaseError("command line", "--cluster", f"{expected} Copy it there.")
    return packed(problem.case.folder)
