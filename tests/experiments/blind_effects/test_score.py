"""The scorer on answers made by hand, against closed forms."""

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from experiments.blind_effects.answers import Answered
from experiments.blind_effects.naive import largest_error, largest_gain
from experiments.blind_effects.overlap import answered_cells, overlap_over_union, true_place
from experiments.blind_effects.rates import paired_difference, rate
from experiments.blind_effects.run import diagnose_cases
from experiments.blind_effects.score import (
    holds_strength,
    is_false_alarm,
    is_named,
    is_named_alone,
    is_other_named,
    is_visible,
    likely_set,
    score,
)
from experiments.blind_effects.seal import SealBrokenError, file_hash, seal_of


def answered(
    kind: str = "single",
    effect: str = "memory",
    level: str = "medium",
    verdict: str = "effect",
    named: tuple[str, ...] = (),
    **more,
) -> Answered:
    effects = [] if kind.startswith("null") else [{"effect": effect, "strength": 1.0, "level": level}]
    place = more.pop("place", {})
    answer = {
        "verdict": verdict,
        "effects": list(named),
        "ranking": [{"effect": "memory", "probability": 1.0}],
        "where": [],
        "how_far": None,
        "wall_s": {"total": 100.0},
    } | more
    label = {"kind": kind, "effects": effects, "place_and_time": place, "num_drives": 12}
    return Answered(Path("nowhere"), label, answer)


def test_strengths_and_what_the_power_table_promises_are_held_against_the_truth():
    """True strengths are 1; signs are the label's."""
    held, missed = (
        answered(named=("memory",), ranking=[{"effect": "memory", "probability": 1.0, "strength_ci90": interval}])
        for interval in ((-1.2, -0.8), (1.1, 1.6))
    )
    assert (holds_strength(held), holds_strength(missed)) == (True, False)
    seen, unseen, never = (answered(undetectable_below={"memory": least}) for least in (0.9, 1.1, None))
    assert [is_visible(case) for case in (seen, unseen, never)] == [True, False, False]
    lines = score([held, missed, seen, unseen], ["none"] * 4)
    assert value_of(lines, "90 % intervals hold the true strength") == 0.5
    assert value_of(lines, "named, of those that the power table calls visible") == 0.0


def value_of(lines, start: str) -> float | None:
    return next(line.value for line in lines if line.title.startswith(start))


def test_wilson_is_the_closed_form():
    hits, of, z = 7, 20, 1.959963984540054
    share = hits / of
    middle = (share + z**2 / (2 * of)) / (1 + z**2 / of)
    half = z / (1 + z**2 / of) * np.sqrt(share * (1 - share) / of + z**2 / (4 * of**2))
    got = rate([True] * hits + [False] * (of - hits))
    assert (got.low, got.high) == pytest.approx((middle - half, middle + half), abs=1e-12)


def test_a_rate_of_nothing_is_no_number():
    assert np.isnan(rate([]).value)


def test_naming():
    sole = answered(named=("memory",))
    several = answered(verdict="class", named=("slow_start", "memory", "grade"))
    crowd = answered(verdict="class", named=("slow_start", "memory", "grade", "blockage"))
    other = answered(named=("grade",))
    silent = answered(verdict="no_gap", named=("memory",))
    assert [is_named(one) for one in (sole, several, crowd, other, silent)] == [True, True, False, False, False]
    assert [is_named_alone(one) for one in (sole, several, crowd, other, silent)] == [True, False, False, False, False]
    assert [is_other_named(one) for one in (sole, several, crowd, other, silent)] == [False, False, False, True, False]


@pytest.mark.parametrize(
    ("verdict", "alarm"),
    [("no_gap", 0), ("miscalibrated", 0), ("not_testable", 0), ("effect", 1), ("class", 1), ("unknown", 1)],
)
def test_false_alarms(verdict: str, alarm: int):
    assert is_false_alarm(answered("null", verdict=verdict)) == alarm


