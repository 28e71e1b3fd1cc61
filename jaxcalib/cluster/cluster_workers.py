"""A cluster's workers as those who make SUMO's runs.

A run is a task of its own: its files are written here and sent along, and what SUMO says of it comes back whole, to be
folded here. So it does not matter to a result where a run was made, and workers need nothing of the case.
"""

import queue
import tempfile
import uuid
import zlib
from pathlib import Path

from distributed import Future

from jaxcalib.cluster import at_worker
from jaxcalib.cluster.archive import packed
from jaxcalib.cluster.connection import Cluster, Ended
from jaxcalib.runs.run_folder import identify_program
from sim_adapters.activity import Activity, doing
from sim_adapters.sumo.job import SumoRun
from sim_adapters.sumo.workers import WriteRun


class ClusterRun:
    """A run that was sent to a cluster."""

    def __init__(self, cluster: Cluster, ended: Ended, task: Future, name: str) -> None:
        """Keep the task, which goes to `ended` when it has ended."""
        self._cluster, self._ended, self._name = cluster, ended, name
        self._task: Future | None = task  # the scheduler drops a task that nobody asks for

    def result(self) -> SumoRun | str:
        """Wait for the run and return it; the last words of SUMO where it failed for good. To be called once.

        Raises:
            ResourceError, CaseError: as `Cluster.next_of` and `Cluster.result_of`; they say nothing of the run.
        """
        with doing(Activity.WAITING):
            task = self._cluster.next_of(self._ended)
        self._task = None
        return self._cluster.result_of(task, self._name)


class ClusterWorkers:
    """Sends SUMO's runs to a cluster."""

    def __init__(self, cluster: Cluster) -> None:
        """Keep the connection."""
        self._cluster = cluster
        self._program = identify_program()
        self._command = uuid.uuid4().hex
        self._networks: dict[Path, Future] = {}

    @property
    def num_processes(self) -> int:
        """Runs that are made side by side, with the workers that are there now."""
        return max(1, self._cluster.num_threads)

    def begin(self, write: WriteRun, seed: int) -> ClusterRun:
        """Begin a run in the background.

        Args:
            write: writes its files.
            seed: of the run, to name it by in messages.

        Raises:
            ResourceError: the scheduler is gone.
        """
        with tempfile.TemporaryDirectory(prefix="jaxcalib-") as name:
            job = write(Path(name))
            files = packed(Path(name))
        network = self._network(job.net_file)
        ended: Ended = queue.SimpleQueue()
        task = self._cluster.submit(ended, at_worker.make_run, self._program, self._command, network, files, job)
        return ClusterRun(self._cluster, ended, task, f"the run with seed {seed}")

    def _network(self, file: Path) -> Future:
        """Send a network once for all runs on it."""
        if file not in self._networks:
            self._networks[file] = self._cluster.keep(zlib.compress(file.read_bytes()))
        return self._networks[file]
