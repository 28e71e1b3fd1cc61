"""Null runs and trials stand for the drives of the field, each as often as the others."""

from types import SimpleNamespace
from typing import Any

import pytest

from jaxcalib.diagnosis.runs.null_runs import starts_of_runs
from sim_adapters.interface import DriveStart

TWO_TIMES = (DriveStart(300.0, 0), DriveStart(300.0, 1), DriveStart(320.0, 2), DriveStart(320.0, 3))
ONE_IN_PARTS = (DriveStart(300.0), DriveStart(300.0), DriveStart(300.0, 2), DriveStart(360.0))


@pytest.mark.parametrize(
    ("shares", "starts", "expected"),
    [
        # the first few runs are not all of one time
        (False, TWO_TIMES, [TWO_TIMES[:1], TWO_TIMES[2:3], TWO_TIMES[1:2], TWO_TIMES[3:]]),
        # two whole drives and one in parts: a third of those at 300 s is in parts, not a half
        (False, ONE_IN_PARTS, [(one,) for one in ONE_IN_PARTS]),
        (True, ONE_IN_PARTS, [(DriveStart(300.0), DriveStart(360.0)), (DriveStart(300.0),), (DriveStart(300.0, 2),)]),
        (False, (DriveStart(300.0), DriveStart(320.0)) * 3, [(DriveStart(300.0),), (DriveStart(320.0),)]),
    ],
)
def test_each_drive_has_its_share_of_the_runs(
    shares: bool, starts: tuple[DriveStart, ...], expected: list[tuple[DriveStart, ...]]
):
    problem: Any = SimpleNamespace(template=SimpleNamespace(can_share_runs=shares), drive_starts=lambda: starts)
    assert sorted(starts_of_runs(problem)) == sorted(expected)
    if not shares:
        assert starts_of_runs(problem) == expected
