"""The corridor with an engine that takes no time: its runs answer to parameters and seeds, and some fail."""

import functools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest

from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.sweeps import preparation
from jaxcalib.sweeps import sweep as module
from jaxcalib.sweeps.plan import SweepPlan
from jaxcalib.sweeps.report import write_report
from sim_adapters.interface import RunOutcome, RunRequest, Status
from tests.places import CORRIDOR

read_once = functools.cache(read_problem)


StatusOf = Callable[[RunRequest], Status]


def some_collide(request: RunRequest) -> Status:
    return Status.COLLIDED if round(1e6 * request.values[2]) % 7 == 0 else Status.OK


def outcome_of(problem: CalibrationProblem, request: RunRequest, status: Status) -> RunOutcome:
    tally = problem.field_tally[request.seed % len(problem.drives)] * (1.0 + 1e-4 * request.values[0])
    counts = np.asarray([900, 100])
    observed, num_collisions = (tally, 0) if status.is_ok else (None, 3)
    words = f"words of seed {request.seed}" if status is Status.FAILED else ""
    return RunOutcome(request, status, observed, counts, counts - 1, num_collisions, wall_s=0.5, log_tail=words)


class ToyEngine:
    """Makes blocks at once; stops where it is told to."""

    def __init__(self, problem: CalibrationProblem, stop_before: int | None, status_of: StatusOf) -> None:
        self.problem, self.stop_before, self.status_of, self.made = problem, stop_before, status_of, 0
        self.is_closed = False

    def outcomes(self, plan: SweepPlan, blocks: Iterable[int]) -> Iterator[tuple[int, list[RunOutcome]]]:
        for block in blocks:
            if self.made == self.stop_before:
                raise KeyboardInterrupt
            self.made += 1
            requests = plan.requests(block)
            yield block, [outcome_of(self.problem, request, self.status_of(request)) for request in requests]

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[ToyEngine]]:
    """Return what puts a toy in the place of the engines; the list holds those that were used."""
    for reader in (preparation, module):
        monkeypatch.setattr(reader, "read_problem", lambda case: read_once(CORRIDOR))
    used: list[ToyEngine] = []

    def put(stop_before: int | None = None, status_of: StatusOf = some_collide) -> list[ToyEngine]:
        def engine(problem: CalibrationProblem, name: str) -> ToyEngine:
            used.append(ToyEngine(problem, stop_before, status_of))
            return used[-1]

        monkeypatch.setattr(module, "local_engine", engine)
        return used

    put()
    monkeypatch.setattr(module, "write_report", lambda table, problem: None)  # its figures take seconds
    return put


@pytest.fixture
def calm(tmp_path: Path) -> Path:
    """Return settings with little traffic, of which SUMO's runs are short."""
    file = tmp_path / "calm.toml"
    file.write_text("[bounds]\nmain = [900.0, 1800.0]\non1 = [150.0, 300.0]\n")
    return file


@pytest.fixture
def with_report(toy: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the page after all."""
    monkeypatch.setattr(module, "write_report", write_report)
