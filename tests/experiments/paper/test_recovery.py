"""What was found against what simulated fields were made with, by hand."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.paper import recovery
from experiments.paper.patterns import PATTERN_FILE
from experiments.paper.recovery import Truth, read_truth, recovery_table
from experiments.paper.trial import Trial
from tests.jaxcalib.calibration.toy import LAYOUT, SPACE

TRUE = {"main": 1500.0, "tau": 1.2, "minGap": 2.0}


def trial(method: str, pattern: int, **values: float) -> Trial:
    return Trial(
        method=method, pattern=pattern, repetition=0, seed=1, role="held_out", errors={}, floor={}, vehicle_level=1.0,
        surrogate_runs=1, sumo_runs=0, calibration_s=1.0, parameters=TRUE | values, critical=[], num_drivers=2,
    )  # fmt: skip


def test_inflows_are_off_by_the_truth_and_drivers_by_their_range():
    truth = Truth(SPACE, {2: np.asarray([*TRUE.values()]), 3: np.asarray([1000.0, 1.2, 2.0])})
    trials = [
        trial("improved", 2, main=1200.0, tau=2.4),  # a fifth, and ln 2 of ln 7.5
        trial("improved", 3, main=1100.0),  # a tenth
        trial("improved", 1, main=9.0, tau=9.0, minGap=9.0),  # a field whose truth nobody knows
        trial("printed", 2),
    ]
    table = recovery_table(trials, truth)
    assert table["parameter"].tolist() == ["main", "tau", "minGap"]
    assert table["share of"].tolist() == ["truth", "range", "range"]
    by_hand = [15.0, 100.0 * math.log(2.0) / math.log(7.5) / 2.0, 0.0]
    np.testing.assert_allclose(table["method as improved"], by_hand, atol=0.006)
    assert (table["method as printed"] == 0.0).all()


def test_truths_are_read_from_all_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    template = SimpleNamespace(base_values=lambda: np.asarray([2000.0, 1.0, 2.5]))
    problem = SimpleNamespace(template=template, layout=LAYOUT, model="IDM")
    monkeypatch.setattr(recovery, "read_problem", lambda folder: problem)
    assert read_truth([tmp_path]) is None
    for folder, pattern, main in (("one", 2, 1400.0), ("other", 4, 1600.0)):
        file = tmp_path / folder / f"pattern-{pattern}" / PATTERN_FILE
        file.parent.mkdir(parents=True)
        # in another order than the layout's
        about = {"minGap": 2.0, "tau": 1.2, "main": main}
        file.write_text(json.dumps({"pattern": pattern, "parameters": about}))
    truth = read_truth([tmp_path / "one", tmp_path / "other"])
    assert truth is not None
    assert {pattern: values.tolist() for pattern, values in truth.values.items()} == {
        2: [1400.0, 1.2, 2.0],
        4: [1600.0, 1.2, 2.0],
    }
    assert truth.space.names == ("main", "tau", "minGap")
