"""Fields made of null runs: who is drawn, and what is counted."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from experiments.diagnosis_bank import made_up_nulls
from experiments.diagnosis_bank.made_up_nulls import MadeUpNull, by_road, made_up_baseline
from jaxcalib.diagnosis.features.features import Cell, Channel, DriveTallies
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.runs.null_runs import NullRuns

CELLS = (Cell(Channel.REPLAY, "residual_mps2"),)


def drives(number: int) -> DriveTallies:
    """Return drives that can be told apart, three in each run."""
    told = np.arange(number, dtype=float)[:, None]
    return DriveTallies(CELLS, told, np.ones_like(told), told[:, 0], np.arange(number) // 3)


def test_a_field_is_drawn_from_the_null_and_taken_out_of_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(made_up_nulls, "prepare", lambda problem, field, runs, trials, open_steps: (field, runs))
    null = NullRuns(drives(30), {("sensor_noise", 0.3): drives(6)})
    nothing = cast(Any, None)
    baseline = Baseline(np.ones(2), nothing, nothing, null, nothing, {}, nothing, nothing, np.ones(2))
    session = cast(Any, SimpleNamespace(problem=None, is_fit=np.arange(9) % 3 < 2))
    drawn = [made_up_baseline(session, baseline, np.random.default_rng(seed)) for seed in (1, 2)]
    for made in drawn:
        field, runs = cast(Any, made.fitted)
        ours, theirs = set(field.above[:, 0]), set(runs.plain.above[:, 0])
        runs_of_ours = {each // 3 for each in ours}
        assert len(ours) == len(runs_of_ours) == 6  # each of a run of its own
        assert theirs == {each for each in range(30) if each // 3 not in runs_of_ours}
        assert min(ours) >= 6  # altered versions of the first six are compared with these, run by run
        assert field.run is None
        assert made.runs is runs
    assert set(cast(Any, drawn[0].fitted)[0].above[:, 0]) != set(cast(Any, drawn[1].fitted)[0].above[:, 0])


def test_alarms_are_counted_by_road():
    said = [("b", "no_gap", 0.9, 0.02), ("a", "unknown", 0.1, 0.8), ("b", "miscalibrated", 0.7, 0.1)]
    said.append(("b", "effect", 0.0, 0.2))
    rows = by_road(MadeUpNull(*each) for each in said)
    assert [row["road"] for row in rows] == ["a", "b", "all"]
    assert [row["fields"] for row in rows] == [1, 3, 4]
    assert [row["alarms"] for row in rows] == [1, 1, 2]
    assert [row["of them unknown"] for row in rows] == [1, 0, 1]
    assert rows[1]["probability of none, mean"] == pytest.approx(0.53)
    assert rows[2]["largest probability of unknown"] == 0.8
