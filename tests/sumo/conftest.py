"""The corridor of the repository, read once, and SUMO in a process of its own."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))  # for the tests, and for worker processes, which inherit it

DRIVES = ("d01", "d03")


@pytest.fixture(scope="session")
def corridor_folder() -> Path:
    return HERE.parents[1] / "experiments/cases/corridor"


@pytest.fixture(scope="session")
def corridor(corridor_folder: Path) -> Scenario:
    return read_scenario(corridor_folder / "scenario/scenario.sumocfg", corridor_folder, "ego", 720.0)


@pytest.fixture(scope="session")
def layout() -> ParameterLayout:
    return ParameterLayout(
        input_ids=("main", "on1"),
        input_flows=(("f_main_o1", "f_main_e"), ("f_on1_o1", "f_on1_e")),
        vtypes=("car",),
        attributes=("tau", "speedFactor", "speedDev", "lcSpeedGain"),
    )


@pytest.fixture
def own_corridor(corridor_folder: Path, tmp_path: Path) -> Path:
    """A copy of the corridor's scenario to be spoilt."""
    return Path(shutil.copytree(corridor_folder / "scenario", tmp_path / "case/scenario")).parent


@pytest.fixture(scope="session")
def problem(corridor_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> CalibrationProblem:
    """The corridor with two of its drives."""
    folder = Path(shutil.copytree(corridor_folder, tmp_path_factory.mktemp("case") / "corridor"))
    head, *drives = re.split(r"(?=\[\[drive\]\])", (folder / "case.toml").read_text())
    chosen = [drive for drive in drives if any(f'"{name}"' in drive for name in DRIVES)]
    (folder / "case.toml").write_text(head + "".join(chosen))
    return read_problem(folder)


@pytest.fixture(scope="session")
def start_sumo() -> Callable[..., subprocess.Popen]:
    """Return a function that starts SUMO beside the tests: until when, whose leaders go into which file, options."""

    def start(end_s: float, subject_vehicle: str, leaders: Path | None, *options: str | Path) -> subprocess.Popen:
        command = [sys.executable, HERE / "plain_sumo.py", str(end_s), subject_vehicle, str(leaders or os.devnull)]
        environment = os.environ | {"LIBSUMO_AS_TRACI": "quiet"}
        return subprocess.Popen([str(part) for part in (*command, *options)], env=environment)

    return start
