"""Validations in SUMO, as a person calls them."""

import json
from pathlib import Path

import numpy as np
import pytest

from jaxcalib.cli.app import validate as command
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.counts import FieldCounts
from jaxcalib.validation.observer import DriveObserver
from sim_adapters.interface import RunRequest, Status

COUNTS = "edge,begin_s,end_s,vehicles\nm2,60,170,60\n"


@pytest.mark.long
def test_the_scenario_before_calibration_is_not_valid(small_case: Path, tmp_path: Path):
    """The scenario's drivers are too fast for their field; four rounds of drives are enough to see that."""
    problem = read_problem(small_case)
    values, layout = problem.template.base_values().tolist(), problem.layout
    behaviour = dict(zip(layout.attributes, values[2:], strict=True))
    parameters = {"demand": dict(zip(layout.input_ids, values, strict=False)), "behaviour": {"car": behaviour}}
    (tmp_path / "result.json").write_text(json.dumps({"format": 1, "parameters": parameters}))
    (tmp_path / "counts.csv").write_text(COUNTS)
    assert command(small_case, tmp_path, seeds=4, counts=tmp_path / "counts.csv", half_step=True, quiet=True) == 0
    found = json.loads((tmp_path / "validation" / "validation.json").read_text())
    assert found["is_valid"] is False
    assert found["drives"] == ["d04", "d08"]
    assert found["runs"] == 4 * 2 + 4 + 4 * 2
    halved = found["step_error"]
    step_s = problem.parts.scenario.step_s
    assert (halved["half_step_s"], halved["step_s"]) == (0.5 * step_s, step_s)
    assert (halved["runs"], halved["num_rounds"]) == (8, 4)
    assert set(halved["quantities"]) == set(found["equivalence"])
    speed = halved["quantities"]["traffic_speed_mps"]
    assert speed["step"] == found["equivalence"]["traffic_speed_mps"]["simulated"]
    assert speed["difference"] == pytest.approx(speed["step"] / speed["half_step"] - 1.0, abs=1e-5)
    assert abs(speed["difference"]) < 0.1
    one = found["measures"]["traffic_speed_mps"]
    assert one["interval_90"][0] < one["interval_90_of_mean"][0] < one["simulated"] < one["interval_90"][1]
    assert found["health"]["teleports"] == 0
    assert found["counts"][0]["simulated_vehph"] == pytest.approx(
        values[0], rel=0.11
    )  # four runs count 330 vehicles: 2 standard deviations
    names = {criterion["standard"] for criterion in found["criteria"]}
    assert len(names) >= 3
    page = (tmp_path / "validation" / "validation.html").read_text()
    assert "not valid" in page
    assert "<script" not in page
    assert command(small_case, tmp_path, seeds=4, counts=tmp_path / "counts.csv", quiet=True) == 2  # begun: --resume


@pytest.mark.long
def test_half_the_step_has_twice_as_many(small_problem: CalibrationProblem):
    """Frames stay as far apart, so that measures are those of the same instants."""
    problem, step_s = small_problem, small_problem.parts.scenario.step_s
    request = RunRequest(tuple(problem.template.base_values().tolist()), 11, 70.0)
    outcomes = []
    for length_s in (step_s, 0.5 * step_s):
        with sumo_engine(problem, 1, step_s=length_s) as sumo:
            outcomes += sumo.run([request])
    whole, half = outcomes
    assert whole.status is half.status is Status.OK
    assert half.num_vehicle_steps / whole.num_vehicle_steps == pytest.approx(2.0, rel=0.1)
    frames = problem.tally_names.index("subject_frames")
    assert half.observed[frames] == pytest.approx(whole.observed[frames], rel=0.1)


@pytest.mark.long
def test_counting_and_observing_in_sumo(small_problem: CalibrationProblem):
    """Vehicles that have passed the first edge are those that entered it, less those still on it; the same run."""
    problem = small_problem
    request = RunRequest(tuple(problem.template.base_values().tolist()), 11, 70.0)
    whole = FieldCounts((("m2", 0.0, 180.0), ("m2", 0.0, 60.0), ("m2", 60.0, 180.0)), np.zeros((1, 3)))
    with sumo_engine(problem, 1, counter=whole) as sumo:
        (counted,) = sumo.run([request])
    with sumo_engine(problem, 1, fold=DriveObserver(problem)) as sumo:
        (observed,) = sumo.run([request])
    assert counted.status is observed.status is Status.OK
    assert counted.observed[0] == counted.observed[1] + counted.observed[2]
    inserted = counted.num_inserted[0] + 1  # the subject vehicle is no vehicle of a flow
    assert 0 <= inserted - counted.observed[0] <= 60
    parts = DriveObserver(problem).parts(observed.observed)
    tally = dict(zip(problem.tally_names, parts.tally, strict=True))
    driven_s = np.nanmax(parts.passing_s) - np.nanmin(parts.passing_s)
    assert 0.0 <= tally["subject_time_s"] - driven_s <= 5.0  # before the first border and behind the last one
    assert parts.histograms["subject_speed_mps"].sum() == tally["subject_frames"]
    assert parts.histograms["background_time_headway_s"].sum() == pytest.approx(
        tally["background_following_frames"], rel=0.01
    )
