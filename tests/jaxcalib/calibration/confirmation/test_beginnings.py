"""Where SUMO cannot run what a search found, what came next is confirmed: a calibration does not end for that."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.confirmation.confirmation import FOUND, NEXT_BEST, confirm
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.calibration.stages.search_run import SearchRun
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.session import Session, open_session
from sim_adapters.interface import Status
from tests.jaxcalib.calibration.confirmation.test_space_mapping import BUDGET, STARTS
from tests.jaxcalib.calibration.toy import OFFSET, SPACE, ToySimulator, toy_objective

BEST, SECOND, THIRD, FOURTH, BROKEN = (
    [0.4, 0.6, 0.2],
    [0.4, 0.5, 0.2],
    [0.4, 0.3, 0.2],
    [0.4, 0.1, 0.2],
    [0.4, 0.9, 0.2],
)
ONCE = replace(BUDGET, confirmation_rounds=1)
NUM_TALLIES = 2 * len(OFFSET) + 1


class Told(Silent):
    """Keeps notes."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def notes(self, lines: Sequence[str]) -> None:
        self.lines += lines


@pytest.fixture
def session() -> Iterator[Session]:
    with open_session(None, {}, progress=Told()) as opened:
        yield opened


def found_in_surrogate() -> Any:
    """What a search leaves whose last comparison had six points, one of them twice, another one failed."""
    surrogate = Evaluator(ToySimulator(failing=(0.85, 1.0)), STARTS, 50)
    run = SearchRun(surrogate, SPACE, toy_objective())
    judged = run.judge(np.asarray([THIRD, BEST, BROKEN, FOURTH, SECOND, BEST]), 16, "stage", 0)
    order = np.argsort(-np.nan_to_num(judged.accuracy, nan=-np.inf))
    assert [judged.unit[place][1].round(1) for place in order] == [0.6, 0.6, 0.5, 0.3, 0.1, 0.9]
    best = judged.unit[order[0]]
    return SimpleNamespace(best=best, judged=[judged], objective=toy_objective(), course=[], half_width=np.full(3, 0.3))


def confirmed(session: Session, failing: tuple[float, float] | None) -> Any:
    sumo = Evaluator(ToySimulator(failing=failing), STARTS, 950, num_tallies=NUM_TALLIES)
    surrogate = Evaluator(ToySimulator(), STARTS, 50)
    initial: Any = SimpleNamespace(space=SPACE)
    return confirm(found_in_surrogate(), initial, surrogate, sumo, ONCE, session)


def test_what_sumo_can_run_is_confirmed(session: Session) -> None:
    (finalist,) = confirmed(session, None).finalists
    assert (finalist.origin, finalist.unit[1].round(1)) == (FOUND, 0.6)
    assert not session.progress.lines  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(("failing", "second"), [((0.55, 0.65), 0.5), ((0.45, 0.65), 0.3)])
def test_where_it_cannot_the_next_best_is(session: Session, failing: tuple[float, float], second: float) -> None:
    result = confirmed(session, failing)
    (finalist,) = result.finalists
    assert (finalist.origin, finalist.unit[1].round(1)) == (NEXT_BEST, second)
    failed = [one for one in result.outcomes if not one.status.is_ok]
    assert len(failed) == len(result.outcomes) - ONCE.confirmation_runs > 0  # what failed is counted
    lines = session.progress.lines  # pyright: ignore[reportAttributeAccessIssue]
    assert len(lines) == len(failed) / ONCE.confirmation_runs
    assert all(f"cannot be confirmed ({Status.COLLIDED.value})" in line for line in lines)


def test_after_three_points_it_says_why_there_is_no_result(session: Session) -> None:
    with pytest.raises(AllRunsFailedError, match="the search's result failed in SUMO: "):
        confirmed(session, (0.25, 0.65))
