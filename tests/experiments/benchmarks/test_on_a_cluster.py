"""SUMO's part of a command on half of the cores, and on a cluster with a worker on each of them."""

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from experiments.benchmarks import on_a_cluster
from experiments.benchmarks.on_a_cluster import bound_to, measure_on_a_cluster

CORES = sorted(os.sched_getaffinity(0))


def test_cores_are_given_back_whatever_happens() -> None:
    def fail() -> None:
        with bound_to({CORES[0]}):
            assert os.sched_getaffinity(0) == {CORES[0]}
            raise ValueError("of its own")

    with pytest.raises(ValueError, match="of its own"):
        fail()
    assert sorted(os.sched_getaffinity(0)) == CORES


def test_the_ratio_is_that_of_the_times_in_which_the_command_waits_for_sumo(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, set[int]]] = []
    cores = {3, 5, 6}  # as if this process had them
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(cores))

    def bind(_: int, to: set[int]) -> None:
        cores.clear()
        cores.update(to)

    monkeypatch.setattr(os, "sched_setaffinity", bind)

    def run_command(name: str, *arguments: str, cache: str) -> float:
        assert Path(cache).is_dir()
        asked.append((name, os.sched_getaffinity(0)))
        if name == "validate":
            out = Path(arguments[arguments.index("--out") + 1])
            waited_s = 30.0 if "--cluster" in arguments else 50.0
            out.mkdir()
            said = {"profile": {"this_thread_s": {"waiting for SUMO": waited_s}}, "criteria": [{"passes": True}]}
            (out / "validation.json").write_text(json.dumps(said))
        return 60.0

    @contextlib.contextmanager
    def workers(number: int) -> Iterator[str]:
        assert number == 3
        yield "tcp://127.0.0.1:8786"

    monkeypatch.setattr(on_a_cluster, "run_command", run_command)
    monkeypatch.setattr(on_a_cluster, "workers", workers)
    found = measure_on_a_cluster(Path("corridor"))
    assert found["ratio"] == pytest.approx(0.6)
    assert found["same_criteria"]
    assert asked == [("calibrate", {3, 5, 6}), ("validate", {3}), ("validate", {3})]
