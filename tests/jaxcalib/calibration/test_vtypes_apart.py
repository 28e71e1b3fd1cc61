"""The whole command where lorries have driver parameters of their own, on one kilometre: result, files, and back."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from experiments.small_case import TRUTH
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.calibrated_run import read_calibrated_run
from sim_adapters.scenario.scenario import read_scenario

BUDGET, LONGEST_S = "0.05", 900.0
LORRY_TAU_S = 1.4  # in the scenario, whose cars have 1.1 s; in the field everybody has the same

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def case(small_case: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small case, in which the ramp's vehicles are lorries that drive apart."""
    folder = Path(shutil.copytree(small_case, tmp_path_factory.mktemp("apart") / "case"))
    demand, table = folder / "scenario/demand.rou.xml", folder / "case.toml"
    text = demand.read_text()
    (car,) = re.findall(r'<vType id="car".*?/>', text)
    lorry = car.replace('id="car" vClass="passenger"', 'id="lorry" vClass="truck"')
    lorry = re.sub(r' tau="[^"]*"', f' tau="{LORRY_TAU_S}"', lorry)
    text = text.replace(car, car + lorry).replace('id="f_on1" type="car"', 'id="f_on1" type="lorry"')
    demand.write_text(text)
    vtypes = 'vtypes = ["car", "lorry"]\napart = "trucks"'
    table.write_text(table.read_text().replace('vtypes = ["car"]', vtypes))
    return folder


@pytest.fixture(scope="module")
def problem(case: Path) -> CalibrationProblem:
    return read_problem(case)


@pytest.fixture(scope="module")
def out(
    case: Path,
    tmp_path_factory: pytest.TempPathFactory,
    on_all_cores: Callable[[], AbstractContextManager[None]],
    as_users_do: dict[str, str],
) -> Path:
    """A whole calibration by programs as users have them."""
    folder = tmp_path_factory.mktemp("calibration") / "run"
    command = [sys.executable, "-m", "jaxcalib", "calibrate", str(case), "--out", str(folder), "--budget", BUDGET]
    with on_all_cores():
        done = subprocess.run(command, env=as_users_do, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.fixture(scope="module")
def result(out: Path) -> dict:
    return json.loads((out / "result.json").read_text())


def test_each_group_has_a_row_of_its_own(problem: CalibrationProblem, result: dict):
    table, behaviour = result["parameter_table"], result["parameters"]["behaviour"]
    assert tuple(table) == problem.layout.names
    for vtype, attribute in problem.layout.driver_parameters:
        assert behaviour[vtype][attribute] == table[f"{attribute}[{vtype}]"]["value"]
    assert set(result["critical_parameters"]) < set(table)
    assert result["confirmation"]["gradient"] is None  # pairs are of no group alone


def test_logs_speak_of_each_group(problem: CalibrationProblem, result: dict):
    car, lorry = (result["parameter_table"][f"tau[{vtype}]"] for vtype in ("car", "lorry"))
    assert car["source"] == "leader-follower pairs"
    assert lorry["source"] == "leader-follower pairs, by the factor of car"
    assert lorry["initial"] / LORRY_TAU_S == pytest.approx(car["initial"] / 1.1, rel=1e-4)
    assert car["value"] == pytest.approx(TRUTH["tau"], rel=0.1)
    width = [np.log(one["upper"] / one["lower"]) for one in (car, lorry)]
    assert width[1] > 2.0 * width[0]
    # of 15 fields' intervals, 90 % each, all hold the truth of cars and 14 that of lorries; this field is the other one
    assert car["lower"] < TRUTH["tau"] < car["upper"]
    error = width[1] / (2.0 * norm.ppf(0.95))
    assert abs(np.log(lorry["value"] / TRUTH["tau"])) < 3.0 * error


def test_the_scenario_handed_over_has_each_group_s_values(out: Path, result: dict):
    scenario = read_scenario(out / "scenario/calibrated.sumocfg", "ego", 180.0)
    for vtype, attributes in result["parameters"]["behaviour"].items():
        written = scenario.demand.vtypes[vtype]
        assert {name: float(written[name]) for name in attributes} == attributes
    text = (out / "scenario/demand.rou.xml").read_text()
    assert f"tau[lorry]: was {LORRY_TAU_S}, now {result['parameters']['behaviour']['lorry']['tau']:g} s" in text
    assert "tau[lorry]" in (out / "report.html").read_text()


def test_a_validation_reads_the_same_values(problem: CalibrationProblem, out: Path, result: dict):
    found = read_calibrated_run(out, problem)
    np.testing.assert_array_equal(found.values, [one["value"] for one in result["parameter_table"].values()])
    assert found.warnings == ()
