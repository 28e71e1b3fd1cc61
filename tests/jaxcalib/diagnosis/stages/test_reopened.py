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
from jaxcalib.diagnosis.inference.marginal_likelihood import Explained
from jaxcalib.diagnosis.inference.sumo_check import Checked
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import BASELINE, Trial
from jaxcalib.diagnosis.stages.judged import Judged
from jaxcalib.diagnosis.stages.reopened import reopen_silent_values
from jaxcalib.diagnosis.stages.simulated import Simulated
from jaxcalib.runs.stopwatch import Stopwatch

NUM_FEATURES, NUM_FIELD, NUM_NULL = 24, 8, 48
CELLS = tuple(Cell(Channel.CLOSED_LOOP, f"measure {k}") for k in range(NUM_FEATURES))
ANSWER = np.random.default_rng(5).normal(1.0, 0.3, NUM_FEATURES)  # of features to the silent value, per unit
NAMES = ("main", "tau", "lcSpeedGain")
VALUES = np.asarray([3000.0, 1.2, 1.0])  # of an inflow, of a time gap, and of a weight that the logs do not show
BOUNDS = np.asarray([2500.0, 1.1, 0.2]), np.asarray([3500.0, 1.3, 5.0])
FIRST_SLOPE_RUNS, SILENT_RUNS, LOOK_RUNS = 12, 8, 40

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

    def __init__(self, is_silent: bool, sumo: Road | None) -> None:
        self.error = np.asarray([100.0, 0.02, np.inf if is_silent else 0.1])
        self.bounds = BOUNDS
        self.begin = VALUES
        self.sumo = sumo
        self.asked: list[float] = []

    def at(self, values: np.ndarray, runner: Any) -> Baseline:
        self.asked.append(float(values[2]))
        if self.sumo is None:
            raise AllRunsFailedError("the values failed in SUMO", "")
        return baseline_at(values, self.sumo)

    def whole(self, first: Baseline) -> Baseline:
        return first


def baseline_at(values: np.ndarray, sumo: Road) -> Baseline:
    plain = drives(float(values[2]), NUM_NULL, 1, sumo)
    nothing = np.zeros((NUM_FEATURES, 1))
    below = np.full(NUM_FEATURES, float(NUM_FIELD))
    null: NullModel = null_model(CELLS, below, plain, nothing, nothing, np.ones(1), None, NUM_FIELD)
    field = drives(3.4, NUM_FIELD, 2)
    fitted = SimpleNamespace(null=null, difference=null.standardised(field.values()), tallies=field)
    in_sumo = SimpleNamespace(default=lambda: None)
    made = SimpleNamespace(
        values=values, fitted=fitted, runs=SimpleNamespace(plain=plain), runner=None, in_sumo=in_sumo
    )
    return cast(Baseline, made)


def reopened(
    verdict: str = "unknown",
    is_silent: bool = True,
    surrogate: Road = as_it_is,
    sumo: Road | None = as_it_is,
    others: float = 20.0,
) -> tuple[Simulated, Simulated, Maker]:
    """Return the simulation before and after, and what made it."""
    maker = Maker(is_silent, sumo)
    before = Simulated(cast(BaselineMaker, maker), Converged(baseline_at(VALUES, as_it_is), 1, 0), None)
    known = {BASELINE: drives(1.0, SILENT_RUNS, 9, surrogate)}
    book = TrialBook(cast(Any, Runner(surrogate)), FinishedParts(None), "", known, lambda number: None)
    explained = [Explained("unknown", -100.0 + others), Explained("none", -100.0)]
    checked = Checked(explained, {}, (), LOOK_RUNS)
    plan = SimpleNamespace(first_slope_runs=FIRST_SLOPE_RUNS, silent_runs=SILENT_RUNS)
    session = cast(Any, SimpleNamespace(seed=0, plan=plan, stopwatch=Stopwatch(lambda: 0.0)))
    judged = cast(Judged, SimpleNamespace(verdict=SimpleNamespace(kind=verdict), grounds=SimpleNamespace(pairs=None)))
    return before, reopen_silent_values(session, before, book, checked, judged), maker


def test_a_silent_value_that_explains_the_drives_is_moved_there():
    before, after, maker = reopened()
    assert after.baseline is not before.baseline
    np.testing.assert_array_equal(after.baseline.values[:2], VALUES[:2])
    assert after.baseline.values[2] == pytest.approx(3.4, abs=0.6)  # of eight values between 0.2 and 5
    assert maker.asked == [after.baseline.values[2]]
    assert (before.moved(NAMES), after.moved(NAMES)) == ([], ["lcSpeedGain"])
    assert after.converged.num_baselines == 2
    assert after.converged.num_sumo_runs == LOOK_RUNS
    assert after.converged.num_surrogate_runs == SILENT_RUNS * 9  # the baseline's, and eight values


def test_a_value_that_logs_show_is_not_told_as_one_that_they_do_not():
    _, after, maker = reopened()
    elsewhere = baseline_at(after.baseline.values * [1.0, 1.1, 1.0], as_it_is)
    found = Simulated(cast(BaselineMaker, maker), Converged(elsewhere, 1, 0), None)
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
    assert after is before
    assert maker.asked == []


@pytest.mark.parametrize(
    ("sumo", "others"),
    [
        (lambda weight: 1.0, 20.0),  # SUMO does not say so
        (None, 20.0),  # its runs fail there
        (as_it_is, 1e6),  # another explanation is better
    ],
)
def test_sumo_has_the_last_word(sumo: Road | None, others: float):
    before, after, maker = reopened(sumo=sumo, others=others)
    assert len(maker.asked) == 1
    assert after.baseline is before.baseline
    assert after.converged.num_baselines == 2
    assert after.converged.num_surrogate_runs == 7 * FIRST_SLOPE_RUNS
    assert after.converged.num_sumo_runs == 0
