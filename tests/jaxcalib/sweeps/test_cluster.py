"""Sweeps on a dask cluster: a real scheduler and real workers, each a process of its own."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from tests.places import CORRIDOR, ROOT

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from jaxcalib.cli.app import sweep as command
from jaxcalib.cli.guarded import EXIT_RESOURCE
from jaxcalib.sweeps import cluster


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def start(*arguments: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]],
        env=environment, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.fixture
def address() -> Iterator[str]:
    port = free_port()
    scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-show")
    yield f"tcp://127.0.0.1:{port}"
    scheduler.kill()
    scheduler.wait()


@pytest.fixture
def workers(address: str, tmp_path: Path) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Return two workers: one in the plain way, below a nanny, and one without."""
    options = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path / "dask"))
    started = [start("dask_worker", address, *options), start("dask_worker", address, "--no-nanny", *options)]
    yield started
    for worker in started:
        worker.send_signal(signal.SIGTERM)
    for worker in started:
        try:
            worker.wait(20)
        except subprocess.TimeoutExpired:
            worker.kill()


def test_a_cluster_that_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(cluster, "ANSWER_S", 0.5)
    silent = f"tcp://127.0.0.1:{free_port()}"
    out = tmp_path / "sweep.parquet"
    assert command(CORRIDOR, out=out, design="lhs:3", cluster=silent, quiet=True) == EXIT_RESOURCE
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert silent in lines[0]
    assert "expected a dask scheduler that answers" in lines[0]
    assert not out.exists()


def test_a_cluster_without_workers(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(cluster, "WORKERS_S", 0.5)
    out = tmp_path / "sweep.parquet"
    assert command(CORRIDOR, out=out, design="lhs:3", cluster=address, quiet=True) == EXIT_RESOURCE
    assert "no worker within" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("engine", ["sumo", "surrogate"])
def test_a_worker_that_is_killed_costs_no_row(
    engine: str, small_case: Path, address: str, workers: list[subprocess.Popen[bytes]], calm: Path, tmp_path: Path
):
    out = tmp_path / "sweep.parquet"
    num_candidates = 16 if engine == "sumo" else 96  # 3 blocks
    options = ["--design", f"lhs:{num_candidates}", "--seeds", "2", "--settings", str(calm)]
    options += ["--engine", engine, "--cluster", address, "--quiet"]
    sweep = subprocess.Popen(
        [sys.executable, "-m", "jaxcalib", "sweep", str(small_case), "--out", str(out), *options],
        env=os.environ | {"PYTHONPATH": str(ROOT)}, cwd=ROOT,
    )  # fmt: skip
    parts = out.with_name("sweep.parquet.parts")
    while sweep.poll() is None and not list(parts.glob("block-*.parquet")):
        time.sleep(0.2)
    workers[1].kill()
    assert sweep.wait(900) == 0
    table = pd.read_parquet(out)
    assert len(table) == 2 * num_candidates
    assert len(table[["candidate", "seed"]].drop_duplicates()) == 2 * num_candidates
    assert (table["status"] == "OK").mean() > 0.5
