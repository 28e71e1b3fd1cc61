"""A generated case is a case as the program reads it."""

import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from experiments.blind_effects.generate import make_case, make_cases
from experiments.blind_effects.plan import CasePlan
from experiments.roads.road import ROADS
from jaxcalib.problem.problem import read_problem

REASON = "one generated case of twenty seconds is enough for a commit"


@pytest.mark.long
@pytest.mark.parametrize(
    ("road", "drives"), [("two_lane", 3), pytest.param("drawn-5", 3, marks=pytest.mark.nightly(REASON))]
)
def test_the_program_reads_a_generated_case(road: str, drives: int, tmp_path: Path):
    plan = CasePlan("0badcafe", road, "single", (("sensor_noise", "medium"),), "IDM", 31)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        label = make_case(plan, tmp_path, drives, 0, 0, pool)
    assert label["effects"][0]["effect"] == "sensor_noise"
    problem = read_problem(tmp_path / "cases" / "0badcafe")
    roles = [drive.role for drive in problem.case.drives]
    assert roles == ["fit", "fit", "held_out"]
    assert len(problem.drives) == len(problem.field_tally) == drives
    assert np.any(np.asarray(problem.field_tally) > 0.0)
    everything = "".join(file.read_text(errors="ignore") for file in tmp_path.rglob("*.[tx][om]*"))
    assert "sensor_noise" not in everything
    assert not list(tmp_path.rglob("label*"))


def test_lanes_and_places_follow_the_route():
    road = ROADS["two_lane"]
    begins = [road.places[f"{edge}_0"].begin_m for edge in road.ego_edges]
    assert np.all(np.diff(begins) > 50.0)
    assert road.places["m3_2"].number == 3
    assert road.places["m3_2"].from_left == road.places["m2_1"].from_left == 0
    assert road.place_m("m0")[0] == pytest.approx(0.2, abs=0.1)  # the junction after the entry edge
    assert "on1_0" not in road.places


def test_a_key_among_the_cases_is_refused(tmp_path: Path):
    with pytest.raises(ValueError, match="expected outside"):
        make_cases(tmp_path, tmp_path / "key.json", "tiny", ("corridor",), 0, 2, 0, 0, 1)


def test_the_key_of_another_plan_is_refused(tmp_path: Path):
    key = tmp_path / "key.json"
    key.write_text(json.dumps({"seed": 1, "settings": {"size": "full"}, "cases": {}}))
    with pytest.raises(ValueError, match="expected the key of this plan"):
        make_cases(tmp_path / "cases", key, "tiny", ("corridor",), 0, 2, 0, 0, 1)
