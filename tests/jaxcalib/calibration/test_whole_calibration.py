"""The whole command with few runs, on one kilometre and on the corridor: contract, a kill, the scenario handed over."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from experiments.small_case import TRUE_INPUTS_VEHPH, TRUTH
from jaxcalib.calibration.objective.accuracy import TRAFFIC_LEVEL, VEHICLE_LEVEL
from tests.places import CORRIDOR

BUDGET = "0.05"
SEARCH_PARTS = slice(4, 8)  # of the journal of a whole run: some of the search in the surrogate
LAST_PARTS = 0.25  # share of them: some of the runs in SUMO
LONGEST_S = 900.0
TIMES = ("wall_s", "timing")
REASON = (
    "three calibrations of the corridor, of which SUMO's runs alone take minutes; every commit makes a shorter road's"
)

pytestmark = pytest.mark.long


def command(case: Path, out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "jaxcalib", "calibrate", str(case), "--out", str(out), "--budget", BUDGET, *more]


@pytest.fixture(scope="module", params=["small", pytest.param("corridor", marks=pytest.mark.nightly(REASON))])
def case(request: pytest.FixtureRequest, small_case: Path) -> Path:
    return small_case if request.param == "small" else CORRIDOR


@pytest.fixture(scope="module")
def out(
    case: Path, tmp_path_factory: pytest.TempPathFactory, on_all_cores: Callable[[], AbstractContextManager[None]]
) -> Path:
    folder = tmp_path_factory.mktemp("calibration") / "run"
    with on_all_cores():
        done = subprocess.run(command(case, folder), capture_output=True, text=True, timeout=LONGEST_S, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.fixture(scope="module")
def result(out: Path) -> dict:
    return json.loads((out / "result.json").read_text())


def test_result_keeps_the_contract(result: dict):
    assert result["format"] == 1
    assert set(result["parameters"]["demand"]) == {"main", "on1"}
    assert "tau" in result["parameters"]["behaviour"]["car"]
    assert result["critical_parameters"]
    for source in ("field", "surrogate", "sumo"):
        assert set(result["mops"][source]) == {"fit", "held_out"}
    for kind in ("no_calibration", "calibrated", "noise_floor"):
        for role in ("fit", "held_out"):
            assert set(result["moes"][kind][role]) == {*VEHICLE_LEVEL, *TRAFFIC_LEVEL}
    assert result["runs"]["surrogate"] > 100
    assert result["runs"]["sumo"] > 10
    assert set(result["health"]) == {"calibrated", "uncalibrated", "confirmation", "surrogate"}
    for who, one in result["health"].items():
        assert one["runs"] > one["failed"] == 0
        # so short a scenario ends before one of the surrogate's 32 drives now and then
        assert one["unfinished"] <= (1 if who == "surrogate" else 0)
    parts = {"total", "compile", "stage1", "stage2_exploration", "stage2_optimisation", "confirmation"}
    assert parts <= set(result["wall_s"])


def test_calibration_comes_closer_to_drives_that_it_never_saw(case: Path, result: dict):
    """Only errors with many observations: so few runs leave those of rare events to chance.

    Drives of a minute differ from one another by two thirds of what the calibration gains.
    """
    frequent = ("subject_time_headway", "background_time_headway", "traffic_speed", "traffic_dynamics")
    before, after = (
        sum(result["moes"][kind]["held_out"][name] for name in frequent) for kind in ("no_calibration", "calibrated")
    )
    assert after < (0.5 if case == CORRIDOR else 0.8) * before


def test_the_field_s_drivers_are_found(case: Path, result: dict):
    """Within what six drives of a minute tell: a tenth of the time gap, a twentieth of the speed.

    The scenario has 1.1 s, 0.97 and 2700 veh/h.
    """
    if case == CORRIDOR:
        pytest.skip("nobody knows its field's drivers")
    driver = result["parameters"]["behaviour"]["car"]
    assert driver["tau"] == pytest.approx(TRUTH["tau"], rel=0.1)
    assert driver["speedFactor"] == pytest.approx(TRUTH["speedFactor"], rel=0.05)
    # six minutes with 33 vehicles each: two standard errors are 14 %
    assert result["parameters"]["demand"]["main"] == pytest.approx(TRUE_INPUTS_VEHPH["main"], rel=0.14)


def test_report_is_one_file_without_scripts(out: Path):
    text = (out / "report.html").read_text()
    assert text.count("<svg") >= 6
    assert "<script" not in text
    assert "http" not in text.replace("http-equiv", "").replace("http://www.w3.org", "").replace(
        "https://www.w3.org", ""
    )


def test_a_run_that_was_killed_gives_the_result_it_would_have_given(
    case: Path, out: Path, result: dict, tmp_path: Path, on_all_cores: Callable[[], AbstractContextManager[None]]
):
    """It begins with most of a whole run's journal, so that few runs are repeated: killed within the search."""
    folder = tmp_path / "run"
    shutil.copytree(out, folder, ignore=shutil.ignore_patterns("result.json", "report.html", "scenario"))
    parts = sorted((folder / "journal").glob("part-*.npz"))
    missing = {*parts[SEARCH_PARTS], *parts[-round(LAST_PARTS * len(parts)) :]}
    for part in missing:
        part.unlink()
    num_kept = len(parts) - len(missing)
    with on_all_cores():
        process = subprocess.Popen(command(case, folder, "--resume"), stderr=subprocess.DEVNULL, start_new_session=True)
    deadline = time.monotonic() + LONGEST_S
    while len(list((folder / "journal").glob("part-*.npz"))) <= num_kept:
        assert process.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < deadline
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (folder / "result.json").exists()
    with on_all_cores():
        done = subprocess.run(
            command(case, folder, "--resume"), capture_output=True, text=True, timeout=LONGEST_S, check=False
        )
    assert done.returncode == 0, done.stderr[-3000:]
    again = json.loads((folder / "result.json").read_text())
    for times in TIMES:
        again.pop(times), result.pop(times, None)
    assert again == {key: value for key, value in result.items() if key not in TIMES}


