"""What diagnoses of other people's scenarios answer, as a table."""

import json
from pathlib import Path

import pytest

from experiments.real_scenarios.diagnoses import counted, diagnosed_rows


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    for name, verdict, effects in (
        ("a", "miscalibrated", []),
        ("b", "effect", ["memory"]),
        ("c", "unknown", []),
        ("d", "class", ["grade", "memory"]),
    ):
        (tmp_path / name).mkdir()
        far = {"gap_default": 3.456, "gap_recalibrated": 2.0, "gap_with_effect": None, "noise_floor": 1.0}
        answer = {"verdict": verdict, "effects": effects, "how_far": far, "wall_s": {"total": 61.4}}
        (tmp_path / name / "diagnosis.json").write_text(json.dumps(answer))
    (tmp_path / "unfinished").mkdir()
    return tmp_path


def test_each_run_with_an_answer_has_a_row(runs: Path):
    rows = diagnosed_rows(runs)
    assert [(row["case"], row["named"]) for row in rows] == [
        ("a", ""),
        ("b", "memory"),
        ("c", ""),
        ("d", "grade, memory"),
    ]
    assert rows[0]["gap, scenario as it is"] == 3.46
    assert rows[0]["gap, with what is named"] is None
    assert rows[0]["time, s"] == 61


def test_names_are_counted_apart_from_unknown(runs: Path):
    assert counted(diagnosed_rows(runs)) == "of 4: silent 1, unknown 1, an effect or a set named 2"
