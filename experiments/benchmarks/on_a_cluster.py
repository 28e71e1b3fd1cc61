"""SUMO's part of a command on a cluster with twice as many cores.

One machine plays both: half of its cores stand for the user's, and a worker on each core for a cluster that the user's
machine is part of. `validate` is measured, whose time is all SUMO's.
"""

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator, Set
from pathlib import Path
from typing import Any

import dask.config as dask_config
from distributed import LocalCluster

from experiments.benchmarks.commands import run_command

SEEDS = 8  # rounds of drives of the validation


def measure_on_a_cluster(case: Path) -> dict[str, Any]:
    """Return the time of SUMO's part on half of the cores, and with a worker on each.

    Raises:
        RuntimeError: there is one core only, or a command failed.
    """
    cores = os.sched_getaffinity(0)
    own = set(sorted(cores)[: len(cores) // 2])
    if not own:
        raise RuntimeError("Expected two cores or more, found one.")
    with tempfile.TemporaryDirectory() as folder:
        run, local, far = (Path(folder) / name for name in ("run", "local", "far"))
        run_command("calibrate", str(case), "--out", str(run), "--budget", "0.05", cache=folder)
        validate = ("validate", str(case), str(run), "--seeds", str(SEEDS), "--out")
        with bound_to(own):
            run_command(*validate, str(local), cache=folder)
        with workers(len(cores)) as address, bound_to(own):
            run_command(*validate, str(far), "--cluster", address, cache=folder)
        said = [json.loads((out / "validation.json").read_text(encoding="utf-8")) for out in (local, far)]
    local_s, cluster_s = (one["profile"]["this_thread_s"]["waiting for SUMO"] for one in said)
    return {
        "local_cores": len(own),
        "workers": len(cores),
        "local_s": round(local_s, 1),
        "cluster_s": round(cluster_s, 1),
        "ratio": round(cluster_s / local_s, 3),
        "same_criteria": said[0]["criteria"] == said[1]["criteria"],
    }


@contextlib.contextmanager
def bound_to(cores: Set[int]) -> Iterator[None]:
    """Let what is started meanwhile use some of the cores only."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextlib.contextmanager
def workers(number: int) -> Iterator[str]:
    """Start workers of one thread each; the address of their scheduler."""
    with dask_config.set({"distributed.worker.daemon": False}):  # a worker starts processes of its own: SUMO's
        cluster: Any = LocalCluster(n_workers=number, threads_per_worker=1, dashboard_address=":0")
        with cluster:
            yield cluster.scheduler_address
