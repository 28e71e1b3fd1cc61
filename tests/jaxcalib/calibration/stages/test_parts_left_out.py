"""`without` in the settings leaves out a part of the search, and nothing else."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from jaxcalib.calibration.objective.evidence import independent_evidence
from jaxcalib.calibration.stages import two_stage
from jaxcalib.calibration.stages.budget import Budget
from jaxcalib.calibration.stages.evaluator import Evaluator
from jaxcalib.errors import CaseError
from jaxcalib.initial_values.driver_values import DriverEstimate
from jaxcalib.initial_values.initial_point import InitialPoint, without_driver_logs
from jaxcalib.problem.settings import Settings, read_settings
from jaxcalib.runs.session import open_session
from jaxcalib.search.evaluation import SearchStatus
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told
from jaxcalib.search.registry import OPTIMISERS
from tests.jaxcalib.calibration.toy import LAYOUT, SPACE, TRUTH, ToySimulator, starts_at, toy_objective

BUDGET = Budget(4, 8, 12, 8, 32, 1, 1, 2, 2, 2, 0, 100)
START = SPACE.values_of(np.full((1, 3), 0.5))[0]


def search(
    monkeypatch: pytest.MonkeyPatch,
    *without: Any,
    choose: Any = lambda *arguments: toy_objective(),
    scenario_values: np.ndarray = START,
    **options: Any,
) -> tuple[two_stage.TwoStageResult, Evaluator]:
    monkeypatch.setattr(two_stage, "choose_objective", choose)
    monkeypatch.setattr(two_stage, "evidence_of", lambda initial: independent_evidence(np.full(3, 0.5), np.ones(3)))
    problem: Any = SimpleNamespace(layout=LAYOUT)
    initial: Any = SimpleNamespace(
        space=SPACE, values=START, scenario_values=scenario_values, unit_error=np.full(3, np.inf)
    )
    evaluator = Evaluator(ToySimulator(), starts_at(300.0, 320.0), 50)
    settings = Settings(without=("gradients", *without), **options)
    with open_session(None, {}, seed=1) as session:
        return two_stage.search_two_stages(problem, initial, evaluator, settings, BUDGET, session), evaluator


def test_parts_left_out_make_no_runs_and_hand_on_where_they_would_have_begun(monkeypatch: pytest.MonkeyPatch):
    whole, all_runs = search(monkeypatch)
    assert whole.optimised.rounds
    assert whole.polish.rounds
    assert whole.refinement is None
    no_polish, fewer = search(monkeypatch, "polish")
    assert not no_polish.polish.rounds
    np.testing.assert_array_equal(no_polish.polish.best, no_polish.optimised.best)
    np.testing.assert_array_equal(no_polish.optimised.best, whole.optimised.best)
    neither, fewest = search(monkeypatch, "polish", "optimiser")
    assert not neither.optimised.rounds
    np.testing.assert_array_equal(neither.stage_1.best, whole.stage_1.best)
    assert all_runs.num_runs > fewer.num_runs > fewest.num_runs


def test_no_search_ends_with_less_than_the_scenario_as_it_is(monkeypatch: pytest.MonkeyPatch):
    truth = SPACE.values_of(TRUTH[None])[0]
    found, _ = search(monkeypatch, "polish", "optimiser", scenario_values=truth)
    compared = found.judged[-1]
    np.testing.assert_allclose(compared.unit[-1], TRUTH, atol=1e-4)
    chosen = np.flatnonzero((compared.unit == found.best).all(axis=1))[0]
    assert compared.accuracy[chosen] >= compared.accuracy[-1]
    tried = found.stage_1.shortlist.unit
    assert np.isclose(tried[:, 0], TRUTH[0], atol=1e-4).any()  # its inflow, with the drivers where the search begins


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


def test_the_optimiser_of_stage_2_is_the_one_of_the_registry_that_the_settings_name(monkeypatch: pytest.MonkeyPatch):
    """One that a line adds to the registry is asked for the critical parameters and the inputs."""
    asked: list[Setting] = []

    class Planted(Optimiser):
        """Asks for one point."""

        def init(self, setting: Setting) -> Setting:
            """Return the first state."""
            asked.append(setting)
            return setting

        def ask(self, state: Setting) -> np.ndarray:
            """Return a point of the box."""
            return np.full((1, state.num_parameters), 0.37)

        def tell(self, state: Setting, told: Told) -> tuple[Setting, RoundInfo]:
            """End the search."""
            return state, RoundInfo(0, SearchStatus.CONVERGED)

    monkeypatch.setitem(OPTIMISERS, "planted", Planted)
    found, _ = search(monkeypatch, "polish", optimiser="planted")
    (setting,) = asked
    assert setting.num_parameters == 3
    assert setting.num_evaluations == BUDGET.num_evaluations
    assert setting.known is not None
    assert len(setting.known.points) > 9  # the cases of the screening, and its shortlist
    assert [len(one.unit) for one in found.optimised.rounds[:1]] == [1]  # it ended the search after one candidate
    assert found.optimised.infos[0].status is SearchStatus.CONVERGED


def test_an_unknown_optimiser_is_refused_with_those_that_are_known(tmp_path: Path):
    with pytest.raises(ValueError, match=r"trust_region, saga"):
        Settings(optimiser="simulated_annealing")
    file = tmp_path / "settings.toml"
    file.write_text('optimiser = "simulated_annealing"')
    with pytest.raises(CaseError, match=r"expected an optimiser of trust_region, saga.*simulated_annealing"):
        read_settings(file)
    file.write_text('optimiser = "saga"')
    assert read_settings(file).stage_2_optimiser == "saga"
    assert Settings(literal=True).stage_2_optimiser == "saga_literal"


@pytest.mark.parametrize("name", OPTIMISERS)
def test_every_optimiser_calibrates_the_toy(monkeypatch: pytest.MonkeyPatch, name: str):
    found, _ = search(monkeypatch, optimiser=name)
    assert np.abs(found.best - TRUTH).max() < 0.2


def test_stage_2_searches_the_inputs_beside_the_drivers_unless_as_printed(monkeypatch: pytest.MonkeyPatch):
    found, _ = search(monkeypatch)
    assert sorted(found.exploration.box.chosen) == [0, 1, 2]
    assert set(found.critical) <= {1, 2}, "an input is no driver parameter, however much it matters"
    assert len({unit[0] for judged in found.optimised.rounds for unit in judged.unit}) > 1
    printed, _ = search(monkeypatch, literal=True)
    assert sorted(printed.exploration.box.chosen) == [1, 2]
    inputs = {unit[0] for judged in printed.optimised.rounds for unit in judged.unit}
    assert inputs == {printed.stage_1.best[0]}


def test_the_inputs_are_screened_around_what_the_logs_say_not_around_stage_1(monkeypatch: pytest.MonkeyPatch):
    found, _ = search(monkeypatch)
    box = found.exploration.box
    (place,) = np.flatnonzero(box.chosen == 0)
    middle = (box.lower + box.upper)[place] / 2.0
    assert middle == pytest.approx(SPACE.unit_of(START)[0])
    assert middle != pytest.approx(found.stage_1.best[0], abs=0.01)
