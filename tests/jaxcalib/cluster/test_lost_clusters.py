"""Clusters that do not answer, have no workers, or go away: one line, and nothing that looks like a failed run."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from jaxcalib.cli import app as cli
from jaxcalib.cli.guarded import EXIT_RESOURCE
from jaxcalib.cluster import connection
from jaxcalib.cluster.cluster_workers import ClusterWorkers
from jaxcalib.cluster.opening import connect, sumo_workers_at
from jaxcalib.errors import CaseError, ResourceError
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunRequest

Command = Callable[[Path, Path, str], int]

COMMANDS: dict[str, Command] = {
    "calibrate": lambda case, out, address: cli.calibrate(case, out=out, cluster=address, quiet=True),
    "diagnose": lambda case, out, address: cli.diagnose(case, out=out, cluster=address, quiet=True),
}


def requests_of(problem: CalibrationProblem, num_runs: int) -> list[RunRequest]:
    values, starts = tuple(problem.template.base_values().tolist()), problem.drive_starts("fit")
    return [RunRequest(values, 40 + run, starts[run % len(starts)].depart_s) for run in range(num_runs)]


def test_without_a_cluster_runs_stay_here():
    with sumo_workers_at(None) as workers:
        assert workers is None


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_whose_cluster_does_not_answer(
    name: str,
    small_case: Path,
    silent_address: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    """RUN is not begun, so that the same command can be given again."""
    monkeypatch.setattr(connection, "ANSWER_S", 0.5)
    assert COMMANDS[name](small_case, tmp_path / "run", silent_address) == EXIT_RESOURCE
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert f"--cluster {silent_address}: expected a dask scheduler that answers" in line
    assert not (tmp_path / "run").exists()


def test_a_cluster_without_workers(address: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(connection, "WORKERS_S", 0.5)
    with pytest.raises(ResourceError, match=f"--cluster {address}: no worker within"):
        connect(address)


@pytest.mark.long
def test_a_worker_with_another_program_is_told_to_install_the_same(
    small_problem: CalibrationProblem, cluster_address: str, monkeypatch: pytest.MonkeyPatch
):
    cluster = connect(cluster_address)
    others = ClusterWorkers(cluster)
    monkeypatch.setattr(others, "_program", "another")
    with sumo_engine(small_problem, workers=others) as sumo, pytest.raises(CaseError, match="install the same there"):
        sumo.run(requests_of(small_problem, 1))
    cluster.close()


@pytest.mark.long
def test_a_scheduler_that_goes_ends_the_work(
    small_problem: CalibrationProblem, scheduler: tuple[str, subprocess.Popen[bytes]], workers: list
):
    """Whatever the connection was doing, reading a result included."""
    address, process = scheduler
    with sumo_workers_at(address) as others, sumo_engine(small_problem, workers=others) as sumo:
        waiting = sumo.submit(requests_of(small_problem, 40))
        assert next(waiting)().status.is_ok
        process.kill()
        with pytest.raises(ResourceError, match=r"the scheduler is gone\. What was made so far is kept"):
            _ = [wait() for wait in waiting]
        with pytest.raises(ResourceError, match="the scheduler is gone"):
            sumo.submit(requests_of(small_problem, 1))
