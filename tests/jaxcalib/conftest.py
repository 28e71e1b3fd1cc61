"""A cluster of this machine: a real scheduler and real workers, each a process of its own."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.places import ROOT

Process = subprocess.Popen[bytes]


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


def start(*arguments: str) -> Process:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        env=environment, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


@contextlib.contextmanager
def a_scheduler() -> Iterator[tuple[str, Process]]:
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    port = free_port()
    process = start("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
    try:
        yield f"tcp://127.0.0.1:{port}", process
    finally:
        process.kill()
        process.wait()


@contextlib.contextmanager
def two_workers(address: str, folder: Path) -> Iterator[list[Process]]:
    options = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(folder))
    started = [start("dask_worker", address, *options), start("dask_worker", address, "--no-nanny", *options)]
    try:
        yield started
    finally:
        for worker in started:
            worker.send_signal(signal.SIGTERM)
        for worker in started:
            try:
                worker.wait(20)
            except subprocess.TimeoutExpired:
                worker.kill()


@pytest.fixture
def silent_address() -> str:
    """An address at which nobody answers."""
    return f"tcp://127.0.0.1:{free_port()}"


@pytest.fixture
def scheduler() -> Iterator[tuple[str, Process]]:
    """A scheduler: its address and its process."""
    with a_scheduler() as started:
        yield started


@pytest.fixture
def address(scheduler: tuple[str, Process]) -> str:
    """The address of a scheduler."""
    return scheduler[0]


@pytest.fixture
def workers(address: str, tmp_path: Path) -> Iterator[list[Process]]:
    """Two workers of a scheduler to be killed: one in the plain way, below a nanny, and one without."""
    with two_workers(address, tmp_path / "dask") as started:
        yield started


@pytest.fixture(scope="package")
def cluster_address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a cluster with two such workers, which is to be left as it is."""
    with a_scheduler() as (address, _), two_workers(address, tmp_path_factory.mktemp("dask")):
        yield address