@pytest.mark.nightly(
    "twenty seconds; at commits a worker is killed under single runs, validations and sweeps on a cluster"
)
def test_runs_that_a_cluster_makes_give_the_same_result(
    case: Path, out: Path, result: dict, tmp_path: Path, address: str, workers: list[subprocess.Popen[bytes]]
):
    """It begins with most of a whole run's journal; one of the workers is killed."""
    folder = tmp_path / "run"
    shutil.copytree(out, folder, ignore=shutil.ignore_patterns("result.json", "report.html", "scenario"))
    parts = sorted((folder / "journal").glob("part-*.npz"))
    missing = parts[-round(LAST_PARTS * len(parts)) :]  # of SUMO, each of which is a run
    for part in missing:
        part.unlink()
    process = subprocess.Popen(command(case, folder, "--resume", "--quiet", "--cluster", address))
    while process.poll() is None and not missing[1].exists():
        time.sleep(0.05)
    workers[1].kill()
    assert process.wait(LONGEST_S) == 0
    assert missing[-1].exists()
    again = json.loads((folder / "result.json").read_text())
    keys = [key for key in again if key not in TIMES]
    assert {key: again[key] for key in keys} == {key: result[key] for key in keys}


def test_the_scenario_handed_over_runs_in_plain_sumo_bit_for_bit_like_the_confirming_run(
    case: Path, out: Path, tmp_path: Path
):
    """Both write positions of all vehicles with the same seed; the confirming run writes its files itself."""
    from jaxcalib.problem.problem import read_problem
    from sim_adapters.scenario.scenario_writer import write_scenario

    values = json.loads((out / "result.json").read_text())["parameters"]
    problem = read_problem(case)
    first_s = problem.drive_starts("fit")[0].depart_s
    vector = [*values["demand"].values(), *values["behaviour"]["car"].values()]
    written = write_scenario(problem.scenario, problem.layout, vector, first_s, "ego", tmp_path, "run")
    traces = []
    for number, config in enumerate((out / "scenario" / "calibrated.sumocfg", written.config)):
        trace = tmp_path / f"fcd{number}.csv"
        program = (
            "import libsumo;"
            f"libsumo.start(['sumo','-c',{str(config)!r},'--seed','7','--fcd-output',{str(trace)!r},"
            f"'--end','{first_s + 30.0}','--no-step-log','--fcd-output.max-leader-distance','-1']);"
            f"[libsumo.simulationStep() for _ in range({round(10.0 * first_s) + 300})];libsumo.close()"
        )
        subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, timeout=300)
        traces.append(trace.read_bytes())
    assert len(traces[0]) > 2500.0 * (first_s + 30.0)  # bytes
    assert traces[0] == traces[1]
