"""What a worker of a cluster does for jaxcalib: it checks that it is the same program, and has SUMO make runs.

A dask worker process has one pool of SUMO's processes, as many as it has threads, whatever it is asked to run.
"""

import atexit
import hashlib
import multiprocessing
import os
import tempfile
import threading
import zlib
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from distributed import get_worker

from jaxcalib.cluster.archive import unpack
from jaxcalib.errors import CaseError, ResourceError
from jaxcalib.runs.disk import full_disk, is_of_full_disk, writing_to
from jaxcalib.runs.run_folder import identify_program
from sim_adapters.errors import WorkersEndedError
from sim_adapters.sumo.job import SumoJob, SumoRun
from sim_adapters.sumo.workers import LocalWorkers

_LOCK = threading.Lock()  # threads of a worker take tasks side by side


def keep(content: bytes) -> bytes:
    """Return what is given: a task, so that the scheduler can make it again when a worker that holds it dies."""
    return content


def make_run(program: str, network: bytes, files: bytes, job: SumoJob) -> SumoRun | str:
    """Make a run, and return it or the last words of SUMO where it failed for good.

    Args:
        program: digest of the program that asks.
        network: the network file, compressed.
        files: the run's other files, as `archive.packed` packs them.
        job: what there is to do with them; its paths are those of another machine.

    Raises:
        CaseError: this worker has another version of the program.
        ResourceError: this worker's disk is full, or SUMO's processes do not start.
    """
    check_program(program)
    disk = Path(f"worker {os.uname().nodename}: {scratch_folder()}")
    with writing_to(disk):
        net_file = _network_file(network, job.net_file.name)
        try:
            run = sumo_workers().begin(partial(_write, files, job, net_file), job.seed).result()
        except WorkersEndedError:
            _sumo_workers.cache_clear()
            raise ResourceError(f"worker {os.uname().nodename}: SUMO's processes end before they can work.") from None
    if isinstance(run, str) and is_of_full_disk(run):
        raise full_disk(disk, "no room for SUMO's output")
    return run


def check_program(program: str) -> None:
    """Check that this worker has the same program as whoever asks.

    Args:
        program: digest of theirs.

    Raises:
        CaseError: it has another.
    """
    if _own_program() != program:
        expected = "expected the version of program and libraries that the command has; install the same there."
        raise CaseError("cluster", f"worker {os.uname().nodename}", expected)


def num_cores() -> int:
    """Cores that this worker may use: as many as it has threads."""
    return min(len(os.sched_getaffinity(0)), get_worker().state.nthreads)


def scratch_folder() -> Path:
    """Where this worker may write; dask removes what is left there, also after a worker that was killed."""
    return Path(get_worker().local_directory)


def sumo_workers() -> LocalWorkers:
    """Return SUMO's processes of this worker, which stay from task to task."""
    with _LOCK:
        return _sumo_workers()


@cache
def _sumo_workers() -> LocalWorkers:
    # Nannies start workers as daemons, which must not have children. SUMO's processes end with their parent by
    # themselves, which is what that rule is for.
    multiprocessing.current_process().daemon = False
    workers = LocalWorkers(num_cores(), scratch=scratch_folder())
    atexit.register(workers.close)
    return workers


@cache
def _own_program() -> str:
    return identify_program()


def _network_file(content: bytes, name: str) -> Path:
    """Return a file of this worker with a network, written when it is asked for first."""
    folder = scratch_folder() / f"network-{hashlib.sha256(content).hexdigest()}"
    with _LOCK:
        if not folder.is_dir():
            being_made = Path(tempfile.mkdtemp(dir=scratch_folder()))
            (being_made / name).write_bytes(zlib.decompress(content))
            being_made.rename(folder)
    return folder / name


def _write(files: bytes, job: SumoJob, net_file: Path, folder: Path) -> SumoJob:
    """Write a run's files into a folder, and return the job with their paths."""
    unpack(files, folder)
    return replace(job, config=folder / job.config.name, net_file=net_file, folder=folder)
