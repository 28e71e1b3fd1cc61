"""Tables and figures from hand-made trials."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pytest

from experiments.paper.comparison import PAPER_FIGURES, by_pattern_table, comparison_table, summary_table
from experiments.paper.figures import all_figures
from experiments.paper.report import write_report
from experiments.paper.study import STUDY_FILE, read_parts, read_study
from experiments.paper.trial import TRIAL_FILE, Trial, read_trial, table_of, trial_json
from jaxcalib.calibration.objective.accuracy import MOES, VEHICLE_LEVEL
from jaxcalib.errors import CaseError

LEVEL = {"no_calibration": 0.4, "state_of_the_art": 0.3, "printed": 0.2, "improved": 0.1}
CRITICAL = {1: ["tau", "accel"], 2: ["tau", "minGap"], 3: ["decel", "minGap"]}


def trial(method: str, pattern: int, repetition: int = 0) -> Trial:
    errors: dict[str, float | None] = {name: LEVEL[method] + 0.01 * repetition for name in MOES}
    errors["cut_ins"] = None
    has_stages = method in ("printed", "improved")
    return Trial(
        method=method,
        pattern=pattern,
        repetition=repetition,
        seed=pattern,
        role="held_out",
        errors=errors,
        floor=dict.fromkeys(MOES, 0.05),
        vehicle_level=sum(errors[name] or 0.0 for name in VEHICLE_LEVEL),
        surrogate_runs=0 if method == "no_calibration" else 1000,
        sumo_runs=8 if has_stages else 0,
        calibration_s={"improved": 100.0 * pattern, "state_of_the_art": 400.0}.get(method, 0.0),
        parameters={"main": 4000.0},
        critical=CRITICAL[pattern] if has_stages else [],
        num_drivers=4,
        stage2_undid_stage1=pattern == 1 if has_stages else None,
    )


@pytest.fixture
def trials() -> list[Trial]:
    return [trial(method, pattern) for pattern in CRITICAL for method in LEVEL]


def value(table: pd.DataFrame, words: str, column: str) -> float:
    rows = table[table["figure"].str.contains(words, regex=False)]
    assert len(rows) == 1
    return rows[column].iloc[0]


def test_comparison_by_hand(trials: list[Trial]):
    table = comparison_table(trials)
    assert len(table) == len(PAPER_FIGURES)
    assert (table["note"] != "").all()
    # four vehicle-level errors of 0.1 against four of 0.3 and of 0.4
    assert value(table, "(Eq. 23), change against the state", "improved") == pytest.approx(-66.67)
    assert value(table, "(Eq. 23), change against no", "improved") == pytest.approx(-75.0)
    assert value(table, "(Eq. 23), change against no", "printed") == pytest.approx(-50.0)
    assert value(table, "nine errors, change against the state", "improved") == pytest.approx(-66.67)
    assert value(table, "largest error", "improved") == pytest.approx(10.0)
    assert value(table, "calibration time, change", "improved") == pytest.approx(-50.0)  # 200 s of 400 s
    assert value(table, "standard deviation of the calibration time", "improved") == pytest.approx(100.0 / 3600, 1e-3)
    assert value(table, "Stage 2 undid", "improved") == pytest.approx(33.33)


def test_similarity_stands_beside_chance(trials: list[Trial]):
    table = comparison_table(trials)
    # {tau, accel}, {tau, minGap}, {decel, minGap}: 0.5, 0, 0.5; two of four by chance: 5 of 6 pairs share one or more
    for words in ("0.3 or more", "0.5 or more"):
        assert value(table, words, "improved") == pytest.approx(66.67)
        assert value(table, words, "chance") == pytest.approx(83.33)


def test_interval_contains_the_value_and_needs_three_pairs():
    few = [trial(method, 1, repetition) for repetition in range(2) for method in LEVEL]
    assert np.isnan(value(comparison_table(few), "(Eq. 23), change against no", "improved_low") or np.nan)
    many = [trial(method, 1, repetition) for repetition in range(6) for method in LEVEL]
    table = comparison_table(many)
    low, high = (value(table, "(Eq. 23), change against no", f"improved_{side}") for side in ("low", "high"))
    assert low < value(table, "(Eq. 23), change against no", "improved") < high


def test_the_interval_is_that_of_patterns_for_repetitions_share_a_field():
    """Three patterns: the mean is off by chance as three are, however often each is repeated."""
    once = [trial(method, pattern) for pattern in CRITICAL for method in LEVEL]
    level = {1: 0.1, 2: 0.4, 3: 0.9}
    once = [
        msgspec.structs.replace(one, vehicle_level=level[one.pattern]) if one.method == "improved" else one
        for one in once
    ]
    often = [msgspec.structs.replace(one, repetition=number) for number in range(5) for one in once]
    columns = [f"improved{side}" for side in ("", "_low", "_high")]
    rows = [
        [value(comparison_table(made), "(Eq. 23), change against no", name) for name in columns]
        for made in (once, often)
    ]
    assert rows[0] == rows[1]
    # 1 of 27 draws has pattern 1 three times, 3 more have it twice and pattern 2; so it is at the other end
    low, high = (0.1 + 0.1 + 0.4) / 3.0, (0.9 + 0.9 + 0.4) / 3.0
    assert rows[0][1:] == pytest.approx([100.0 * (level - 1.6) / 1.6 for level in (low, high)], abs=0.01)


def test_means_are_over_what_every_method_has_made(trials: list[Trial]):
    """A hard pattern that one method has not met yet must not stand against the others alone."""
    hard = msgspec.structs.replace(trial("improved", 1, 1), vehicle_level=50.0)
    assert summary_table([*trials, hard]).equals(summary_table(trials))
    alone = [trial("improved", 1), trial("printed", 2)]
    assert len(summary_table(alone)) == len(summary_table(trials))


def test_each_pattern_has_its_row_beside_chance(trials: list[Trial]):
    more = [*trials, msgspec.structs.replace(trial("improved", 2, 1), vehicle_level=1.0)]
    table = by_pattern_table(more).set_index("pattern")
    assert table.index.tolist() == ["1 own field", "2 light", "3 heavy"]
    assert table.loc["2 light", "method as improved"] == pytest.approx((0.4 + 1.0) / 2.0)
    assert table.loc["3 heavy", "no calibration"] == pytest.approx(1.6)
    assert table.loc["3 heavy", "noise floor"] == pytest.approx(len(VEHICLE_LEVEL) * 0.05)


def test_parts_of_a_study_are_one(trials: list[Trial], tmp_path: Path):
    about: dict[str, Any] = {
        "case": "road", "budget": 1.0, "settings": {}, "versions": {}, "commit": "1", "failed": [], "methods": [],
        "repetitions": 1,
    }  # fmt: skip
    for name, numbers in (("one", (1, 3)), ("other", (2,))):
        (tmp_path / name).mkdir()
        patterns = [{"pattern": number} for number in numbers]
        kept = msgspec.to_builtins([one for one in trials if one.pattern in numbers])
        text = msgspec.json.encode(about | {"patterns": patterns, "trials": kept, "failed": [f"of {name}"]})
        (tmp_path / name / STUDY_FILE).write_bytes(text)
    folders = (tmp_path / "one", tmp_path / "other")
    joined, all_trials = read_parts(folders)
    assert sorted(all_trials, key=repr) == sorted(trials, key=repr)
    assert [one["pattern"] for one in joined["patterns"]] == [1, 2, 3]
    assert (set(joined["methods"]), joined["failed"]) == (set(LEVEL), ["of one", "of other"])
    assert write_report(folders[0], folders[1:]).count("3 heavy") == 1
    changed = json.loads((folders[1] / STUDY_FILE).read_text()) | {"budget": 0.5}
    (folders[1] / STUDY_FILE).write_text(json.dumps(changed))
    with pytest.raises(CaseError, match="budget"):
        read_parts(folders)


def test_a_missing_method_leaves_its_numbers_out(trials: list[Trial]):
    some = [one for one in trials if one.method in ("no_calibration", "improved")]
    table = comparison_table(some)
    assert pd.isna(value(table, "(Eq. 23), change against the state", "improved"))
    assert value(table, "(Eq. 23), change against no", "improved") == pytest.approx(-75.0)
    assert {"figure_08_vehicle_level", "figure_10_improvements"} <= set(all_figures(some))


def test_summary_has_every_error_cost_and_the_floor(trials: list[Trial]):
    table = summary_table(trials).set_index("measure")
    assert table.loc["traffic_speed", "method as improved"] == pytest.approx(0.1)
    assert pd.isna(table.loc["cut_ins", "method as improved"])
    assert table.loc["vehicle_level", "no calibration"] == pytest.approx(1.6)
    assert table.loc["traffic_speed", "noise floor"] == pytest.approx(0.05)
    assert table.loc["surrogate_runs", "state of the art"] == 1000


def test_all_seven_figures_are_drawn_from_data_alone(trials: list[Trial], tmp_path: Path):
    table = table_of(trials)
    assert len(table) == len(trials)
    about = {"budget": 1.0, "trials": [msgspec.to_builtins(one) for one in trials]}
    (tmp_path / STUDY_FILE).write_bytes(msgspec.json.encode(about))
    text = write_report(tmp_path)
    drawn = sorted(file.name[:9] for file in tmp_path.glob("figure_*.svg"))
    assert drawn == [f"figure_{number:02d}" for number in range(7, 14)]
    assert all("<svg" in file.read_text() for file in tmp_path.glob("figure_*.svg"))
    assert "-83.53" in text
    assert read_study(tmp_path)[1] == trials


def test_an_ablation_tells_what_each_part_buys(trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Without logs the vehicle level is 0.8 on patterns 1 and 2; the whole method has 0.4 there, on the third 0.44."""
    whole = [trial("improved", pattern, int(pattern == 3)) for pattern in CRITICAL]
    parts = [msgspec.structs.replace(trial("printed", n), method="without_logs") for n in (1, 2)]
    about = {"case": "road", "patterns": [{"pattern": n} for n in CRITICAL], "repetitions": 1, "failed": [],
             "methods": ["improved", "without_logs"], "budget": 1.0,
             "trials": msgspec.to_builtins([*parts, *whole])}  # fmt: skip
    (tmp_path / STUDY_FILE).write_bytes(msgspec.json.encode(about))
    kept = {}
    monkeypatch.setattr("experiments.results.record.record", lambda *each: kept.update({each[1]: each}))
    write_report(tmp_path, is_recorded=True)
    ((study, name, rows, _, (note,)),) = kept.values()
    assert (study, name) == ("paper", "road: What each part of the method buys")
    assert note.count("Variants are compared with the method as improved on what both have made.") == 1
    assert [(row["variant"], row["trials"]) for row in rows] == [("method as improved", 3), ("without logs", 2)]
    improved, without = rows
    assert improved["vehicle_level"] == pytest.approx((0.4 + 0.4 + 0.44) / 3, rel=1e-3)
    assert (improved["vehicle_level_change"], improved["mean_of_errors_change"]) == (0.0, 0.0)
    assert (without["vehicle_level"], without["vehicle_level_change"]) == (0.8, 0.4)
    assert (without["mean_of_errors"], without["mean_of_errors_change"]) == (0.2, 0.1)
    assert (without["sumo_runs"], improved["calibration_s"]) == (8.0, 200.0)