def test_likely_set_is_the_smallest_that_holds_nine_tenths():
    ranking = [{"effect": name, "probability": p} for name, p in (("a", 0.2), ("b", 0.6), ("c", 0.1), ("none", 0.1))]
    assert likely_set(answered(ranking=ranking)) == ("b", "a", "c")


def test_the_table_counts():
    cases = [
        answered(named=("memory",)),
        answered(level="strong", verdict="class", named=("memory", "grade")),
        answered(level="strong", named=("grade",)),
        answered(level="weak", verdict="unknown"),
        answered("null", verdict="no_gap"),
        answered("null", verdict="unknown"),
        answered("null_far", verdict="miscalibrated"),
        answered("out_of_library", "id_swaps", verdict="unknown"),
        answered("out_of_library", "id_swaps", named=("memory",)),
    ]
    lines = score(cases, ["none"] * len(cases))
    assert value_of(lines, "the true effect named") == pytest.approx(2 / 3)
    assert value_of(lines, "the same, alone") == pytest.approx(1 / 3)
    assert value_of(lines, "another effect named") == pytest.approx(1 / 4)
    assert value_of(lines, "false alarms on nulls") == pytest.approx(1 / 2)
    assert value_of(lines, "false alarms on pure") == 0.0
    assert value_of(lines, "unknown, on effects outside") == pytest.approx(1 / 2)
    assert value_of(lines, "false unknowns") == pytest.approx(2 / 7)
    assert value_of(lines, "named, weak") == 0.0
    assert value_of(lines, "90 % sets hold") == pytest.approx(4 / 7)
    assert value_of(lines, "pairs: both") is None
    assert value_of(lines, "named alone, more often than naive: random") == pytest.approx(1 / 3)
    assert value_of(lines, "named alone, or nothing named where nothing is, more often than naive: random") == 0.0
    guessed = score(cases, ["memory", "grade", "none", "memory", "none", "grade", "memory", "none", "none"])
    line = "named alone, or nothing named where nothing is, more often than naive: random"
    assert value_of(guessed, line) == pytest.approx((3 - 2) / 6)


def test_fraction_closed_is_judged_by_the_twin():
    def case(ours: float, interval: tuple[float, float], truth: float) -> Answered:
        one = answered(how_far={"fraction_closed": ours, "fraction_closed_ci90": list(interval)})
        return Answered(one.folder, one.label, one.answer, {"how_far": {"fraction_closed": truth}})

    cases = [case(0.5, (0.4, 0.6), 0.55), case(0.5, (0.4, 0.6), 0.7), case(0.9, (0.2, 1.0), 0.5), answered()]
    lines = score(cases, ["none"] * 4)
    assert value_of(lines, "90 % intervals hold the true fraction") == pytest.approx(2 / 3)
    assert value_of(lines, "median error of the fraction") == pytest.approx(0.2)


def test_overlap_of_half_shifted_rectangles():
    truth = {"route_from_m": 400.0, "route_to_m": 600.0, "time_from_s": 300.0, "time_to_s": 400.0}
    shifted = {"route_from_m": 500.0, "route_to_m": 700.0, "time_from_s": 300.0, "time_to_s": 400.0}
    assert overlap_over_union(truth, [shifted]) == pytest.approx(1 / 3)
    assert overlap_over_union(truth, [truth, truth]) == 1.0
    late = shifted | {"time_from_s": 350.0, "time_to_s": 450.0}
    assert overlap_over_union(truth, [late]) == pytest.approx(1 / 7)
    assert overlap_over_union(truth, []) == 0.0


def test_time_does_not_count_where_the_truth_has_none():
    truth = {"route_from_m": 400.0, "route_to_m": 600.0}
    said = {"route_from_m": 400.0, "route_to_m": 500.0, "time_from_s": 310.0, "time_to_s": 320.0}
    assert overlap_over_union(truth, [said]) == pytest.approx(1 / 2)


