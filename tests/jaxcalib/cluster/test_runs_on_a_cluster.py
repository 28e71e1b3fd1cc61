"""SUMO's runs on a cluster are those of this machine to the bit, whatever becomes of its workers."""

import os
import re
import shutil
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

from distributed import Client

from jaxcalib.cluster.opening import sumo_workers_at
from jaxcalib.cluster.sumo_pools import sumo_workers_for
from jaxcalib.diagnosis.features.conventions import conventions_of, expected_drivers
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.runs.null_runs import NullRuns, run_null
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.counts import FieldCounts
from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.sumo.workers import SumoWorkers
from surrogate.effects.base import EffectSetting
from tests.jaxcalib.conftest import Process

pytestmark = pytest.mark.long

LONGEST_S = 120.0
FOLDERS = re.compile(r"/\S*/")


def mixed_requests(problem: CalibrationProblem) -> list[RunRequest]:
    """Runs of every kind: drives that share one, an effect, one that SUMO refuses, and plain ones."""
    values = tuple(problem.template.base_values().tolist())
    first_s, *_, last_s = (start.depart_s for start in problem.drive_starts("fit"))
    refused = list(values)
    refused[problem.layout.names.index("decel")] = -4.5
    both_s = (first_s, last_s + 40.0)
    return [
        RunRequest(values, 31, first_s),
        *(RunRequest(values, 32, depart_s, also_depart_s=both_s) for depart_s in both_s),
        RunRequest(tuple(refused), 33, last_s),
        RunRequest(values, 34, last_s, {"reaction_delay": EffectSetting(0.8)}),
        *(RunRequest(values, seed, first_s) for seed in range(35, 47)),
    ]


def content(outcome: RunOutcome) -> tuple[object, ...]:
    """All that two outcomes must have in common."""
    numbers = (outcome.observed, outcome.num_arrived, outcome.num_inserted)
    bits = tuple(None if each is None else np.asarray(each).tobytes() for each in numbers)
    steps = (outcome.num_vehicle_steps, outcome.num_collisions, outcome.num_teleports, outcome.subject_left)
    return (outcome.request, outcome.status, *bits, *steps, FOLDERS.sub("", outcome.log_tail))


def assert_same(made: Sequence[RunOutcome], expected: Sequence[RunOutcome]) -> None:
    assert [content(outcome) for outcome in made] == [content(outcome) for outcome in expected]


def kill_who_holds_most(address: str, num_results: int) -> None:
    """Wait until results lie at a cluster's workers, and kill the one that holds most of them without warning."""
    with Client(address, set_as_default=False) as client:
        deadline = time.monotonic() + LONGEST_S
        while True:
            held = {worker: len(keys) for worker, keys in client.has_what().items()}
            if sum(held.values()) >= num_results:
                break
            assert time.monotonic() < deadline
            time.sleep(0.1)
        (process,) = client.run(os.getpid, workers=[max(held, key=lambda worker: held[worker])]).values()
        os.kill(process, signal.SIGKILL)


def test_a_worker_that_is_killed_changes_nothing(
    small_problem: CalibrationProblem, address: str, workers: list[Process]
):
    """While it is at work, and holds results that nobody has seen."""
    requests = mixed_requests(small_problem)
    with sumo_engine(small_problem, 2) as sumo:
        expected = sumo.run(requests)
    assert [outcome.status for outcome in expected].count(Status.FAILED) == 1
    with sumo_workers_at(address) as others, sumo_engine(small_problem, workers=others) as sumo:
        waiting = sumo.submit(requests)
        kill_who_holds_most(address, len(requests) // 2)
        made = [wait() for wait in waiting]
    assert_same(made, expected)


def test_a_case_with_files_elsewhere_and_a_planner(small_case: Path, tmp_path: Path, cluster_address: str):
    """Workers need nothing of the case; what drives the subject vehicle goes with the run."""
    case = Path(shutil.copytree(small_case, tmp_path / "case"))
    (net_file,) = (case / "scenario").glob("*.net.xml")
    shutil.move(net_file, tmp_path / "elsewhere.net.xml")
    config = case / "scenario" / "scenario.sumocfg"
    config.write_text(config.read_text().replace(net_file.name, "../../elsewhere.net.xml"))
    told = (case / "case.toml").read_text()
    (case / "case.toml").write_text(told.replace('vehicle = "ego"', 'vehicle = "ego"\nmodel = "planner"'))
    problem = read_problem(case)
    request = RunRequest(tuple(problem.template.base_values().tolist()), 3, 70.0)
    outcomes: list[RunOutcome] = []
    with sumo_workers_at(cluster_address) as others:
        for place in (None, others):
            with sumo_engine(problem, 1, workers=place) as sumo:
                outcomes += sumo.run([request])
    assert outcomes[0].status is Status.OK
    assert_same(outcomes[1:], outcomes[:1])


def test_vehicles_are_counted_alike(small_problem: CalibrationProblem, cluster_address: str):
    counted = FieldCounts((("m2", 60.0, 170.0), ("m3", 0.0, 90.0)), np.zeros((1, 2)))
    request = RunRequest(tuple(small_problem.template.base_values().tolist()), 3, 70.0)
    outcomes: list[RunOutcome] = []
    with sumo_workers_at(cluster_address) as others:
        for place in (None, others):
            with sumo_engine(small_problem, 1, counter=counted, workers=place) as sumo:
                outcomes += sumo.run([request])
    assert outcomes[0].observed.min() > 10.0
    assert_same(outcomes[1:], outcomes[:1])


def test_a_diagnosis_counts_the_same_drives(small_problem: CalibrationProblem, cluster_address: str):
    """With an effect, and with altered versions of the first drives."""
    problem = small_problem
    values = problem.template.base_values()
    features = DriveFeatures(conventions_of(problem), *expected_drivers(problem, values), problem.frame_interval_s)

    def counted(place: SumoWorkers | None) -> NullRuns:
        alterations, effects = [("gap_sensor_bias", 0.08)], {"reaction_delay": EffectSetting(0.8)}
        return run_null(
            problem, features, values, 4, 3, alterations, 70, lambda number: None, effects, first_run=2, workers=place
        )

    with sumo_workers_at(cluster_address) as others:
        here, there = counted(None), counted(others)
    assert len(there.altered["gap_sensor_bias", 0.08]) == 3
    for one, other in (
        (here.plain, there.plain),
        *((here.altered[name], there.altered[name]) for name in here.altered),
    ):
        assert one.cells == other.cells
        np.testing.assert_array_equal(one.above, other.above)
        np.testing.assert_array_equal(one.below, other.below)
        np.testing.assert_array_equal(one.depart_s, other.depart_s)


def processes_of_kinds() -> tuple[bool, bool, list[int]]:
    """Return whether a worker keeps processes for a kind, and others for others, and how many these are."""
    with sumo_workers_for("one") as one, sumo_workers_for("other") as other:
        numbers = [one.num_processes, other.num_processes]
    with sumo_workers_for("one") as again:
        return again is one, one is other, numbers


def test_a_worker_has_as_many_processes_as_threads_for_each_kind_of_runs(cluster_address: str):
    """SUMO keeps some options from run to run: a process for one case would not see the subject vehicle of another."""
    with Client(cluster_address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        names = list(client.scheduler_info(n_workers=-1)["workers"])
        asked = [client.submit(lambda: processes_of_kinds(), workers=[name], pure=False) for name in names]
        assert client.gather(asked) == [(True, False, [1, 1])] * 2
