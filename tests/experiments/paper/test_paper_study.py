"""The study goes on after a kill; the state of the art keeps to its budget; the indices on a function that is known."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from experiments.paper import state_of_the_art, study, trial_runs
from experiments.paper.__main__ import app
from experiments.paper.influence import agreement, influence_figure, influence_table
from experiments.paper.methods import ABLATIONS, IMPROVED, PRINTED, settings_of
from experiments.paper.study import StudyPlan, read_study, run_study
from experiments.paper.trial import Trial
from experiments.paper.trial_runs import Found
from jaxcalib.calibration.objective.accuracy import MOES
from jaxcalib.calibration.stages.evaluator import AllRunsFailedError, Evaluator
from jaxcalib.errors import CaseError
from jaxcalib.problem.settings import Settings
from jaxcalib.runs.progress import Silent
from sim_adapters.interface import ParameterLayout
from tests.jaxcalib.calibration.toy import SPACE, TRUTH, ToySimulator, starts_at, toy_objective


def trial(method: str, pattern: int, repetition: int, seed: int) -> Trial:
    return Trial(
        method=method, pattern=pattern, repetition=repetition, seed=seed, role="held_out",
        errors=dict.fromkeys(MOES, 0.2), floor=dict.fromkeys(MOES, 0.05), vehicle_level=1.0,
        surrogate_runs=10, sumo_runs=0, calibration_s=1.0, parameters={}, critical=[], num_drivers=3,
    )  # fmt: skip


def without_simulators(monkeypatch: pytest.MonkeyPatch, find: Callable[..., Found]) -> None:
    """Let trials be made of what is found by a function, and of errors that are as they are."""
    layout = ParameterLayout(("main",), (("f",),), ("car",), ("tau",))
    monkeypatch.setattr(trial_runs, "read_problem", lambda folder: SimpleNamespace(
        case=SimpleNamespace(name="toy", folder=folder, drives=(), scenario=None), layout=layout))  # fmt: skip
    monkeypatch.setattr(trial_runs, "find_values", find)
    monkeypatch.setattr(trial_runs, "errors_in_sumo", lambda *options: {
        "role": "held_out", "errors": {}, "floor": {}, "vehicle_level": 0.9})  # fmt: skip


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StudyPlan:
    case = tmp_path / "case"
    case.mkdir()
    (case / "case.toml").write_text("")
    problem = SimpleNamespace(case=SimpleNamespace(name="toy", folder=case, drives=(), scenario=None))
    monkeypatch.setattr(study, "read_problem", lambda folder: problem)
    monkeypatch.setattr(study, "prepare_devices", lambda cores: None)
    monkeypatch.setattr(study, "prepare_pattern", lambda problem, number, folder: case)
    return StudyPlan(case, tmp_path / "out", (PRINTED, IMPROVED), (1, 2), 2, 0.1, Settings(), 1)


def test_a_study_goes_on_after_a_kill_and_makes_nothing_twice(plan: StudyPlan, monkeypatch: pytest.MonkeyPatch):
    made: list[tuple] = []

    def find(method: str, problem: Any, run_folder: Any, seed: int, *options: Any) -> Found:
        if len(made) == 3 and "killed" not in made:
            made.append("killed")  # pyright: ignore[reportArgumentType]
            raise KeyboardInterrupt
        made.append((method, seed))
        return Found(np.asarray([1.0, 2.0]), 10, 4, 1.5, ("tau",), False, (0.5, 0.6))

    without_simulators(monkeypatch, find)
    said: list[str] = []
    with pytest.raises(KeyboardInterrupt):
        run_study(plan, lambda name: nullcontext(Silent()), said.append)
    assert len(read_study(plan.out)[1]) == 3  # what there is can be looked at
    trials = run_study(plan, lambda name: nullcontext(Silent()), said.append)
    assert len(trials) == 8
    assert len(made) == 9  # each of eight once, and the kill
    assert {(one.pattern, one.repetition): one.seed for one in trials} == {
        (1, 0): 1, (2, 0): 101, (1, 1): 2, (2, 1): 102,
    }  # fmt: skip
    assert [dict(one.parameters) for one in trials] == [{"main": 1.0, "tau": 2.0}] * 8
    about, kept = read_study(plan.out)
    assert kept == trials
    assert {"versions", "commit", "seeds", "settings", "budget"} <= set(about)
    table = pd.read_parquet(plan.out / "trials.parquet")
    numbers = [name for name in table.columns if table[name].dtype.kind in "if"]
    pd.testing.assert_frame_equal(table[numbers], pd.read_csv(plan.out / "trials.csv")[numbers])
    assert len(table) == 8


def test_a_smaller_selection_drops_nothing_that_was_made(plan: StudyPlan, monkeypatch: pytest.MonkeyPatch):
    without_simulators(monkeypatch, lambda *options: Found(np.ones(2)))
    run_study(plan, lambda name: nullcontext(Silent()), lambda line: None)
    fewer = StudyPlan(plan.case, plan.out, (IMPROVED,), (1,), 1, plan.budget, plan.settings, 1)
    assert len(run_study(fewer, lambda name: nullcontext(Silent()), lambda line: None)) == 8
    about, kept = read_study(plan.out)
    assert (len(kept), set(about["methods"]), about["repetitions"]) == (8, {PRINTED, IMPROVED}, 2)


def test_a_trial_whose_runs_fail_is_told_and_the_others_are_made(plan: StudyPlan, monkeypatch: pytest.MonkeyPatch):
    def run(method: str, pattern: int, repetition: int, *rest: Any, seed: int, **options: Any) -> Any:
        if (method, pattern, repetition) == (PRINTED, 2, 0):
            raise AllRunsFailedError("the entrance was full", "")
        return trial(method, pattern, repetition, seed)

    monkeypatch.setattr(study, "run_trial", run)
    said: list[str] = []
    assert len(run_study(plan, lambda name: nullcontext(Silent()), said.append)) == 7
    assert [line for line in said if "no result" in line] == [
        f"pattern-2/repetition-0/{PRINTED}: no result, the entrance was full"
    ]
    assert read_study(plan.out)[0]["failed"] == [f"pattern-2/repetition-0/{PRINTED}"]


def test_a_study_of_another_budget_is_refused(plan: StudyPlan, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(study, "run_trial", lambda method, pattern, repetition, *rest, seed, **options: trial(
        method, pattern, repetition, seed))  # fmt: skip
    run_study(plan, lambda name: nullcontext(Silent()), lambda line: None)
    other = StudyPlan(plan.case, plan.out, plan.methods, plan.patterns, 1, 0.2, plan.settings, 1)
    with pytest.raises(CaseError, match="options"):
        run_study(other, lambda name: nullcontext(Silent()), lambda line: None)


def test_the_state_of_the_art_keeps_to_its_runs_and_finds_the_truth(monkeypatch: pytest.MonkeyPatch):
    objective = toy_objective()
    known = SimpleNamespace(
        accuracy=lambda pooled: 1.0 - np.sqrt(np.mean((objective.moments.values(pooled) / objective.field - 1) ** 2, 1))
    )
    monkeypatch.setattr(state_of_the_art, "volumes_and_speeds", lambda problem: known)
    evaluator = Evaluator(ToySimulator(), starts_at(300.0, 320.0), 50)
    problem: Any = None
    best = state_of_the_art.search(
        problem, SPACE, np.full(3, 0.5), evaluator, 4, 8000, None, 3, lambda accuracy: None
    )  # fmt: skip
    assert 7000 < evaluator.num_runs <= 8000 + 20 * 4
    assert best == pytest.approx(TRUTH, abs=0.2)
    early = Evaluator(ToySimulator(), starts_at(300.0, 320.0), 50)
    state_of_the_art.search(problem, SPACE, np.full(3, 0.5), early, 4, 8000, 0.5, 3, lambda accuracy: None)
    assert early.num_runs < 300  # the threshold ends it


def test_indices_of_a_linear_function_are_known():
    """f = 3 a + b: shares of the variance 0.9 and 0.1; Morris' mu* is the slope; the range the slope, levels 0 to 1."""
    weights = np.asarray([0.0, 3.0, 1.0, 0.0])
    table, cost = influence_table(lambda points: points @ weights - 2.0, ["x", "a", "b", "y"], 10, 256, 1, 2)
    np.testing.assert_allclose(table["range"], weights, atol=1e-9)
    np.testing.assert_allclose(table["morris_mu_star"], weights, atol=1e-9)
    np.testing.assert_allclose(table["sobol_total"], [0.0, 0.9, 0.1, 0.0], atol=0.03)
    assert table.loc[table["is_critical"], "parameter"].tolist() == ["a", "b"]
    assert cost == {"range": 16, "morris": 50, "sobol": 256 * 6}
    found = agreement(table, 2)
    assert found["similarity_with_sobol_total"] == 1.0
    assert found["similarity_by_chance"] == 0.5
    assert "<svg" in influence_figure(table)


def test_failed_candidates_do_not_spoil_the_indices():
    def partly(points: np.ndarray) -> np.ndarray:
        return np.where(points[:, 0] > 0.9, np.nan, points[:, 0])

    table, _ = influence_table(partly, ["a", "b", "c"], 6, 32, 0, 1)
    assert np.isfinite(table["sobol_total"]).all()


def test_settings_of_the_methods():
    common = Settings(bounds={"tau": (0.5, 2.0)})
    printed = settings_of(PRINTED, common)
    assert (printed.literal, printed.objective, printed.accuracy_threshold) == (True, "paper", 0.8)
    assert printed.bounds == common.bounds
    assert settings_of(IMPROVED, common) == common
    assert len({repr(settings_of(name, common)) for name in ABLATIONS} | {repr(common)}) == len(ABLATIONS) + 1


def test_wrong_methods_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    code = app(
        ["evaluate-nothing-here", "--out", str(tmp_path / "out"), "--method", "best"], result_action="return_value"
    )
    assert code == 2
    assert "no_calibration, state_of_the_art, printed, improved" in capsys.readouterr().err
