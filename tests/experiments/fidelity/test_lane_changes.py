"""Rules of gap acceptance on made-up decisions with known answers, and on the recorded ones where they are at hand."""

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from sklearn.metrics import balanced_accuracy_score, roc_auc_score

from experiments.fidelity.__main__ import show_lane_changes
from experiments.fidelity.gap_rules import GapRule, gap_rules
from experiments.fidelity.lane_changes import ALWAYS, balanced_accuracy, lane_change_table, roc_area, scores
from experiments.fidelity.recorded_decisions import LENGTH_M, TABLE, RecordedDecisions, read_decisions
from experiments.fidelity.roc_figure import write_roc_figure
from tests.places import SHARED_DATA

RULES = {rule.name: rule for rule in gap_rules()}
SITES = np.asarray(["I-80", "US-101"])


def made_up(number: int = 300) -> RecordedDecisions:
    """Return random decisions in which longer gaps and slower followers are taken more often."""
    random = np.random.default_rng(5)
    speed = random.uniform(2.0, 22.0, number)
    follower, leader = (np.clip(speed + random.normal(0.7, 3.0, number), 0.0, None) for _ in range(2))
    follower_m, leader_m = random.uniform(-5.0, 60.0, (2, number))
    odds = 0.08 * (follower_m - 25.0) + 0.4 * (speed - follower) + 0.04 * (leader_m - 25.0)
    leader_m[::17] = np.nan
    return RecordedDecisions(
        site=SITES[np.arange(number) % 2],
        is_accepted=random.uniform(size=number) < 1.0 / (1.0 + np.exp(-odds)),
        speed_mps=speed,
        follower_mps=follower,
        leader_mps=leader,
        own_leader_mps=speed - 1.0,
        follower_m=follower_m,
        leader_m=leader_m,
        own_leader_m=np.full(number, 30.0),
    )


def brake_gap_m(speed_mps: float, deceleration_mps2: float, step_s: float = 0.1) -> float:
    """Return SUMO's braking distance step by step, in Python's double precision."""
    covered = 0.0
    while (speed_mps := speed_mps - deceleration_mps2 * step_s) > 0.0:
        covered += speed_mps * step_s
    return covered


def test_lc2013_with_krauss_goes_where_both_gaps_exceed_sumo_s_secure_gap() -> None:
    decisions = made_up()

    def secure_m(follower_mps: float, leader_mps: float) -> float:
        return max(0.0, brake_gap_m(follower_mps, 4.5) + 1.0 * follower_mps - brake_gap_m(leader_mps, 4.5))

    spare = []
    for speed, follower, leader, behind_m, ahead_m in zip(
        decisions.speed_mps, decisions.follower_mps, decisions.leader_mps, decisions.follower_m, decisions.leader_m,
        strict=True,
    ):  # fmt: skip
        behind = behind_m - LENGTH_M - 2.5 - secure_m(follower, speed)
        ahead = np.inf if np.isnan(ahead_m) else ahead_m - LENGTH_M - 2.5 - secure_m(speed, leader)
        spare.append(min(behind, ahead))
    spare = np.asarray(spare)
    clear = np.abs(spare) > 1e-3
    found = RULES["LC2013, Krauss"].stated(decisions)
    np.testing.assert_array_equal(found[clear], (spare >= 0.0)[clear])
    assert 0.05 < found.mean() < 0.6


@pytest.mark.parametrize("rule", RULES.values(), ids=list(RULES))
def test_a_less_strict_rule_accepts_all_that_a_stricter_one_does(rule: GapRule) -> None:
    goes = rule.at_all_levels(made_up())
    assert (goes[1:] >= goes[:-1]).all()
    assert goes[0].mean() < 0.3
    assert goes[-1].mean() > 0.6
    # the stated rule lies between the two levels beside its value
    stated = float(rule.place(rule.drivers))
    place = int(np.searchsorted(rule.levels * np.sign(rule.levels[-1] - rule.levels[0]),
                                stated * np.sign(rule.levels[-1] - rule.levels[0])))  # fmt: skip
    found = rule.stated(made_up())
    assert (goes[place - 1] <= found).all()
    assert (found <= goes[place]).all()


def test_areas_and_balanced_accuracy_are_those_of_scikit_learn() -> None:
    random = np.random.default_rng(8)
    taken = random.uniform(size=400) < 0.7
    margin = np.round(random.normal(size=400) + taken, 1)  # with ties
    assert roc_area(taken, margin) == pytest.approx(roc_auc_score(taken, margin), abs=1e-12)
    assert balanced_accuracy(taken, margin > 0.4) == pytest.approx(balanced_accuracy_score(taken, margin > 0.4))


def test_a_margin_that_knows_nothing_has_an_interval_around_one_half_and_one_that_knows_all_has_area_1() -> None:
    decisions = made_up()
    number = len(decisions.speed_mps)
    taken = decisions.is_accepted
    even = np.full(number, 0.5)
    blind = scores("blind", decisions, np.random.default_rng(3).normal(size=number), taken, even)
    assert blind["roc_area_interval"][0] < 0.5 < blind["roc_area_interval"][1]
    assert blind["log_loss"] == pytest.approx(np.log(2.0))
    knows = scores("knows", decisions, taken.astype(float), taken, even)
    assert (knows["roc_area"], knows["balanced_accuracy"], knows["true_rate"], knows["false_rate"]) == (1, 1, 1, 0)


def test_on_recorded_decisions_lc2013_is_better_than_always_accept(tmp_path: Path) -> None:
    if not (SHARED_DATA / TABLE).is_file():
        pytest.skip(f"the recordings are not at hand: {SHARED_DATA / TABLE}")
    decisions = read_decisions(SHARED_DATA)
    assert len(decisions.speed_mps) == 2848
    assert decisions.is_accepted.sum() == 2211
    rows = {row["rule"]: row for row in lane_change_table(SHARED_DATA)}
    always = rows[ALWAYS]
    assert (always["accuracy"], always["roc_area"]) == (2211 / 2848, 0.5)
    for name in ("LC2013, Krauss", "LC2013, IDM", "LC2013, W99"):
        assert rows[name]["roc_area_interval"][0] > 0.5
        assert rows[name]["balanced_accuracy_interval"][0] > 0.5
        assert rows[name]["fitted_balanced_accuracy_interval"][0] > 0.5
        assert rows[name]["log_loss"] < always["log_loss"]
    console = Console(record=True, width=160)
    show_lane_changes(console, list(rows.values()))
    assert "2848 recorded lane-change decisions" in console.export_text()
    write_roc_figure(list(rows.values()), tmp_path / "roc.svg")
    assert (tmp_path / "roc.svg").read_text(encoding="utf-8").count("LC2013") == 3
