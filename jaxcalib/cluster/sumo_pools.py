"""SUMO's processes at a worker of a cluster: a pool for each kind of runs, kept from task to task.

SUMO keeps some of its options from one run of a process to the next, so a process makes runs of one kind alone, as on
the machine of a command: for one command, with the same subject vehicle, sensors and end.
"""

import atexit
import multiprocessing
import os
import threading
from collections.abc import Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from distributed import get_worker

from sim_adapters.sumo.workers import LocalWorkers

_LOCK = threading.Lock()  # threads of a worker take tasks side by side


@dataclass
class Pool:
    """Processes, and how many tasks use them now."""

    workers: LocalWorkers
    num_users: int = 0


_POOLS: dict[Hashable, Pool] = {}


def num_cores() -> int:
    """Cores that this worker may use: as many as it has threads."""
    return min(len(os.sched_getaffinity(0)), get_worker().state.nthreads)


def scratch_folder() -> Path:
    """Where this worker may write; dask removes what is left there, also after a worker that was killed."""
    return Path(get_worker().local_directory)


@contextmanager
def sumo_workers_for(kind: Hashable) -> Iterator[LocalWorkers]:
    """Return processes for a kind of runs; those for another end when nobody uses them."""
    with _LOCK:
        for other in [name for name, pool in _POOLS.items() if name != kind and not pool.num_users]:
            _POOLS.pop(other).workers.close()
        if kind not in _POOLS:
            _POOLS[kind] = _new_pool()
        pool = _POOLS[kind]
        pool.num_users += 1
    try:
        yield pool.workers
    finally:
        with _LOCK:
            pool.num_users -= 1


def forget(kind: Hashable) -> None:
    """Have new processes started for a kind of runs, whose processes do not work."""
    with _LOCK:
        _POOLS.pop(kind, None)


def _new_pool() -> Pool:
    # Nannies start workers as daemons, which must not have children. SUMO's processes end with their parent by
    # themselves, which is what that rule is for.
    multiprocessing.current_process().daemon = False
    return Pool(LocalWorkers(num_cores(), scratch=scratch_folder()))


@atexit.register
def _close_all() -> None:
    for pool in _POOLS.values():
        pool.workers.close()
