"""Whole commands on a cluster leave what they leave on this machine, but for times."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from jaxcalib.cli.app import validate
from jaxcalib.problem.problem import CalibrationProblem
from tests.jaxcalib.conftest import Process
from tests.places import ROOT

TIMES = ("wall_s", "timing")
COUNTS = "edge,begin_s,end_s,vehicles\nm2,60,170,60\n"
REASON = "a calibration in SUMO alone and a diagnosis take minutes each, twice; every commit makes parts of them"
WHOLE = {"calibrate": ("result.json", "--engine", "sumo"), "diagnose": ("diagnosis.json",)}

pytestmark = pytest.mark.long


def without_times(file: Path) -> dict[str, Any]:
    return {name: value for name, value in json.loads(file.read_text()).items() if name not in TIMES}


def test_a_validation(small_case: Path, small_problem: CalibrationProblem, cluster_address: str, tmp_path: Path):
    values, layout = small_problem.template.base_values().tolist(), small_problem.layout
    demand = dict(zip(layout.input_ids, values, strict=False))
    behaviour = dict(zip(layout.attributes, values[len(demand) :], strict=True))
    (tmp_path / "result.json").write_text(
        json.dumps({"format": 1, "parameters": {"demand": demand, "behaviour": {"car": behaviour}}})
    )
    (tmp_path / "counts.csv").write_text(COUNTS)
    results = []
    for name, cluster in (("here", None), ("there", cluster_address)):
        out = tmp_path / name
        options = {"seeds": 3, "counts": tmp_path / "counts.csv", "cluster": cluster, "quiet": True}
        assert validate(small_case, tmp_path, out=out, **options) == 0
        results.append(without_times(out / "validation.json"))
    assert results[0]["runs"] == 3 * 2 + 3
    assert results[1] == results[0]


@pytest.mark.nightly(REASON)
@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_command_one_of_whose_workers_is_killed(
    name: str, small_case: Path, address: str, workers: list[Process], tmp_path: Path
):
    file, *more = WHOLE[name]
    here, there = tmp_path / "here", tmp_path / "there"

    def start(out: Path, *options: str) -> Process:
        command = [sys.executable, "-m", "jaxcalib", name, str(small_case), "--out", str(out), "--budget", "0.05"]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        return subprocess.Popen([*command, "--quiet", *more, *options], env=environment, cwd=ROOT)

    assert start(here).wait(1800) == 0
    process = start(there, "--cluster", address)
    while process.poll() is None and len(list(there.glob("journal/part-*.npz"))) < 3:
        time.sleep(0.1)
    workers[1].kill()
    assert process.wait(1800) == 0
    assert without_times(there / file) == without_times(here / file)
