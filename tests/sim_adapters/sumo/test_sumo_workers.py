"""A worker of the SUMO pool may die, hang or fail: the run is tried once more and then reported, nothing is raised."""

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.scenario.scenario_writer import WrittenScenario, write_scenario
from sim_adapters.sumo import simulator as sumo_simulator
from sim_adapters.sumo import workers as sumo_workers
from sim_adapters.sumo.job import SumoJob, SumoRun
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator
from tests.sim_adapters.sumo import broken_workers

Run = Callable[..., list[RunOutcome]]

VALUES = (1500.0, 300.0, 1.2, 2.5, 2.6, 1.0, 0.1, 1.0, 1.0)


def requests_of(seeds: Sequence[int]) -> list[RunRequest]:
    return [RunRequest(VALUES, seed, 20.0) for seed in seeds]


def mean_speed(frames: Any) -> np.ndarray:
    return np.mean(frames.subject_speed_mps, keepdims=True)


@pytest.fixture
def make_runs(corridor: Scenario, layout: ParameterLayout, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that makes runs with another worker function, and sees that nothing is left behind."""

    def make(
        worker: Callable[[SumoJob], SumoRun] | None,
        seeds: Sequence[int],
        scenario: Scenario = corridor,
        end_s: float = 40.0,
        **options: Any,
    ) -> list[RunOutcome]:
        if worker is not None:
            monkeypatch.setattr(sumo_workers, "run_job", worker)
        # a run that the pool forgets as its worker dies ends by its longest time (noxdafox/pebble, issue 153)
        options.setdefault("longest_run_s", 60.0)
        before = sorted(path for path in tmp_path.iterdir() if path.is_dir())
        simulator = SumoSimulator(
            scenario, layout, mean_speed, SensorRange(150.0, 150.0), "ego", 0.5, end_s, 1, scratch=tmp_path, **options
        )
        with simulator:
            outcomes = simulator.run(requests_of(seeds))
        assert sorted(path for path in tmp_path.iterdir() if path.is_dir()) == before
        return outcomes

    return make


@pytest.fixture
def tries(tmp_path: Path) -> Callable[[int], int]:
    """Return a function that says how often a seed was tried."""
    return lambda seed: len((tmp_path / f"tries-{seed}").read_text())


def test_a_run_whose_subject_vehicle_is_teleported_says_so(make_runs: Run, own_corridor: Path):
    """Vehicles that have broken down side by side hold it until SUMO takes it off the road."""
    demand = own_corridor / "scenario/demand.rou.xml"
    stops = "".join(
        f'<vehicle id="broken{lane}" type="car" route="r_ego" depart="1" departLane="{lane}"><stop lane="m0_{lane}" '
        'endPos="300" duration="500"/></vehicle>'
        for lane in range((own_corridor / "scenario/net.net.xml").read_text().count('<lane id="m0_'))
    )
    demand.write_text(demand.read_text().replace("<flow", stops + "<flow", 1))
    config = own_corridor / "scenario/scenario.sumocfg"
    config.write_text(
        config.read_text().replace("</configuration>", '<x><time-to-teleport value="15"/></x></configuration>')
    )
    scenario = read_scenario(config, "ego", 300.0)
    (outcome,) = make_runs(None, [3], scenario, 200.0)
    assert outcome.status is Status.FAILED
    assert "SUMO teleported subject vehicle 'ego'" in outcome.log_tail


def test_a_worker_that_dies_is_retried_once_and_then_reported(make_runs: Run, tries: Callable[[int], int]):
    (outcome,) = make_runs(broken_workers.die, [3])
    assert outcome.status is Status.FAILED
    assert not outcome.status.is_ok
    assert outcome.observed is None
    assert outcome.request == requests_of([3])[0]
    assert outcome.num_arrived.tolist() == outcome.num_inserted.tolist() == [0, 0]
    assert outcome.log_tail
    assert tries(3) == 2


def test_a_worker_that_dies_once_does_no_harm(make_runs: Run, tries: Callable[[int], int]):
    (outcome,) = make_runs(broken_workers.die_once, [11])
    assert outcome.status is Status.OK
    np.testing.assert_array_equal(outcome.observed, [11.0])
    assert (outcome.num_arrived.tolist(), outcome.num_inserted.tolist()) == ([6, 3], [5, 2])
    assert outcome.backlog_share == pytest.approx(2 / 9)
    assert tries(11) == 2


@pytest.mark.parametrize(
    "work", [broken_workers.shorten_first, broken_workers.leave_road_first, broken_workers.go_back_in_time_first]
)
def test_an_answer_that_is_spoilt_is_asked_for_again(
    make_runs: Run, tries: Callable[[int], int], work: Callable[[SumoJob], SumoRun]
):
    (outcome,) = make_runs(work, [11])
    (right,) = make_runs(broken_workers.short_run, [11])
    assert outcome.status is Status.OK
    np.testing.assert_array_equal(outcome.observed, right.observed)
    assert tries(11) == 2


def test_who_never_answers_with_a_run_has_failed(make_runs: Run, tries: Callable[[int], int]):
    (outcome,) = make_runs(broken_workers.answer_nothing, [3])
    assert outcome.status is Status.FAILED
    assert "a NoneType instead of a run" in outcome.log_tail
    assert tries(3) == 2


def test_an_answer_that_cannot_be_sent_has_failed_in_one_line(
    make_runs: Run, tries: Callable[[int], int], capfd: pytest.CaptureFixture[str]
):
    (outcome,) = make_runs(broken_workers.answer_the_unsendable, [3])
    assert outcome.status is Status.FAILED
    assert outcome.log_tail == "a worker answered with a function that cannot be sent"
    assert tries(3) == 2
    assert capfd.readouterr().err == ""


def test_a_worker_that_dies_takes_no_other_run_along(make_runs: Run):
    seeds = [3, 2, 5, 4, 6]
    outcomes = make_runs(broken_workers.die_if_odd, seeds)
    assert [outcome.request.seed for outcome in outcomes] == seeds
    expected = [Status.FAILED if seed % 2 else Status.OK for seed in seeds]
    assert [outcome.status for outcome in outcomes] == expected
    assert [outcome.observed.item() for outcome in outcomes if outcome.status.is_ok] == [2.0, 4.0, 6.0]


def test_a_run_that_hangs_is_ended_and_reported(make_runs: Run, tries: Callable[[int], int]):
    (outcome,) = make_runs(broken_workers.hang, [1], longest_run_s=1.5)
    assert outcome.status is Status.FAILED
    assert "TimeoutError" in outcome.log_tail
    assert tries(1) == 2


def test_the_simulator_s_last_words_are_kept(make_runs: Run):
    (outcome,) = make_runs(broken_workers.complain, [1])
    assert outcome.status is Status.FAILED
    assert "no such lane" in outcome.log_tail
    assert "the last words" in outcome.log_tail


def test_the_last_words_of_a_worker_that_dies_are_kept(make_runs: Run, capfd: pytest.CaptureFixture[str]):
    (outcome,) = make_runs(broken_workers.die_with_last_words, [1])
    assert outcome.status is Status.FAILED
    assert "terminate called without an active exception" in outcome.log_tail
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("spoilt", "words"),
    [
        (
            ('id="car"', 'id="car" color="notacolor"'),
            "Error: Attribute 'color' in definition of vType 'car' Invalid color",
        ),
        (('id="ego"', 'id="ego" departPosLat="nowhere"'), "Invalid departPosLat definition for vehicle 'ego'"),
    ],
    ids=["at the start", "when a vehicle comes"],
)
def test_sumo_s_own_words_are_kept_and_not_said_twice(
    spoilt: tuple[str, str], words: str, own_corridor: Path, make_runs: Run, capfd: pytest.CaptureFixture[str]
):
    """SUMO's exceptions cannot be sent from a worker; what they say can."""
    demand = own_corridor / "scenario/demand.rou.xml"
    demand.write_text(demand.read_text().replace(*spoilt, 1))
    scenario = read_scenario(own_corridor / "scenario/scenario.sumocfg", "ego", 720.0)
    (outcome,) = make_runs(None, [1], scenario=scenario)
    assert outcome.status is Status.FAILED
    assert outcome.log_tail.startswith(words)
    assert "pickle" not in outcome.log_tail
    assert capfd.readouterr().err == ""


def test_a_drive_without_frames_lacks_the_subject_vehicle(make_runs: Run):
    (outcome,) = make_runs(broken_workers.see_nothing, [1])
    assert outcome.status is Status.SUBJECT_MISSING
    assert outcome.observed is None
    assert outcome.num_inserted.tolist() == [5, 2]


def test_numbers_that_are_not_finite_are_a_status(make_runs: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(mean_speed.__globals__, "mean_speed", lambda frames: np.full(1, np.nan))
    (outcome,) = make_runs(broken_workers.short_run, [1])
    assert (outcome.status, outcome.observed) == (Status.NONFINITE, None)


@pytest.fixture
def lost_configuration(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Take each configuration away as soon as it is written."""
    lost: list[Path] = []

    def write_and_lose(*arguments: Any, **options: Any) -> WrittenScenario:
        written = write_scenario(*arguments, **options)
        written.config.unlink()
        lost.append(written.config)
        return written

    monkeypatch.setattr(sumo_simulator, "write_scenario", write_and_lose)
    return lost


def test_sumo_without_its_configuration_is_a_failed_run(make_runs: Run, lost_configuration: list[Path]):
    (outcome,) = make_runs(None, [1])
    assert outcome.status is Status.FAILED
    assert outcome.log_tail
    assert len(lost_configuration) == 2  # written again for the second try


@pytest.mark.long
def test_a_script_without_a_guard_is_told_what_to_do(corridor_folder: Path, tmp_path: Path):
    """Workers import the script that starts them; without a guard they would start workers in turn."""
    script = tmp_path / "script.py"
    script.write_text(
        f"""
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import read_problem
from sim_adapters.interface import RunRequest

problem = read_problem({str(corridor_folder)!r})
with sumo_engine(problem, 1) as sumo:
    sumo.run([RunRequest(tuple(problem.template.base_values().tolist()), 1, 300.0)])
"""
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert "WorkersEndedError: SUMO's workers end before they can work." in done.stderr


def test_frames_between_steps_are_refused(corridor: Scenario, layout: ParameterLayout, tmp_path: Path):
    sensor = SensorRange(150.0, 150.0)
    with pytest.raises(ValueError, match=r"frame_interval_s: expected a whole number of steps of 0\.1 s, got 0\.25"):
        SumoSimulator(corridor, layout, mean_speed, sensor, "ego", 0.25, 40.0, 1, scratch=tmp_path)
