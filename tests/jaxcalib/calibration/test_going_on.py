"""When a search goes on with SUMO, and by which means."""

from types import SimpleNamespace
from typing import Any

import pytest

from jaxcalib.calibration import value_search
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.session import open_session
from sim_adapters.interface import DriveStart

PLAN: Any = Budget(8, 16, 16, 64, 32, 5, 2, 64, 2, 2, 3)


PROBLEM: Any = SimpleNamespace(
    layout=SimpleNamespace(names=("main", "tau", "accel")), drive_starts=lambda role: (DriveStart(300.0),)
)
A_POLISH = (len(PROBLEM.layout.names) + 6) * PLAN.polish_runs
MAPPING = PLAN.most_mappings * 2 * PLAN.confirmation_runs  # two finalists a step
POLISHING = PLAN.most_polishes * A_POLISH + PLAN.confirmation_runs


class Planned(Silent):
    """Notes by how much a search in SUMO grows."""

    def __init__(self, done: list, has_noise: bool) -> None:
        self._done = done
        self._mappings = PLAN.most_mappings if has_noise else 0

    def plan(self, num_surrogate_runs: int, num_sumo_runs: int) -> None:
        assert num_surrogate_runs == PLAN.num_surrogate_runs + self._mappings * A_POLISH
        self._done.append(num_sumo_runs - PLAN.num_sumo_runs)


def went_on(
    patch: pytest.MonkeyPatch,
    *,
    agrees: bool,
    beyond_noise: bool,
    may_leave: bool,
    takes_steps: bool = True,
    has_noise: bool = True,
) -> tuple[list, list]:
    """Return what was done after the confirmation, SUMO's further runs among it, and which points are on record."""
    done: list[str] = []

    def step(name: str) -> Any:
        return lambda *args, **options: (
            done.append(name) or SimpleNamespace(after=name, went_on_by=[name] * takes_steps)
        )

    def compared(problem: Any, confirmation: Any, where: str) -> Any:
        return SimpleNamespace(where=where, of=confirmation.after, holds=agrees)

    usual = SimpleNamespace(num_runs=0)
    look = SimpleNamespace(agreements=[], surrogate=usual, agrees=True, warnings=[])
    first = SimpleNamespace(
        initial=SimpleNamespace(space=None), look=look, usual=usual, in_sumo=usual, num_surrogate_runs=0,
        decision_interval_s=1.0,
    )  # fmt: skip
    patch.setattr(value_search, "find_first_values", lambda *args: first)
    patch.setattr(value_search, "sumo_evaluator", lambda *args, **named: usual)
    patch.setattr(value_search, "in_sumo_alone", lambda *args: PLAN)
    patch.setattr(value_search, "search_two_stages", lambda *args: None)
    patch.setattr(value_search, "confirm", lambda *args: SimpleNamespace(after="confirm"))
    patch.setattr(value_search, "can_be_mapped", lambda confirmation: has_noise)
    patch.setattr(value_search, "search_mapped", step("mapping"))
    patch.setattr(value_search, "search_on_in_sumo", step("SUMO"))
    patch.setattr(value_search, "leaves_more_than_noise", lambda confirmation: beyond_noise)
    patch.setattr(value_search, "_agreement_of_result", compared)
    nothing: Any = None
    with open_session(None, {}, progress=Planned(done, has_noise)) as session:
        searched = value_search.search_values(
            PROBLEM, nothing, PLAN, nothing, nothing, session, nothing, may_leave_surrogate=may_leave
        )
    return done, [(one.where, one.of) for one in searched.agreements]


FOUND = ("at the values found", "confirm")


def test_a_surrogate_that_drives_alike_needs_no_more(monkeypatch: pytest.MonkeyPatch):
    assert went_on(monkeypatch, agrees=True, beyond_noise=True, may_leave=True) == ([], [FOUND])


def test_one_that_does_not_is_mapped_and_what_failed_stays_on_record(monkeypatch: pytest.MonkeyPatch):
    done, compared = went_on(monkeypatch, agrees=False, beyond_noise=False, may_leave=True)
    assert done == [MAPPING, "mapping"]
    assert compared == [FOUND, ("at the values found with SUMO", "mapping")]


def test_where_no_step_is_taken_there_is_nothing_to_compare_again(monkeypatch: pytest.MonkeyPatch):
    done, compared = went_on(monkeypatch, agrees=False, beyond_noise=False, may_leave=True, takes_steps=False)
    assert done == [MAPPING, "mapping"]
    assert compared == [FOUND]


def test_sumo_polishes_while_noise_explains_less_than_remains(monkeypatch: pytest.MonkeyPatch):
    done, compared = went_on(monkeypatch, agrees=False, beyond_noise=True, may_leave=True)
    assert done == [MAPPING, "mapping", MAPPING + POLISHING, "SUMO"]
    assert compared == [FOUND, ("at the values found with SUMO", "SUMO")]


def test_without_noise_no_runs_of_a_mapping_are_planned(monkeypatch: pytest.MonkeyPatch):
    done, _ = went_on(monkeypatch, agrees=False, beyond_noise=True, may_leave=True, has_noise=False)
    assert done == [0, "mapping", POLISHING, "SUMO"]


def test_a_search_that_is_to_stay_in_the_surrogate_does(monkeypatch: pytest.MonkeyPatch):
    assert went_on(monkeypatch, agrees=False, beyond_noise=True, may_leave=False) == ([], [FOUND])
