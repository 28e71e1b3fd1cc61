"""`python -m experiments.benchmarks.on_a_cluster`: SUMO's part of a command with as many cores again as workers.

One machine plays both: half of its cores stand for the user's, and a worker on each core for a cluster that the user's
machine is part of. `validate` is measured, whose time is all SUMO's.
"""

import contextlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Set
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console

from experiments.benchmarks.throughput import CASE
from experiments.results.record import append

ADDRESS = re.compile(r"tcp://[\d.]+:\d+")
LONGEST_START_S = 60.0
app = App(name="experiments.benchmarks.on_a_cluster", help="SUMO's part of a command on a cluster.")


@app.default
def on_a_cluster(
    case: Path = CASE,
    /,
    *,
    seeds: Annotated[int, Parameter(validator=Number(gte=1, lte=1000))] = 8,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Print one line of JSON.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    seeds
        Rounds of drives of the validation.
    record
        Also add a row for this commit to experiments/results.
    """
    result = measure_on_a_cluster(case, seeds)
    Console().print_json(json.dumps(result), indent=None)
    if record:
        append("benchmarks", f"cluster-{case.name}", result, f"SUMO's part of `validate` on a cluster: {case.name}")
    return 0


def measure_on_a_cluster(case: Path, seeds: int) -> dict[str, Any]:
    """Return the time of SUMO's part on half of the cores, and with a worker on each.

    Raises:
        RuntimeError: there is one core only, a command failed, or no scheduler started.
    """
    cores = sorted(os.sched_getaffinity(0))
    own = set(cores[: len(cores) // 2])
    if not own:
        raise RuntimeError("Expected two cores or more, found one.")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run = folder / "run"
        _jaxcalib("calibrate", case, "--out", run, "--budget", 0.05)
        options = ("--seeds", seeds, "--profile")
        with bound_to(own):
            _jaxcalib("validate", case, run, "--out", folder / "local", *options)
        with cluster(cores, folder) as address, bound_to(own):
            _jaxcalib("validate", case, run, "--out", folder / "cluster", *options, "--cluster", address)
        local, far = (json.loads((folder / one / "validation.json").read_text()) for one in ("local", "cluster"))
    waited_s = [one["profile"]["this_thread_s"]["waiting for SUMO"] for one in (local, far)]
    return {
        "case": case.name,
        "local_cores": len(own),
        "workers": len(cores),
        "local_s": round(waited_s[0], 1),
        "cluster_s": round(waited_s[1], 1),
        "ratio": round(waited_s[1] / waited_s[0], 3),
        "same_verdicts": local["criteria"] == far["criteria"],
    }


def _jaxcalib(*arguments: object) -> None:
    """Run a command.

    Raises:
        RuntimeError: it failed.
    """
    line = [sys.executable, "-m", "jaxcalib", *map(str, arguments), "--quiet"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{arguments[0]}: {done.stderr.strip()}")


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
def cluster(cores: list[int], folder: Path) -> Iterator[str]:
    """Start a scheduler and a worker on each core; the address of the scheduler."""
    with contextlib.ExitStack() as stack:
        said = folder / "scheduler"
        stack.enter_context(_started(said, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"))
        address = _address_in(said)
        for core in cores:
            with bound_to({core}):
                stack.enter_context(_started(folder / f"worker-{core}", "worker", address, "--nthreads", "1"))
        yield address


@contextlib.contextmanager
def _started(said: Path, *arguments: str) -> Iterator[None]:
    with said.open("w", encoding="utf-8") as stream:
        line = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
        process = subprocess.Popen(line, stdout=stream, stderr=subprocess.STDOUT)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def _address_in(said: Path) -> str:
    """Return the address that a scheduler says.

    Raises:
        RuntimeError: it says none in time.
    """
    until = time.monotonic() + LONGEST_START_S
    while time.monotonic() < until:
        if found := ADDRESS.search(said.read_text(encoding="utf-8")):
            return found[0]
        time.sleep(0.1)
    raise RuntimeError(f"No scheduler started: {said.read_text(encoding='utf-8').strip()}")


if __name__ == "__main__":
    raise SystemExit(app())
