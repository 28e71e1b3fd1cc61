"""Whole commands, timed from an empty cache; what they leave is made up here."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from experiments.benchmarks import commands
from experiments.benchmarks.__main__ import run
from experiments.benchmarks.commands import measure_calibrate, measure_diagnose, measure_sweep

PROFILE = {
    "wall_s": 90.0,
    "cores": 2,
    "this_thread_s": {"reading": 1.0, "compiling": 3.0, "surrogate": 30.0, "waiting for SUMO": 40.0, "report": 2.0},
    "other_threads_s": {"compiling": 9.0},
    "process_cpu_s": 70.0,
    "sumo_cpu_s": 62.0,
    "used_share": 0.73,
}


@pytest.mark.parametrize(
    ("measure", "left"),
    [
        (measure_calibrate, "run/result.json"),
        (measure_diagnose, "run/diagnosis.json"),
        (measure_sweep, "sweep.json"),
    ],
)
def test_a_command_starts_with_an_empty_cache_and_its_profile_is_told(
    measure: Any, left: str, monkeypatch: pytest.MonkeyPatch
):
    asked: list[tuple[list[str], str]] = []

    def start(line: list[str], *, env: dict[str, str], **_: Any) -> Any:
        folder = Path(env["JAXCALIB_CACHE"])
        assert not list(folder.iterdir())
        asked.append((line, env["JAXCALIB_CACHE"]))
        (folder / left).parent.mkdir(exist_ok=True)
        (folder / left).write_text(json.dumps({"profile": PROFILE}), encoding="utf-8")
        return subprocess.CompletedProcess(line, 0, "", "")

    monkeypatch.setattr(commands.subprocess, "run", start)
    told = measure(Path("corridor"))
    assert told["compiling_s"] == 12.0
    assert told["waiting_for_sumo_s"] == 40.0
    assert told["used_share"] == 0.73
    ((line, folder),) = asked
    assert "--profile" in line
    assert not Path(folder).exists()


def test_a_command_that_fails_is_told_in_its_own_words(monkeypatch: pytest.MonkeyPatch):
    failed = subprocess.CompletedProcess([], 2, "", "something else\njaxcalib: corridor: expected case.toml\n")
    monkeypatch.setattr(commands.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(RuntimeError, match=r"calibrate: jaxcalib: corridor: expected case\.toml"):
        measure_calibrate(Path("corridor"))


def test_a_benchmark_that_is_not_there_is_refused_by_name():
    with pytest.raises(SystemExit, match=r"expected some of calibrate, .* got troughput"):
        run("troughput")
