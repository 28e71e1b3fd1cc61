"""What the runs before a search decide: which simulator makes it, and what drives see."""

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.final_errors import FinalRuns
from jaxcalib.calibration.first_look import FirstLook
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.stopwatch import Stopwatch

PLAN: Any = SimpleNamespace(confirmation_runs=4, noise_runs=8)
FRAMES, LOGGED = 200.0, 7.0


class Simulated:
    """An evaluator: runs with the scenario's drivers show one speed in each section, with the logs' another."""

    def __init__(
        self, problem: CalibrationProblem, in_scenario_mps: np.ndarray | None, logged_mps: np.ndarray | None
    ) -> None:
        self.problem, self.speeds_mps, self.num_runs = problem, (in_scenario_mps, logged_mps), 0

    def rounds_of(self, num_runs: int) -> int:
        return num_runs

    def tallies(self, speed_mps: np.ndarray, num_runs: int) -> np.ndarray:
        tally = np.zeros((num_runs, len(self.problem.tally_names)))
        for section, mps in enumerate(speed_mps):
            frames = FRAMES * (1.0 + 0.01 * np.arange(num_runs))
            tally[:, self.problem.tally_index[f"section_frames[{section}]"]] = frames
            tally[:, self.problem.tally_index[f"section_speed[{section}]"]] = frames * mps
        return tally

    def evaluate(self, values: np.ndarray, num_runs: int, offset: int) -> Any:
        speed_mps = self.speeds_mps[int(values[0, -1] == LOGGED)]
        if speed_mps is None:
            raise AllRunsFailedError("all runs failed", "")
        self.num_runs += num_runs
        return SimpleNamespace(tally=self.tallies(speed_mps, num_runs)[None])


@pytest.fixture
def usual_mps(small_problem: CalibrationProblem) -> np.ndarray:
    return np.linspace(30.0, 14.0, small_problem.road.num_sections)


def look_at(
    problem: CalibrationProblem, surrogate: Simulated | None, sumo: Simulated, finer: Simulated | None = None
) -> tuple[FirstLook, np.ndarray]:
    in_scenario = FinalRuns(sumo.tallies(sumo.speeds_mps[0], 4), np.zeros(4, int), ())  # pyright: ignore
    session: Any = SimpleNamespace(progress=Silent(), stopwatch=Stopwatch(time.perf_counter))
    look = FirstLook(problem, surrogate, sumo, PLAN, session, lambda: in_scenario, lambda: finer)  # pyright: ignore
    values = np.append(problem.template.base_values()[:-1], LOGGED)
    return look, look.tallies_with(values)


def mean_mps(problem: CalibrationProblem, tallies: np.ndarray) -> np.ndarray:
    total = tallies.sum(axis=0)
    sections = range(problem.road.num_sections)
    return np.asarray(
        [
            total[problem.tally_index[f"section_speed[{s}]"]] / total[problem.tally_index[f"section_frames[{s}]"]]
            for s in sections
        ]
    )


def test_where_both_agree_the_surrogate_tells(small_problem: CalibrationProblem, usual_mps: np.ndarray):
    surrogate = Simulated(small_problem, 1.05 * usual_mps, 1.2 * usual_mps)
    sumo = Simulated(small_problem, usual_mps, usual_mps)
    look, tallies = look_at(small_problem, surrogate, sumo)
    assert (look.agrees, len(look.agreements)) == (True, 1)
    assert mean_mps(small_problem, tallies) == pytest.approx(1.2 * usual_mps)
    assert sumo.num_runs == 0


def test_a_jam_that_only_the_scenario_s_drivers_make_is_no_reason(
    small_problem: CalibrationProblem, usual_mps: np.ndarray
):
    surrogate = Simulated(small_problem, 0.5 * usual_mps, 0.95 * usual_mps)
    look, tallies = look_at(small_problem, surrogate, Simulated(small_problem, usual_mps, usual_mps))
    assert (look.agrees, [one.holds for one in look.agreements]) == (True, [False, True])
    assert mean_mps(small_problem, tallies) == pytest.approx(0.95 * usual_mps)


@pytest.mark.parametrize("factor", [None, 2.0, 0.66])
def test_where_they_differ_otherwise_sumo_searches(
    small_problem: CalibrationProblem, usual_mps: np.ndarray, factor: float | None
):
    there = None if factor is None else factor * usual_mps
    sumo = Simulated(small_problem, usual_mps, 1.1 * usual_mps)
    look, tallies = look_at(small_problem, Simulated(small_problem, 0.6 * usual_mps, there), sumo)
    assert not look.agrees
    assert mean_mps(small_problem, tallies) == pytest.approx(1.1 * usual_mps)


def test_without_a_surrogate_sumo_tells(small_problem: CalibrationProblem, usual_mps: np.ndarray):
    look, tallies = look_at(small_problem, None, Simulated(small_problem, usual_mps, 1.1 * usual_mps))
    assert look.agreements == []
    assert mean_mps(small_problem, tallies) == pytest.approx(1.1 * usual_mps)


def test_where_nobody_can_drive_with_the_logs_drivers_the_scenario_s_runs_tell(
    small_problem: CalibrationProblem, usual_mps: np.ndarray
):
    look, tallies = look_at(small_problem, None, Simulated(small_problem, usual_mps, None))
    assert not look.agrees
    assert mean_mps(small_problem, tallies) == pytest.approx(usual_mps)


@pytest.mark.parametrize(("factor", "agrees"), [(1.06, True), (0.7, False), (None, False)])
def test_more_frequent_decisions_are_tried_before_the_surrogate_is_left(
    small_problem: CalibrationProblem, usual_mps: np.ndarray, factor: float | None, agrees: bool
):
    usual = Simulated(small_problem, 0.6 * usual_mps, 0.7 * usual_mps)
    finer = Simulated(small_problem, None, None if factor is None else factor * usual_mps)
    sumo = Simulated(small_problem, usual_mps, usual_mps)
    look, tallies = look_at(small_problem, usual, sumo, finer)
    assert (look.agrees, look.surrogate is finer) == (agrees, agrees)
    assert [one.holds for one in look.agreements] == [False, False, agrees]
    assert mean_mps(small_problem, tallies) == pytest.approx((factor if agrees else 1.0) * usual_mps)  # pyright: ignore
    again = look.tallies_with(np.append(small_problem.template.base_values()[:-1], LOGGED))
    assert mean_mps(small_problem, again) == pytest.approx(mean_mps(small_problem, tallies))


def test_more_frequent_decisions_are_not_tried_where_the_usual_do(
    small_problem: CalibrationProblem, usual_mps: np.ndarray
):
    usual, finer = (Simulated(small_problem, usual_mps, usual_mps) for _ in range(2))
    look, _ = look_at(small_problem, usual, Simulated(small_problem, usual_mps, usual_mps), finer)
    assert look.surrogate is usual
    assert finer.num_runs == 0
