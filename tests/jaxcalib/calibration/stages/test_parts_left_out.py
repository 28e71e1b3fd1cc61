"""`without` in the settings leaves out a part of the search, and nothing else."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.objective.evidence import independent_evidence
from jaxcalib.calibration.stages import two_stage
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.initial_values.driver_values import DriverEstimate
from jaxcalib.initial_values.initial_point import InitialPoint, without_driver_logs
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.progress import Silent
from tests.jaxcalib.calibration.toy import LAYOUT, SPACE, ToySimulator, toy_objective

BUDGET = Budget(4, 8, 12, 8, 6, 2, 1, 1, 2, 2, 2, 100)
START = SPACE.values_of(np.full((1, 3), 0.5))[0]


def search(
    monkeypatch: pytest.MonkeyPatch, *without: Any, choose: Any = lambda *arguments: toy_objective()
) -> tuple[two_stage.TwoStageResult, Evaluator]:
    monkeypatch.setattr(two_stage, "choose_objective", choose)
    monkeypatch.setattr(two_stage, "evidence_of", lambda initial: independent_evidence(np.full(3, 0.5), np.ones(3)))
    problem: Any = SimpleNamespace(layout=LAYOUT)
    initial: Any = SimpleNamespace(space=SPACE, values=START, unit_error=np.full(3, np.inf))
    evaluator = Evaluator(ToySimulator(), (300.0, 320.0), 50)
    settings = Settings(without=("gradients", *without))
    return two_stage.search_two_stages(problem, initial, evaluator, settings, BUDGET, 1, Silent()), evaluator


def test_parts_left_out_make_no_runs_and_hand_on_where_they_would_have_begun(monkeypatch: pytest.MonkeyPatch):
    whole, all_runs = search(monkeypatch)
    assert whole.saga.rounds
    assert whole.polish.rounds
    assert whole.refinement is None
    no_polish, fewer = search(monkeypatch, "polish")
    assert not no_polish.polish.rounds
    np.testing.assert_array_equal(no_polish.polish.best, no_polish.saga.best)
    np.testing.assert_array_equal(no_polish.saga.best, whole.saga.best)
    neither, fewest = search(monkeypatch, "polish", "saga")
    assert not neither.saga.rounds
    np.testing.assert_array_equal(neither.stage_1.best, whole.stage_1.best)
    assert all_runs.num_runs > fewer.num_runs > fewest.num_runs


def test_stage_2_is_judged_by_a_covariance_from_runs_of_its_own_number(monkeypatch: pytest.MonkeyPatch):
    num_runs = []

    def objective(problem: Any, settings: Any, evidence: Any, runs: np.ndarray) -> Any:
        num_runs.append(len(runs))
        return toy_objective()

    search(monkeypatch, choose=objective)
    assert num_runs == [BUDGET.noise_runs, BUDGET.covariance_runs]


def test_without_logs_drivers_begin_at_the_scenario_and_are_not_known():
    drivers = DriverEstimate(
        np.asarray([0.9, 2.0]), np.asarray([0.1, np.inf]), ("pairs", "scenario"), None, 0, (), lambda theta: theta.sum()
    )
    demand: Any = SimpleNamespace(values_vehph=np.asarray([1500.0]))
    scenario = np.asarray([1400.0, 1.2, 9.0])
    initial = InitialPoint(SPACE, scenario, START, np.asarray([0.2, 0.1, np.inf]), ("volume", "pairs", "scenario"),
                           drivers, demand)  # fmt: skip
    without = without_driver_logs(initial)
    np.testing.assert_allclose(without.values, [START[0], 1.2, 6.0])  # inside the bounds
    np.testing.assert_array_equal(without.unit_error, [0.2, np.inf, np.inf])
    assert without.source == ("volume", "scenario", "scenario")
    assert without.drivers.replay_loss is None
