"""Which runs a candidate gets: drives in turn, seeds, and what each stands for."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.drives_in_turn import in_rounds, interleaved
from sim_adapters.interface import NO_DRIVE, DriveStart
from sim_adapters.world.recorded_parts import RecordedParts
from tests.jaxcalib.calibration.toy import SPACE, ToySimulator, starts_at

NOBODY: Any = None  # who is asked for requests alone runs nothing
HALFWAY = np.full((1, 3), 0.5)
HALF_M = ((-np.inf, 500.0),)


def starts(*told: tuple[float, int]) -> list[DriveStart]:
    return [DriveStart(*one) for one in told]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        # alike drives are one, where each occurs as often as the others
        ([300.0, 340.0, 300.0, 340.0], [(300.0, NO_DRIVE), (340.0, NO_DRIVE)]),
        ([340.0, 300.0, 300.0], [(340.0, NO_DRIVE), (300.0, NO_DRIVE), (300.0, NO_DRIVE)]),
        # drives of one departure that differ are not one after the other
        ([(300.0, 0), (300.0, 1), (320.0, 2), (320.0, 3)], [(300.0, 0), (320.0, 2), (300.0, 1), (320.0, 3)]),
        ([(300.0, 5), (300.0, NO_DRIVE), (320.0, NO_DRIVE)], [(300.0, NO_DRIVE), (320.0, NO_DRIVE), (300.0, 5)]),
    ],
)
def test_runs_take_drives_in_turn(given: Sequence[Any], expected: Sequence[tuple[float, int]]):
    told = [DriveStart(one) if isinstance(one, float) else DriveStart(*one) for one in given]
    assert interleaved(told) == starts(*expected)
    assert in_rounds(told, 2 * len(expected) + 1) == 2 * len(expected)


def test_each_run_names_its_drive_and_shares_with_those_far_from_it():
    evaluator = Evaluator(NOBODY, starts((300.0, 0), (300.0, 1), (360.0, 2)), 70, shares_runs=True)
    requests = evaluator.requests(np.asarray([1.5, 2.0]), 6)
    told = [(one.seed, one.depart_s, one.drive, one.also_depart_s) for one in requests]
    first = [(70, 300.0, 0, (360.0,)), (70, 360.0, 2, (300.0,)), (71, 300.0, 1, ())]
    assert told == [*first, *((seed + 2, *rest) for seed, *rest in first)]


@pytest.mark.parametrize("role", ["fit", "held_out"])
def test_a_problem_tells_drives_apart_where_their_logs_differ(small_problem: CalibrationProblem, role: Any):
    drives = small_problem.case.drives
    numbers = [number for number, drive in enumerate(drives) if drive.role == role]
    assert [one.drive for one in small_problem.drive_starts(role)] == [NO_DRIVE] * len(numbers)
    parts = [RecordedParts(HALF_M) if number == numbers[-1] else RecordedParts() for number in range(len(drives))]
    template = dataclasses.replace(small_problem.template, recorded=tuple(parts))
    in_parts = dataclasses.replace(small_problem, template=template).drive_starts(role)
    assert [one.drive for one in in_parts] == [*[NO_DRIVE] * (len(numbers) - 1), numbers[-1]]
    assert [one.depart_s for one in in_parts] == [drives[number].depart_s for number in numbers]


def test_a_replay_repeats_the_drives_that_it_may_alone(small_problem: CalibrationProblem):
    """Drives to fit and held-out ones that depart at the same time have different numbers."""
    logged: Any = (None,) * len(small_problem.case.drives)
    template = dataclasses.replace(small_problem.template, logged_drives=logged)
    replayed = dataclasses.replace(small_problem, template=template)
    requests = Evaluator(NOBODY, replayed.drive_starts("fit"), 0).requests(np.ones(2), 40)
    fit = [number for number, drive in enumerate(small_problem.case.drives) if drive.role == "fit"]
    assert {one.drive for one in requests} == set(fit)
    assert all(one.depart_s == small_problem.case.drives[one.drive].depart_s for one in requests)


def test_all_candidates_run_the_same_seeds_and_each_drive_equally_often():
    simulator = ToySimulator()
    evaluator = Evaluator(simulator, starts_at(300.0, 320.0, 300.0, 320.0), 70)
    evaluator.evaluate(SPACE.values_of(np.asarray([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])), 6)
    first, second = simulator.requests[:6], simulator.requests[6:]
    assert [r.seed for r in first] == [r.seed for r in second] == list(range(70, 76))
    assert [r.depart_s for r in first] == [300.0, 320.0] * 3
    assert evaluator.rounds_of(5) == 4


def test_drives_that_share_a_run_have_its_seed_and_know_of_each_other():
    simulator = ToySimulator()
    evaluator = Evaluator(simulator, starts_at(300.0, 320.0, 380.0, 300.0, 320.0, 380.0), 70, shares_runs=True)
    evaluator.evaluate(SPACE.values_of(HALFWAY), 6)
    made = [(one.seed, one.depart_s, one.also_depart_s) for one in simulator.requests]
    first = [(70, 300.0, (380.0,)), (71, 320.0, ()), (70, 380.0, (300.0,))]
    assert made == first + [(seed + 2, *others) for seed, *others in first]
    assert evaluator.worth(6) == pytest.approx(4 + 0.7 * 2)


def test_drives_that_depart_together_never_share_a_run():
    simulator = ToySimulator()
    evaluator = Evaluator(simulator, starts_at(300.0, 380.0, 300.0), 1, shares_runs=True)
    evaluator.evaluate(SPACE.values_of(HALFWAY), 6)
    departures = [(one.seed, one.depart_s) for one in simulator.requests]
    assert len(set(departures)) == 6
    assert all(one.depart_s not in one.also_depart_s for one in simulator.requests)
    assert Evaluator(simulator, starts_at(300.0, 380.0), 1).worth(6) == 6


def test_nothing_but_failures_is_said_plainly():
    evaluator = Evaluator(ToySimulator(failing=(0.0, 1.0)), starts_at(300.0), 1)
    with pytest.raises(AllRunsFailedError, match="all 3 runs failed"):
        evaluator.evaluate(SPACE.values_of(HALFWAY), 3)


def test_a_round_without_success_is_survived_once_something_has_succeeded():
    simulator = ToySimulator()
    evaluator = Evaluator(simulator, starts_at(300.0), 1)
    evaluator.evaluate(SPACE.values_of(HALFWAY), 2)
    simulator.failing = (0.0, 1.0)
    found = evaluator.evaluate(SPACE.values_of(HALFWAY), 3)
    assert not found.is_ok.any()
    assert np.isnan(found.pooled).all()


def test_runs_take_every_drive_equally_often_where_departures_are_uneven():
    simulator = ToySimulator()
    evaluator = Evaluator(simulator, starts_at(300.0, 320.0, 300.0), 1)
    evaluator.evaluate(SPACE.values_of(HALFWAY), evaluator.rounds_of(5))
    assert [request.depart_s for request in simulator.requests] == [300.0, 320.0, 300.0] * 2
