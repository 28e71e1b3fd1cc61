"""Sweeps in the real engines, and sweeps that are killed."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.sweeps.local_engines import RoomySurrogate
from jaxcalib.sweeps.sweep import sweep
from sim_adapters.interface import RunRequest, Status
from tests.places import ROOT


@pytest.mark.long
def test_killed_at_any_moment_a_sweep_ends_as_if_nothing_had_been(small_case: Path, calm: Path, tmp_path: Path):
    """The process group is killed without warning, before and behind the first block; the same command goes on."""
    whole, out = tmp_path / "whole.parquet", tmp_path / "sweep.parquet"
    options = {"design": "lhs:16", "seeds": 4, "engine": "sumo", "seed": 7, "settings": calm}
    arguments = [str(word) for name, value in options.items() for word in (f"--{name}", value)]
    command = [sys.executable, "-m", "jaxcalib", "sweep", str(small_case), "--out", str(out), "--quiet", *arguments]
    chance = random.Random(5)
    for num_blocks in (0, 1):
        process = subprocess.Popen(
            command, env=os.environ | {"PYTHONPATH": str(ROOT)}, cwd=ROOT, start_new_session=True
        )
        while len(list(out.with_name(f"{out.name}.parts").glob("block-*.parquet"))) < num_blocks:
            assert process.poll() is None, "it ended before it could be killed"
            time.sleep(0.05)
        time.sleep(chance.uniform(0.0, 0.3) if num_blocks else chance.uniform(1.0, 4.0))
        assert process.poll() is None, "it ended before it could be killed"
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, cwd=ROOT, check=False).returncode == 0
    sweep(small_case, whole, **options)  # pyright: ignore[reportArgumentType]
    one, other = (pd.read_parquet(file).drop(columns="wall_s") for file in (out, whole))
    pd.testing.assert_frame_equal(one, other)


@pytest.mark.long
@pytest.mark.usefixtures("programs_as_users_do")
def test_a_run_of_the_surrogate_does_not_depend_on_what_else_is_run(small_problem: CalibrationProblem):
    """Dense candidates need twice the room of the rest; whoever is run beside or after them gets the same bits."""
    problem = small_problem
    base = problem.template.base_values()
    dense = base.copy()
    dense[:2] *= 1.3
    dense[problem.layout.names.index("speedFactor")] = 0.5
    requests = [RunRequest(tuple(map(float, values)), seed, 70.0) for seed in range(3) for values in (base, dense)]
    surrogate = RoomySurrogate(problem)
    alone = [surrogate.run([request])[0] for request in requests[:2]]
    together = surrogate.run(requests)
    assert [one.status for one in together[:2]] == [one.status for one in alone]
    assert all(one.status is Status.OK for one in together)
    for one, other in zip(together, alone, strict=False):
        assert (one.observed == other.observed).all()
    rooms = [surrogate.engine(place).run(requests[1:2])[0].status for place in (0, 1)]
    assert rooms == [Status.OVERFULL, Status.OK]
