"""Values that the logs do not show are moved where that explains the drives best; the roads are made up."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, null_model
from jaxcalib.diagnosis.inference.baseline import Baseline, BaselineMaker, Converged
from jaxcalib.diagnosis.inference.investigation import NotTestableError
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.overdispersion import LEAST_TEMPERATURE
from jaxcalib.diagnosis.inference.silent_values import evidence_between
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.inference.verdict import LEAST_EVIDENCE
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.reopened import reopen_silent_values
from jaxcalib.diagnosis.stages.simulated import Simulated
from jaxcalib.runs.stopwatch import Stopwatch
from sim_adapters.interface import DriveStart

NUM_FEATURES, NUM_FIELD, NUM_NULL = 24, 8, 48
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure {k}") for k in range(NUM_FEATURES))
ANSWER = np.random.default_rng(5).normal(1.0, 0.3, NUM_FEATURES)  # of features to the silent value, per unit
NAMES = ("main", "tau", "lcSpeedGain")
VALUES = np.asarray([3000.0, 1.2, 1.0])  # of an inflow, of a time gap, and of a weight that the logs do not show
BOUNDS = np.asarray([2500.0, 1.1, 0.2]), np.asarray([3500.0, 1.3, 5.0])
FIRST_SLOPE_RUNS, SLOPE_RUNS, SILENT_RUNS, LOOK_RUNS = 12, 32, 8, 40
FIRST_NULL_RUNS, DEFAULT_RUNS = 24, 6

Road = Callable[[float], float]  # what a silent value moves features by, in units of ANSWER


def as_it_is(weight: float) -> float:
    return weight


def drives(weight: float, number: int, seed: int, road: Road = as_it_is) -> DriveTallies:
    noise = np.random.default_rng(seed).standard_normal((number, NUM_FEATURES))
    above = 5.0 + ANSWER * road(weight) + 0.5 * noise
    return DriveTallies(CELLS, above, np.ones_like(above), np.zeros(number))


class Runner:
    """A surrogate in which each run has its own noise, the same for all values."""

    def __init__(self, road: Road) -> None:
        self.road = road

    def run(self, trials: Sequence[Trial], on_runs: Callable[[int], None]) -> dict[str, DriveTallies]:
        on_runs(sum(trial.num_runs for trial in trials))
        return {trial.name: drives(trial.values[2], trial.num_runs, 9, self.road) for trial in trials}


class Maker:
    """Makes baselines in a SUMO of its own."""

    def __init__(
        self, is_silent: bool, sumo: Road | None, whole: Road | None, cells: tuple[Cell, ...], law: float
    ) -> None:
        self.error = np.asarray([100.0, 0.02, np.inf if is_silent else 0.1])
        self.bounds = BOUNDS
        self.begin = VALUES
        self.sumo, self.with_all_runs, self.cells, self.law = sumo, whole, cells, law
        self.asked: list[float] = []

    def at(self, values: np.ndarray, runner: Any) -> Baseline:
        self.asked.append(float(values[2]))
        if self.sumo is None:
            raise AllRunsFailedError("the values failed in SUMO", "")
        return baseline_at(values, self.sumo, FIRST_NULL_RUNS, self.cells, self.law)

    def onward(self, first: Baseline) -> Converged:
        if self.with_all_runs is None:
            raise NotTestableError("too few runs reach the end")
        whole = baseline_at(first.values, self.with_all_runs, NUM_NULL, self.cells, self.law)
        return Converged(first, whole, 1, 0)


def baseline_at(
    values: np.ndarray,
    sumo: Road,
    num_null: int = NUM_NULL,
    cells: tuple[Cell, ...] = CELLS,
    law: float = 0.0,
    surrogate: Road = as_it_is,
) -> Baseline:
    """Return a baseline; `law` is what its own expectation of drivers adds to what is counted."""
    chosen = [CELLS.index(cell) for cell in cells]
    plain, field = (
        DriveTallies(cells, tallies.above[:, chosen] + law, tallies.below[:, chosen], tallies.depart_s)
        for tallies in (drives(float(values[2]), num_null, 1, sumo), drives(3.4, NUM_FIELD, 2))
    )
    nothing = np.zeros((len(cells), 1))
    below = np.full(len(cells), float(NUM_FIELD))
    null: NullModel = null_model(cells, below, plain, nothing, nothing, np.ones(1), None, NUM_FIELD)
    difference = null.standardised(field.values())
    fitted = SimpleNamespace(null=null, difference=difference, tallies=field)
    in_sumo = SimpleNamespace(default=lambda: None)
    trials = {BASELINE: drives(float(values[2]), FIRST_SLOPE_RUNS, 9, surrogate)}
    made = SimpleNamespace(
        values=values, trials=trials, fitted=fitted, runs=SimpleNamespace(plain=plain), runner=Runner(surrogate),
        in_sumo=in_sumo, difference=difference, by_chance=float(len(cells)),
    )  # fmt: skip
    return cast(Baseline, made)


def reopened(
    verdict: str = "unknown",
    is_silent: bool = True,
    surrogate: Road = as_it_is,
    sumo: Road | None = as_it_is,
    whole: Road | None = as_it_is,
    others: float = 20.0,
    began_at: float = 1.0,
    cells: tuple[Cell, ...] = CELLS,
    law: float = 0.0,
) -> tuple[Simulated, Simulated, Maker]:
    """Return the simulation before and after, and what made it."""
    maker = Maker(is_silent, sumo, whole, cells, law)
    default = drives(1.0, DEFAULT_RUNS, 3)
    present, began = (
        baseline_at(np.asarray([*VALUES[:2], weight]), as_it_is, surrogate=surrogate) for weight in (1.0, began_at)
    )
    before = Simulated(cast(BaselineMaker, maker), Converged(began, present, 1, 0), default)
    known = {BASELINE: drives(1.0, SLOPE_RUNS, 9, surrogate)}
    book = TrialBook(present.runner, FinishedParts(None), "", known, lambda number: None)
    explained = [Explained("unknown", -100.0 + others), Explained("none", -100.0)]
    checked = Checked(explained, {}, (), LOOK_RUNS)
    plan = SimpleNamespace(
        first_slope_runs=FIRST_SLOPE_RUNS, slope_runs=SLOPE_RUNS, silent_runs=SILENT_RUNS,
        first_null_drives=FIRST_NULL_RUNS,
    )  # fmt: skip
    alone = SimpleNamespace(template=SimpleNamespace(can_share_runs=False), drive_starts=lambda: (DriveStart(300.0),))
    progress = SimpleNamespace(surrogate_runs=lambda number: None)
    session = SimpleNamespace(
        seed=0, plan=plan, problem=alone, stopwatch=Stopwatch(lambda: 0.0), parts=FinishedParts(None), progress=progress
    )
    judged = cast(Judged, SimpleNamespace(verdict=SimpleNamespace(kind=verdict), grounds=SimpleNamespace(pairs=None)))
    return before, reopen_silent_values(cast(Any, session), before, book, checked, judged), maker


def test_a_silent_value_that_explains_the_drives_is_moved_there():
    before, after, maker = reopened()
    assert after.baseline is not before.baseline
    np.testing.assert_array_equal(after.baseline.values[:2], VALUES[:2])
    assert after.baseline.values[2] == pytest.approx(3.4, abs=0.3)
    assert maker.asked == [after.baseline.values[2]]
    assert (before.moved(NAMES), after.moved(NAMES)) == ([], ["lcSpeedGain"])
    assert (before.instead_of, after.instead_of) == ("", "unknown")
    assert after.baseline.runs.plain.num_runs == NUM_NULL
    assert after.converged.num_baselines == 2
    # looks and the scenario's own runs, and those of the values given up beyond their first
    assert after.converged.num_sumo_runs == LOOK_RUNS + DEFAULT_RUNS + NUM_NULL - FIRST_NULL_RUNS
    # the baseline's, and of each surface eight values, and where it leads and its best point, if it promises anything
    surfaces, left = divmod(after.converged.num_surrogate_runs - SLOPE_RUNS, 8 * SILENT_RUNS + 2 * SLOPE_RUNS)
    assert surfaces in (1, 2, 3)
    assert left in (0, 8 * SILENT_RUNS)


def test_searches_begin_at_the_values_of_the_logs_too_and_sumo_chooses():
    """Beyond 3.3 this SUMO is full, and the drives are at 3.4 by the law of a free road."""

    def full(weight: float) -> float:
        return weight if weight < 3.3 else 9.0

    _, after, maker = reopened(began_at=2.5, sumo=full)
    assert len(maker.asked) == 2
    assert max(maker.asked) > 3.3 > min(maker.asked)
    assert after.baseline.values[2] == min(maker.asked)
    assert after.converged.num_baselines == 3


def test_a_value_that_logs_show_is_not_told_as_one_that_they_do_not():
    _, after, maker = reopened()
    elsewhere = baseline_at(after.baseline.values * [1.0, 1.1, 1.0], as_it_is)
    found = Simulated(cast(BaselineMaker, maker), Converged(elsewhere, elsewhere, 1, 0), None)
    assert found.moved(NAMES) == ["lcSpeedGain"]


@pytest.mark.parametrize("verdict", ["no_gap", "miscalibrated"])
def test_where_nothing_is_missing_nothing_is_run(verdict: str):
    before, after, maker = reopened(verdict)
    assert after is before
    assert maker.asked == []


def test_what_the_logs_show_stays():
    before, after, maker = reopened(is_silent=False)
    assert after is before
    assert maker.asked == []


def test_what_changes_nothing_in_the_surrogate_is_not_tried_in_sumo():
    before, after, maker = reopened(surrogate=lambda weight: 0.0)
    assert after.baseline is before.baseline
    assert after.converged == before.converged
    assert maker.asked == []


@pytest.mark.parametrize(
    ("options", "num_slope_runs", "num_sumo_runs"),
    [
        ({"sumo": lambda weight: 1.0, "whole": lambda weight: 1.0}, SLOPE_RUNS, NUM_NULL - FIRST_NULL_RUNS),
        ({"whole": lambda weight: 1.0}, SLOPE_RUNS, NUM_NULL - FIRST_NULL_RUNS),  # its first runs do, all do not
        ({"sumo": None}, 0, 0),  # runs fail there
        ({"whole": None}, SLOPE_RUNS, 0),  # further ones do
        ({"others": 1e6}, SLOPE_RUNS, NUM_NULL - FIRST_NULL_RUNS),  # another explanation is better
        ({"cells": CELLS[: NUM_FEATURES // 2]}, SLOPE_RUNS, NUM_NULL - FIRST_NULL_RUNS),  # half is no longer seen there
    ],
)
def test_sumo_has_the_last_word(options: dict[str, Any], num_slope_runs: int, num_sumo_runs: int):
    before, after, maker = reopened(**options)
    assert len(maker.asked) == 1
    assert after.baseline is before.baseline
    assert after.converged.num_baselines == 2
    assert after.converged.num_surrogate_runs == 7 * num_slope_runs
    assert after.converged.num_sumo_runs == num_sumo_runs


def test_as_much_better_as_between_explanations_is_enough():
    """What they explain less than twice five above, and the eight chances that they had, is not enough."""
    alone = baseline_at(VALUES, as_it_is)
    needed = LEAST_TEMPERATURE * (LEAST_EVIDENCE + np.log(8))
    _, near, maker = reopened(others=0.0)
    assert near.baseline.values[2] == maker.asked[0]
    found = baseline_at(near.baseline.values, as_it_is)
    gain = evidence_between(found.fitted.null, found.difference, alone.fitted.null, alone.difference)
    for beyond, is_moved in ((1.0, True), (-1.0, False)):
        _, after, _ = reopened(others=gain - needed - beyond)
        assert bool(after.instead_of) == is_moved


def test_drives_and_runs_are_counted_by_the_same_expected_drivers():
    """What others expect of drivers moves what is counted of both alike; held against the old count it would deny."""
    _, after, maker = reopened(law=6.0)
    assert after.baseline.values[2] == maker.asked[0] != VALUES[2]
