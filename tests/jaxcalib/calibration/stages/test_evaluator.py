"""Which runs a candidate gets: drives in turn, seeds, and what each stands for."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.stages.evaluator import Evaluator, in_rounds, interleaved
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import NO_DRIVE, DriveStart
from sim_adapters.world.recorded_parts import RecordedParts

NOBODY: Any = None  # who is asked for requests alone runs nothing
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