def test_a_trial_survives_its_file(tmp_path: Path):
    one = trial("improved", 2)
    (tmp_path / TRIAL_FILE).write_text(trial_json(one))
    assert read_trial(tmp_path / TRIAL_FILE) == one
    (tmp_path / TRIAL_FILE).write_text("{")
    with pytest.raises(CaseError, match="make it again"):
        read_trial(tmp_path / TRIAL_FILE)


def test_no_study_is_one_line(tmp_path: Path):
    with pytest.raises(CaseError, match=r"study\.json"):
        read_study(tmp_path)


def test_a_study_is_recorded_with_what_it_is_of(trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    kept = {}
    monkeypatch.setattr("experiments.results.record.record", lambda *each: kept.update({each[1]: each}))
    monkeypatch.setattr("experiments.results.record.FOLDER", tmp_path)
    about = {"case": "road", "patterns": [{"pattern": n} for n in CRITICAL], "repetitions": 1, "methods": list(LEVEL),
             "budget": 0.5, "failed": ["a drive"], "trials": msgspec.to_builtins(trials)}  # fmt: skip
    (tmp_path / STUDY_FILE).write_bytes(msgspec.json.encode(about))
    write_report(tmp_path)
    assert not kept
    write_report(tmp_path, is_recorded=True)
    assert [name.removeprefix("road: ") for name in kept] == [
        "The paper's numbers beside ours", "Vehicle-level error by pattern", "Errors of all methods",
        "Figures 7 to 13 of the paper",
    ]  # fmt: skip
    pictures = kept["road: Figures 7 to 13 of the paper"][4]
    assert pictures[1] == "![Figure 8: vehicle level](paper_road_figure_08_vehicle_level.svg)"
    drawn = [picture.partition("](")[2].rstrip(")") for picture in pictures]
    assert len(drawn) == 7
    assert all((tmp_path / name).read_text() == (tmp_path / name[len("paper_road_") :]).read_text() for name in drawn)
    study, _, rows, title, (note,) = kept["road: Errors of all methods"]
    assert (study, title) == ("paper", "Errors of all methods on `road`")
    assert note.startswith("3 traffic patterns, 1 repetitions, no_calibration,")
    assert "budget 0.5; failed: a drive. Errors of all methods are means over the 3 of them" in note
    by_measure = {row["measure"]: row for row in rows}
    assert by_measure["cut_ins"]["noise floor"] == 0.05
    assert all(value is None for name, value in by_measure["cut_ins"].items() if name not in ("measure", "noise floor"))
    json.dumps(rows, allow_nan=False)