def test_a_point_is_widened_and_certain_cells_are_taken():
    case = answered(
        place={"route_from_m": 1000.0, "route_to_m": 1000.0},
        where=[
            {"mop": "", "gap": 1.0, "share": 0.7, "p_adjusted": 0.6, "route_from_m": 0.0, "route_to_m": 100.0},
            {"mop": "", "gap": 1.0, "share": 0.3, "p_adjusted": 0.01, "route_from_m": 950.0, "route_to_m": 1050.0},
        ],
    )
    truth = true_place(case)
    assert truth is not None
    assert overlap_over_union(truth, answered_cells(case)) == 1.0


def test_naive_answers():
    ranking = [
        {"effect": "none", "probability": 0.9, "training_gain": 9.0},
        {"effect": "grade", "probability": 0.1, "training_gain": 0.2, "held_out_gain": 0.9},
        {"effect": "memory", "probability": 0.0, "training_gain": 0.3, "held_out_gain": 0.1},
    ]
    where = [{"mop": "traffic_speed", "gap": 0.2}, {"mop": "cut_ins", "gap": -0.9}]
    case = answered(ranking=ranking, where=where)
    assert largest_gain(case) == "memory"
    assert largest_error(case) == "lane_change_relaxation"
    assert largest_gain(answered()) is None
    assert largest_error(answered()) is None


def test_paired_difference_of_equal_answers_is_nothing():
    marks = [True, False, True]
    assert paired_difference(marks, marks) == (0.0, 0.0)
    step, low = paired_difference([True] * 30, [False] * 30)
    assert (step, low) == (1.0, 1.0)


@pytest.fixture
def sealed(tmp_path: Path) -> Path:
    import pandas as pd

    names = ("aa", "bb")
    key, seals = {}, {}
    rng = np.random.default_rng(4)
    for number, name in enumerate(names):
        field = tmp_path / "cases" / "cases" / name / "field"
        field.mkdir(parents=True)
        (field.parent / "case.toml").write_text("format = 1\n")
        times = np.arange(50) / 10.0
        own = {"speed_kmh": 60.0 + rng.normal(size=50), "acceleration_mps2": rng.normal(size=50), "lane": 1}
        pd.DataFrame({"time_s": times} | own).to_csv(field / "d01_subject.csv", index=False)
        seen = {"vehicle_id": 1, "lane": 1, "relative_x_m": 30.0 + times, "relative_y_m": 0.0, "heading_deg": 0.0}
        table = pd.DataFrame({"time_s": times} | seen | {"speed_kmh": 60.0 + rng.normal(size=50)})
        table.to_csv(field / "d01_objects.csv", index=False)
        label = answered(("single", "null")[number]).label
        key[name] = {"salt": name, "label": label}
        seals[name] = seal_of(name, label)
    (tmp_path / "key.json").write_text(json.dumps({"cases": key}))
    (tmp_path / "cases" / "seals.json").write_text(json.dumps({"cases": seals}))
    program = tmp_path / "program"
    body = json.dumps(answered(named=("memory",)).answer)
    program.write_text(f'#!/bin/sh\nmkdir -p "$4"\ncat > "$4/diagnosis.json" <<\'END\'\n{body}\nEND\n')
    program.chmod(0o755)
    return tmp_path


def test_run_and_score_from_end_to_end(sealed: Path):
    from experiments.blind_effects.score import score_answers

    assert diagnose_cases(sealed / "cases", sealed / "runs", str(sealed / "program"), ()) == 0
    hashes = json.loads((sealed / "runs" / "answers.json").read_text())
    assert hashes["aa"] == file_hash(sealed / "runs" / "aa" / "diagnosis.json")
    args = (sealed / "cases", sealed / "runs", sealed / "key.json", (), sealed / "out", Console(quiet=True))
    lines, _ = score_answers(*args)
    assert value_of(lines, "the same, alone") == 1.0
    assert value_of(lines, "false alarms on nulls") == 1.0
    assert json.loads((sealed / "out" / "score.json").read_text())["table"][0]["of"] == 1
    assert "memory" in (sealed / "out" / "score.html").read_text()
    (sealed / "runs" / "bb" / "diagnosis.json").write_text(json.dumps(answered("null", verdict="no_gap").answer))
    with pytest.raises(SealBrokenError, match="not the answer that was recorded"):
        score_answers(*args)
