"""Sweeps on a dask cluster."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from tests.places import CORRIDOR, ROOT

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from jaxcalib.cli.app import sweep as command
from jaxcalib.cli.guarded import EXIT_RESOURCE
from jaxcalib.cluster import connection


def test_a_cluster_that_does_not_answer(
    silent_address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(connection, "ANSWER_S", 0.5)
    out = tmp_path / "sweep.parquet"
    assert command(CORRIDOR, out=out, design="lhs:3", cluster=silent_address, quiet=True) == EXIT_RESOURCE
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert silent_address in lines[0]
    assert "expected a dask scheduler that answers" in lines[0]
    assert not out.exists()


def test_a_cluster_without_workers(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(connection, "WORKERS_S", 0.5)
    out = tmp_path / "sweep.parquet"
    assert command(CORRIDOR, out=out, design="lhs:3", cluster=address, quiet=True) == EXIT_RESOURCE
    assert "no worker within" in capsys.readouterr().err


REASON = "twenty seconds with each engine; at commits SUMO's runs on a cluster lose a worker in test_runs_on_a_cluster"


@pytest.mark.long
@pytest.mark.parametrize("engine", [pytest.param("sumo", marks=pytest.mark.nightly(REASON)), "surrogate"])
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
