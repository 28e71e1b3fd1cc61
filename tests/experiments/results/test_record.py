"""Records of measurements: a table comes back as it was given, and every page is what its JSON makes."""

import datetime
import re
from pathlib import Path

from experiments.results.__main__ import render
from experiments.results.record import append, flattened, read_study, record, write_study


def test_every_page_is_what_its_json_makes() -> None:
    assert render(check=True) == 0


def test_a_table_has_its_rows_and_where_it_comes_from(tmp_path: Path) -> None:
    rows = [{"sets": 64, "rate": {"median": 80.3, "min": float("nan")}}, {"sets": 128, "rate": {"median": 81.25}}]
    path = record("speed", "throughput", rows, "Vehicle-steps per second", ["On a road of 3 km."], folder=tmp_path)
    table = read_study(path)["tables"][0]
    assert table["rows"] == [
        {"sets": 64, "rate median": 80.3, "rate min": None},
        {"sets": 128, "rate median": 81.25},
    ]
    assert datetime.date.fromisoformat(table["date"]) <= datetime.datetime.now(datetime.UTC).date()
    assert re.search(r"\d+ cores?", table["machine"])
    page = path.with_suffix(".md").read_text(encoding="utf-8")
    assert "| 64 | 80.3 |  |" in page
    assert "On a road of 3 km." in page


def test_a_table_that_is_recorded_again_replaces_the_one_of_its_name_alone(tmp_path: Path) -> None:
    for name, value in (("a", 1), ("b", 2), ("a", 3)):
        path = record("study", name, [{"value": value}], name, folder=tmp_path)
    assert [(one["name"], one["rows"]) for one in read_study(path)["tables"]] == [
        ("a", [{"value": 3}]),
        ("b", [{"value": 2}]),
    ]


def test_a_page_that_was_changed_by_hand_is_found_and_made_anew(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("experiments.results.__main__.FOLDER", tmp_path)
    write_study(tmp_path / "study.json", {"title": "Study", "tables": []})
    (tmp_path / "study.md").write_text("by hand", encoding="utf-8")
    assert render(check=True) == 1
    assert render() == 0
    assert render(check=True) == 0


def test_sequences_within_a_row_become_text() -> None:
    assert flattened({"devices": ["a", "b"], "interval": (0.5, 1.5)}) == {"devices": "a, b", "interval": "0.5, 1.5"}


def test_a_table_grows_by_a_row_for_each_commit_and_its_page_shows_the_last(tmp_path: Path, monkeypatch) -> None:
    for number in range(14):
        monkeypatch.setattr("experiments.results.record.commit", lambda number=number: f"{number:040d}")
        path = append("benchmarks", "sweep", {"wall_s": 100.0 + number}, "A sweep", folder=tmp_path)
    path = append("benchmarks", "sweep", {"wall_s": 99.5}, "A sweep", folder=tmp_path)  # the same commit again
    rows = read_study(path)["tables"][0]["rows"]
    assert [row["wall_s"] for row in rows] == [*(100.0 + number for number in range(13)), 99.5]
    assert list(rows[0])[:3] == ["commit", "date", "machine"]
    page = path.with_suffix(".md").read_text(encoding="utf-8")
    assert "| 99.5 |" in page
    assert "| 104 |" in page
    assert "| 103 |" not in page  # of the eleventh last
