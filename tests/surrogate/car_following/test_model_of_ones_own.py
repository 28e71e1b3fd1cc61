"""A car-following model is one file and its line in the registry; one row more, and scenarios may name it."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

REPOSITORY = Path(__file__).resolve().parents[3]
MODEL = '''
"""Helly's linear model."""

import jax.numpy as jnp

from surrogate.car_following.common_parameters import BASIC, EMERGENCY
from surrogate.car_following.late_braking import LateBrakingModel, Value
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter


class Helly(LateBrakingModel):
    """Acceleration in proportion to the speed difference and to what the gap lacks (Helly 1959)."""

    jam_gap_m: Value
    time_gap_s: Value
    max_acceleration_mps2: Value
    max_deceleration_mps2: Value
    emergency_deceleration_mps2: Value
    speed_rate_1ps: Value
    gap_rate_1ps2: Value

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the least of following, a proportional cruise control and what the vehicle can do."""
        s = situation
        lack_m = jnp.minimum(s.gap_m, 1e4) - self.jam_gap_m - self.time_gap_s * s.speed_mps
        follow = self.speed_rate_1ps * (s.leader_speed_mps - s.speed_mps) + self.gap_rate_1ps2 * lack_m
        cruise = 0.5 * (s.desired_speed_mps - s.speed_mps)
        wanted = jnp.where(s.gap_m < jnp.inf, jnp.minimum(follow, cruise), cruise)
        return jnp.minimum(wanted, self.max_acceleration_mps2)


HELLY = ModelEntry(
    "helly", "Helly's linear model", Helly,
    (*BASIC, Parameter("speed_rate_1ps", 1.2, 0.0, 3.0), Parameter("gap_rate_1ps2", 0.3, 0.01, 1.0)), EMERGENCY,
)
'''
IMPORT = "from surrogate.car_following.helly import HELLY\n"
ROW = """    "Helly": SumoModel(
        HELLY, (*_BASIC, following("lambda", "speed_rate_1ps", 1.0), following("mu", "gap_rate_1ps2", 0.25, 0.5))
    ),
"""


def insert(file: Path, before: str, text: str) -> None:
    """Insert text before a passage that a file has once."""
    old = file.read_text(encoding="utf-8")
    assert old.count(before) == 1
    file.write_text(old.replace(before, text + before), encoding="utf-8")


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the program with the model."""
    copy = tmp_path_factory.mktemp("copy")
    for package in ("surrogate", "sim_adapters", "jaxcalib", "tests"):
        shutil.copytree(REPOSITORY / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(REPOSITORY / "pyproject.toml", copy)
    (copy / "surrogate/car_following/helly.py").write_text(MODEL.lstrip(), encoding="utf-8")
    registry = copy / "surrogate/car_following/registry.py"
    insert(registry, "from surrogate.car_following.idm import IDM\n", IMPORT)
    insert(registry, "    IDM,\n", "    HELLY,\n")
    return copy


def run(copy: Path, *arguments: str) -> str:
    """Return what a Python says that has nothing but the copy."""
    environment = {**os.environ, "PYTHONPATH": str(copy), "JAXCALIB_CACHE": "off"}
    done = subprocess.run([sys.executable, *arguments], cwd=copy, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return done.stdout


@pytest.mark.long
def test_every_law_runs_for_it(copy: Path) -> None:
    (laws,) = (copy / "tests").rglob("test_car_following_laws.py")
    said = run(copy, "-m", "pytest", str(laws), "-k", "helly", "-q", "-p", "no:cacheprovider")
    (passed,) = re.findall(r"(\d+) passed", said)
    assert int(passed) >= 7  # free road twice, limits, finite, standing obstacle, stop and go, gradients


@pytest.mark.long
def test_its_planted_parameters_are_found_in_a_pair(copy: Path, tmp_path: Path) -> None:
    time_s = 0.1 * np.arange(900)
    leader = 14.0 + 5.0 * np.sin(time_s / 7.0) + 2.0 * np.sin(time_s / 2.3)
    speed, gap, rows = 13.0, 22.0, []
    for v_lead, v_next in zip(leader, np.append(leader[1:], leader[-1]), strict=True):
        rows.append((speed, gap))
        acceleration = min(0.8 * (v_lead - speed) + 0.2 * (gap - 2.5 - 1.1 * speed), 3.0)
        new = speed + 0.1 * acceleration
        gap, speed = gap + 0.1 * (v_next - new), new
    pair = pd.DataFrame(rows, columns=["v_foll_mps", "gap_m"]).assign(pair_id="a", time_s=time_s, v_lead_mps=leader)
    pair.to_csv(tmp_path / "pairs.csv", index=False)
    run(copy, "-m", "jaxcalib", "fit-following", str(tmp_path / "pairs.csv"), "--model", "helly",
        "--out", str(tmp_path / "fits"))  # fmt: skip
    (found,) = pd.read_csv(tmp_path / "fits" / "pairs.csv").to_dict("records")
    assert found["mixed_error"] < 0.01
    assert found["time_gap_s"] == pytest.approx(1.1, rel=0.05)  # the recorded course begins a step apart from ours
    assert found["speed_rate_1ps"] == pytest.approx(0.8, rel=0.05)


def test_with_a_row_in_the_table_a_scenario_may_name_it(copy: Path) -> None:
    names = copy / "sim_adapters/scenario/sumo_names.py"
    insert(names, "from surrogate.car_following.idm import IDM\n", IMPORT)
    insert(names, '    "IDM": SumoModel', ROW)
    scenario = Path(shutil.copytree(REPOSITORY / "experiments/cases/corridor/scenario", copy / "case/scenario"))
    demand = scenario / "demand.rou.xml"
    text = demand.read_text(encoding="utf-8")
    assert text.count('carFollowModel="IDM"') >= 1
    demand.write_text(text.replace('carFollowModel="IDM"', 'carFollowModel="Helly" mu="0.6"'), encoding="utf-8")
    said = run(copy, "-c", """if True:
        from pathlib import Path
        from jaxcalib.problem.parameter_space import ranges_of
        from sim_adapters.scenario.scenario import read_scenario
        from sim_adapters.scenario.sumo_names import vehicle_class, with_attribute
        scenario = read_scenario(Path("case/scenario/scenario.sumocfg"), "ego", 720.0)
        model = scenario.model_of("car")
        car = vehicle_class(scenario.values_of("car"), model)
        print(model, type(car.car_following).__name__, car.car_following.gap_rate_1ps2)
        print(with_attribute(car, model, "mu", 0.4).car_following.gap_rate_1ps2, car.car_following.speed_rate_1ps)
        print(ranges_of(model)["mu"].lower, ranges_of(model)["mu"].upper)
        """)  # fmt: skip
    assert said.split() == ["Helly", "Helly", "0.3", "0.2", "1.0", "0.02", "2.0"]
