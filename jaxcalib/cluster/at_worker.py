"""What a worker of a cluster does for jaxcalib: it checks that it is the same program, and has SUMO make runs."""

import hashlib
import os
import tempfile
import threading
import zlib
from collections.abc import Hashable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

from jaxcalib.cluster.archive import unpack
from jaxcalib.cluster.sumo_pools import forget, scratch_folder, sumo_workers_for
from jaxcalib.errors import CaseError, ResourceError
from jaxcalib.runs.disk import full_disk, is_of_full_disk, writing_to
from jaxcalib.runs.run_folder import identify_program
from sim_adapters.errors import WorkersEndedError
from sim_adapters.sumo.job import SumoJob, SumoRun

_NETWORKS = threading.Lock()  # threads of a worker take tasks side by side


def keep(content: bytes) -> bytes:
    """Return what is given: a task, so that the scheduler can make it again when a worker that holds it dies."""
    return content


def make_run(program: str, command: str, network: bytes, files: bytes, job: SumoJob) -> SumoRun | str:
    """Make a run, and return it or the last words of SUMO where it failed for good.

    Args:
        program: digest of the program that asks.
        command: name of the command that asks, unlike that of any other.
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
        kind = (command, *_kind_of(job))
        try:
            with sumo_workers_for(kind) as workers:
                run = workers.begin(partial(_write, files, job, net_file), job.seed).result()
        except WorkersEndedError:
            forget(kind)
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


@cache
def _own_program() -> str:
    return identify_program()


def _network_file(content: bytes, name: str) -> Path:
    """Return a file of this worker with a network, written when it is asked for first."""
    folder = scratch_folder() / f"network-{hashlib.sha256(name.encode() + content).hexdigest()}"
    with _NETWORKS:
        if not folder.is_dir():
            being_made = Path(tempfile.mkdtemp(dir=scratch_folder()))
            (being_made / name).write_bytes(zlib.decompress(content))
            being_made.rename(folder)
    return folder / name


def _kind_of(job: SumoJob) -> tuple[Hashable, ...]:
    """Return what runs of a command have in common that a process may make one after another."""
    return (job.subject_vehicles[0], job.end_s, job.radius_m, job.frame_interval_s, job.counted_edges)


def _write(files: bytes, job: SumoJob, net_file: Path, folder: Path) -> SumoJob:
    """Write a run's files into a folder, and return the job with their paths."""
    unpack(files, folder)
    return replace(job, config=folder / job.config.name, net_file=net_file, folder=folder)
