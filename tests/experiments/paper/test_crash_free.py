"""Drivers of simulated patterns do not crash."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.paper import crash_free
from experiments.paper.crash_free import MOST_DRAWS, first_crash_free_draw
from jaxcalib.errors import CaseError
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunRequest, Status


@dataclass
class Sumo:
    """Has a crash in one drive where the first value is below a limit, and no result where the second is negative."""

    limit: float
    crash_s: float  # departure of the drive that has it
    asked: list[RunRequest]

    def run(self, requests: Sequence[RunRequest]) -> list[SimpleNamespace]:
        self.asked += requests
        return [
            SimpleNamespace(
                status=Status.FAILED if request.values[1] < 0.0 else Status.OK,
                num_collisions=int(request.values[0] < self.limit and request.depart_s == self.crash_s),
            )
            for request in requests
        ]


def values_of(draw: int) -> Iterator[np.ndarray]:
    """A heavy and a light demand of each draw; the third draw fails in the light one."""
    yield np.asarray([draw - 0.5, 1.0])
    yield np.asarray([draw + 0.5, -1.0 if draw == 2 else 1.0])


def look(monkeypatch: pytest.MonkeyPatch, problem: CalibrationProblem, limit: float) -> tuple[int, Sumo]:
    sumo = Sumo(limit, problem.drive_starts("fit")[-1].depart_s, [])

    @contextmanager
    def engine(of: CalibrationProblem) -> Iterator[Sumo]:
        assert of is problem
        yield sumo

    monkeypatch.setattr(crash_free, "sumo_engine", engine)
    return first_crash_free_draw(problem, values_of), sumo


def test_the_first_draw_without_a_crash_in_any_pattern(
    monkeypatch: pytest.MonkeyPatch, small_problem: CalibrationProblem
):
    draw, sumo = look(monkeypatch, small_problem, limit=1.0)
    assert draw == 3  # 0 and 1 crash with the heavy demand, 2 has no result with the light one
    starts = small_problem.drive_starts("fit")
    assert {request.depart_s for request in sumo.asked} == {starts[0].depart_s, starts[-1].depart_s}
    # a draw that crashes with one demand is not run with the next
    assert len(sumo.asked) == 2 * (1 + 1 + 2 + 2)


def test_where_all_crash_a_line_says_so(monkeypatch: pytest.MonkeyPatch, small_problem: CalibrationProblem):
    with pytest.raises(CaseError, match=f"each of {MOST_DRAWS} draws"):
        look(monkeypatch, small_problem, limit=1e9)
