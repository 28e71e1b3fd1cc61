"""A whole diagnosis, on one kilometre and on the corridor: logs with distances that read too long."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest

from jaxcalib import diagnose
from surrogate.effects.registry import EFFECTS
from tests.places import CORRIDOR

BIAS = 0.08
RANGE_M = 150.0
PARAMETERS = ["tau", "minGap", "accel", "decel", "speedFactor", "lcSpeedGain", "lcAssertive"]  # fewer, to save time
REASON = "a diagnosis of the corridor takes four minutes of two cores; every commit makes a shorter road's"

pytestmark = pytest.mark.long


@pytest.fixture(params=["small", pytest.param("corridor", marks=pytest.mark.nightly(REASON))])
def biased_case(request: pytest.FixtureRequest, small_case: Path, tmp_path: Path) -> Path:
    if request.param == "small":
        request.getfixturevalue("small_surrogate")  # its program is the calibration's
    case = Path(shutil.copytree(small_case if request.param == "small" else CORRIDOR, tmp_path / "case"))
    told = (case / "case.toml").read_text()
    (case / "case.toml").write_text(re.sub(r"parameters = \[.*?\]", f"parameters = {PARAMETERS}", told))
    for file in (case / "field").glob("*_objects.*"):
        is_packed = file.suffix == ".gz"
        objects = pd.read_csv(file) if is_packed else pd.read_parquet(file)
        objects["relative_x_m"] = (objects["relative_x_m"] * (1.0 + BIAS)).round(2)
        seen = objects[objects["relative_x_m"].abs() <= RANGE_M]
        _ = seen.to_csv(file, index=False) if is_packed else seen.to_parquet(file, index=False)
    return case


def test_a_biased_sensor_is_named_and_its_strength_found(biased_case: Path, tmp_path: Path):
    found = diagnose(biased_case, tmp_path / "run", budget=0.05)

    assert found.verdict == "effect"
    assert found.effects == ("gap_sensor_bias",)
    by_name = {one.effect: one for one in found.ranking}
    assert set(by_name) == {effect.name for effect in EFFECTS} | {"none", "unknown"}
    assert sum(one.probability for one in found.ranking) == pytest.approx(1.0)
    first = by_name["gap_sensor_bias"]
    assert first.strength == pytest.approx(BIAS, rel=0.3)
    assert first.strength_ci90 is not None
    assert first.strength_ci90[0] < BIAS * 1.1
    assert first.strength_ci90[1] > BIAS * 0.9
    assert sum(one.share for one in found.where) == pytest.approx(1.0)
    far = found.how_far
    assert far["gap_with_effect"] < 0.5 * far["gap_recalibrated"]
    assert far["fraction_closed_ci90"][0] <= far["fraction_closed"] <= far["fraction_closed_ci90"][1]
    assert set(found.parameters) == {"scenario", "calibrated", "with_effect"}
    assert json.loads((tmp_path / "run" / "diagnosis.json").read_text())["effects"] == ["gap_sensor_bias"]
    assert "with the effect" in (tmp_path / "run" / "diagnosis.html").read_text()
