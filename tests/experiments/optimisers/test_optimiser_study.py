"""The study: budgets, journals, resuming, ranks, and its command."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import friedmanchisquare, wilcoxon

from experiments.optimisers.__main__ import app
from experiments.optimisers.course import Budget, run_course
from experiments.optimisers.known_functions import FunctionProblem
from experiments.optimisers.ranking import all_rank_tables, rank_table, summary_table
from experiments.optimisers.registry import OPTIMISERS
from jaxcalib.errors import CaseError
from jaxcalib.search.optimiser import Optimiser, RoundInfo, Setting, Told, info_of

PROBLEM = FunctionProblem("rosenbrock", "failing", 3, 6)
BUDGET = Budget(60)


class KilledError(RuntimeError):
    """Stands for a kill."""


class DiesAfter(FunctionProblem):
    """Evaluates so many candidates, then is killed."""

    most = 30

    def evaluate(self, points: np.ndarray, first: int) -> Told:
        if first >= self.most:
            raise KilledError
        return super().evaluate(points, first)


def without_times(rows: list[dict]) -> list[dict]:
    return [{key: value for key, value in row.items() if not key.endswith("_s")} for row in rows]


def rounds_in(journal: Path) -> list[Path]:
    return sorted(journal.glob("round-*.json"))


@pytest.mark.parametrize("name", ["saga", "cma_es", "tpe", "saga_polish"])
def test_a_killed_course_goes_on_to_the_same_result(name: str, tmp_path: Path):
    whole = run_course(name, OPTIMISERS[name], PROBLEM, BUDGET, tmp_path / "whole")
    journal = tmp_path / "killed"
    with pytest.raises(KilledError):
        run_course(name, OPTIMISERS[name], DiesAfter("rosenbrock", "failing", 3, 6), BUDGET, journal)
    num_rounds = len(rounds_in(journal))
    (journal / ".round-000009.json.0a1b.draft").write_text('{"points": [[0.1')  # the kill came while it was written
    evaluated = []

    class Counts(FunctionProblem):
        def evaluate(self, points: np.ndarray, first: int) -> Told:
            evaluated.append(first)
            return super().evaluate(points, first)

    resumed = run_course(name, OPTIMISERS[name], Counts("rosenbrock", "failing", 3, 6), BUDGET, journal)
    assert without_times(resumed) == without_times(whole)
    assert min(evaluated) >= 30 > 0
    assert len(rounds_in(journal)) == num_rounds + len(evaluated)


def test_a_damaged_round_is_evaluated_again_and_the_later_ones_stay(tmp_path: Path):
    whole = run_course("cma_es", OPTIMISERS["cma_es"], PROBLEM, BUDGET, tmp_path / "a")
    damaged = rounds_in(tmp_path / "a")[2]
    damaged.write_text(damaged.read_text()[:40])
    (tmp_path / "a" / "rows.json").unlink()
    evaluated = []

    class Counts(FunctionProblem):
        def evaluate(self, points: np.ndarray, first: int) -> Told:
            evaluated.append(first)
            return super().evaluate(points, first)

    again = run_course("cma_es", OPTIMISERS["cma_es"], Counts("rosenbrock", "failing", 3, 6), BUDGET, tmp_path / "a")
    assert without_times(again) == without_times(whole)
    assert len(evaluated) == 1


def test_a_finished_course_is_not_searched_again(tmp_path: Path):
    rows = run_course("random", OPTIMISERS["random"], PROBLEM, BUDGET, tmp_path / "a")

    def fails() -> Optimiser:
        raise AssertionError

    assert run_course("random", fails, PROBLEM, BUDGET, tmp_path / "a") == rows


def test_a_journal_of_another_optimiser_is_refused(tmp_path: Path):
    journal = tmp_path / "a"
    run_course("random", OPTIMISERS["random"], PROBLEM, BUDGET, journal)
    (journal / "rows.json").unlink()
    with pytest.raises(CaseError, match="begin anew"):
        run_course("sobol", OPTIMISERS["sobol"], PROBLEM, BUDGET, journal)


def test_the_budget_is_kept_and_failures_never_win(tmp_path: Path):
    rows = run_course("random", OPTIMISERS["random"], PROBLEM, Budget(61), tmp_path / "a")
    told = [json.loads(file.read_text()) for file in rounds_in(tmp_path / "a")]
    accuracy = np.concatenate([one["accuracy"] for one in told])
    assert len(accuracy) == 61
    assert rows[-1]["num_evaluated"] == 61
    assert rows[-1]["num_failed_in_all"] == np.isnan(accuracy).sum() > 0
    assert rows[-1]["accuracy_seen"] == np.nanmax(accuracy)
    errors = [row["error"] for row in rows]
    assert errors == sorted(errors, reverse=True)  # without noise the best seen is the best


def test_equal_time_ends_by_the_clock_of_optimiser_and_evaluations(tmp_path: Path):
    now = [0.0]

    class TakesTime(FunctionProblem):
        def evaluate(self, points: np.ndarray, first: int) -> Told:
            now[0] += 2.0
            return super().evaluate(points, first)

    class Thinks(Optimiser):
        def init(self, setting: Setting) -> int:
            return 0

        def ask(self, state: int) -> np.ndarray:
            now[0] += 1.0
            return np.full((4, 3), 0.2 + 0.01 * state)

        def tell(self, state: int, told: Told) -> tuple[int, RoundInfo]:
            return state + 1, info_of(told)

    problem = TakesTime("sphere", "exact", 3, 1)
    rows = run_course("thinks", Thinks, problem, Budget(1000, 10.0), tmp_path / "a", lambda: now[0])
    # The start takes 2 s; each further round 1 s to ask and 2 s to evaluate: 2, 5, 8 and 11 s, the last of which began
    # before the end but counts no more.
    assert rows[-1]["num_evaluated"] == 9
    assert (rows[-1]["optimiser_s"], rows[-1]["evaluation_s"]) == (2.0, 6.0)
    assert {row["budget"] for row in rows} == {"wall_time"}


def test_ranks_are_those_of_scipy_and_the_clear_winner_is_first():
    random = np.random.default_rng(4)
    errors = random.random((12, 3)) + np.asarray([0.0, 2.0, 0.9])
    table = rank_table(pd.DataFrame(errors, columns=["best", "worst", "middle"]))
    assert table["optimiser"].tolist() == ["best", "middle", "worst"]
    assert table["friedman_p"].iloc[0] == pytest.approx(friedmanchisquare(*errors.T).pvalue)
    expected = wilcoxon(errors[:, 1] - errors[:, 0]).pvalue
    assert table["p_value"].iloc[2] == pytest.approx(2.0 * expected)
    assert np.isnan(table["p_value"].iloc[0])


def test_a_search_without_a_result_ranks_last():
    rows = pd.DataFrame(
        [
            {"problem": "p", "budget": "simulations", "share": 1.0, "optimiser": name, "seed": seed, "error": error,
             "num_evaluated": 9, "optimiser_s": 0.0, "evaluation_s": 0.0}
            for seed in range(4)
            for name, error in (("a", 0.5), ("b", None), ("c", 0.4 + 0.1 * seed))
        ]
    )  # fmt: skip
    ranks = all_rank_tables(rows)
    assert ranks["optimiser"].iloc[-1] == "b"
    summary = summary_table(rows).set_index("optimiser")
    assert summary.loc["b", "median"] == np.inf
    assert summary.loc["c", "low"] <= summary.loc["c", "median"] <= summary.loc["c", "high"]


def run(*arguments: str) -> int:
    return app(list(arguments), exit_on_error=False, result_action="return_value")


def test_the_command_writes_tables_figures_and_provenance_and_resumes(tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "study"
    options = ["--out", str(out), "--optimiser", "random", "--optimiser", "sobol", "--optimiser", "trust_region",
               "--seeds", "3", "--evaluations", "16", "--dimensions", "2"]  # fmt: skip
    assert run(*options) == 0
    rows = pd.read_parquet(out / "rows.parquet")
    assert len(rows) == 12 * 3 * 3 * 4
    assert rows.groupby(["problem", "optimiser", "seed", "share"]).size().eq(1).all()
    study = json.loads((out / "study.json").read_text())
    assert study["configuration"]["seeds"] == [0, 1, 2]
    assert study["versions"]["optuna"]
    assert "commit" in study
    for name in ("error_against_simulations.svg", "ranks_simulations.svg"):
        assert (out / name).read_text().startswith("<?xml")
    assert run(*options) == 2
    assert "--resume" in capsys.readouterr().err
    assert run(*options, "--resume") == 0
    pd.testing.assert_frame_equal(pd.read_parquet(out / "rows.parquet"), rows)
    options[options.index("3")] = "4"  # more seeds
    assert run(*options, "--resume") == 0
    assert len(pd.read_parquet(out / "rows.parquet")) == 12 * 3 * 4 * 4
    assert run(*options, "--resume", "--batch", "4") == 2
    assert "batch" in capsys.readouterr().err


def test_an_unknown_optimiser_is_refused_with_the_known_ones(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert run("--out", str(tmp_path / "study"), "--optimiser", "simulated_annealing") == 2
    message = capsys.readouterr().err
    assert all(name in message for name in OPTIMISERS)
    assert not (tmp_path / "study").exists()


@pytest.mark.long
@pytest.mark.usefixtures("small_surrogate")  # the same program
def test_a_case_is_searched_in_the_surrogate_and_measured_on_fresh_seeds(small_case: Path, tmp_path: Path):
    out = tmp_path / "study"
    options = ["--no-functions", "--seeds", "1", "--evaluations", "12", "--batch", "4", "--optimiser", "random"]
    assert run(str(small_case), *options, "--out", str(out)) == 0
    rows = pd.read_parquet(out / "rows.parquet")
    assert rows["num_evaluated"].tolist() == [1, 3, 6, 12]
    assert rows["accuracy_seen"].is_monotonic_increasing
    assert ((rows["error"] > 0.0) & (rows["error_fit"] > 0.0)).all()
