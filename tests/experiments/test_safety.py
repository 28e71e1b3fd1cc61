"""Safety measures of found against true values, from tallies made by hand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.paper.methods import IMPROVED
from experiments.paper.study import trial_folder
from experiments.paper.trial import TRIAL_FILE, Trial, trial_json
from experiments.safety import differences
from experiments.safety.differences import AGAIN, CALIBRATED, FEWEST_OBSERVATIONS, rows_of, summary_of, values_found
from jaxcalib.measures.measure import Level, Measure

NAMES = ("metres", "braked", "near", "gaps", "gap_m")
MEASURES = {
    "hard_braking_per_km": Measure("hard_braking_per_km", "", Level.VEHICLE, "braked", "metres", 1000.0, "braked"),
    "near_misses_per_1000_km": Measure("near_misses_per_1000_km", "", Level.VEHICLE, "near", "metres", 1e6, "near"),
    "gap_m": Measure("gap_m", "", Level.VEHICLE, "gap_m", "gaps"),
}


def test_differences_are_relative_to_the_truth_and_rare_events_say_nothing():
    true = np.asarray([40_000.0, 50.0, FEWEST_OBSERVATIONS - 1.0, 100.0, 800.0])
    again = np.asarray([40_000.0, 45.0, 9.0, 200.0, 1640.0])
    calibrated = np.asarray([80_000.0, 120.0, 90.0, 100.0, 600.0])
    rows = rows_of(MEASURES, NAMES, true, again, calibrated)
    assert [row["measure"] for row in rows] == ["hard_braking_per_km", "gap_m"]
    assert [(row["true"], row["calibrated"]) for row in rows] == [(1.25, 1.5), (8.0, 6.0)]
    assert [row[CALIBRATED] for row in rows] == [0.2, -0.25]
    assert [row[AGAIN] for row in rows] == [-0.1, 0.025]
    assert summary_of(rows)[0].startswith("median relative difference of 2 measures from the truth: 22.5% (15 % asked)")


def test_a_measure_that_the_truth_or_the_found_values_never_show_is_left_out():
    true = np.asarray([40_000.0, 0.0, 60.0, 100.0, 800.0])
    unseen = np.asarray([40_000.0, 10.0, 60.0, 0.0, 0.0])
    assert [row["measure"] for row in rows_of(MEASURES, NAMES, true, true, unseen)] == ["near_misses_per_1000_km"]


def test_what_a_study_has_found_is_not_searched_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    field: Any = SimpleNamespace(layout=SimpleNamespace(names=("main", "tau")), case=SimpleNamespace(folder=tmp_path))
    made = []

    def calibrate(case: Path, run: Path, **options: Any) -> None:
        made.append((case, run, options))

    monkeypatch.setattr(differences, "calibrate", calibrate)
    monkeypatch.setattr(differences, "read_calibrated_run", lambda run, field: SimpleNamespace(values=(3.0, 4.0)))
    assert values_found(field, 2, tmp_path, 0.5) == [3.0, 4.0]
    assert made == [(tmp_path, tmp_path / "run-2", {"budget": 0.5, "resume": False})]
    folder = trial_folder(tmp_path, 2, 0, IMPROVED)
    folder.mkdir(parents=True)
    trial = Trial(
        method=IMPROVED, pattern=2, repetition=0, seed=1, role="held_out", errors={}, floor={}, vehicle_level=1.0,
        surrogate_runs=1, sumo_runs=0, calibration_s=1.0, parameters={"tau": 1.5, "main": 2.0}, critical=[],
        num_drivers=1,
    )  # fmt: skip
    (folder / TRIAL_FILE).write_text(trial_json(trial))
    assert values_found(field, 2, tmp_path, 0.5) == [2.0, 1.5]
    assert len(made) == 1
