"""What a validation reads: RUN, counts, and what it refuses."""

import dataclasses
import json
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from jaxcalib.calibration.stages.evaluator import AllRunsFailedError
from jaxcalib.errors import CaseError
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.validation.calibrated_run import CalibratedRun, read_calibrated_run
from jaxcalib.validation.counts import count_criteria, count_volumes, read_counts
from jaxcalib.validation.rounds import complete_rounds, round_requests
from jaxcalib.validation.validate import validate
from sim_adapters.interface import DriveStart, ParameterLayout, RunOutcome, RunRequest, Status
from tests.places import CORRIDOR


@pytest.fixture(scope="module")
def problem() -> CalibrationProblem:
    return read_problem(CORRIDOR)


def result_of(problem: CalibrationProblem) -> dict:
    values, layout = problem.template.base_values().tolist(), problem.layout
    behaviour = dict(zip(layout.attributes, values[2:], strict=True))
    demand = dict(zip(layout.input_ids, values, strict=False))
    return {"format": 1, "parameters": {"demand": demand, "behaviour": {"car": behaviour}}, "seeds": {"search": 7}}


def test_calibrated_values_come_in_the_order_of_the_layout(problem: CalibrationProblem, tmp_path: Path):
    (tmp_path / "result.json").write_text(json.dumps(result_of(problem)))
    found = read_calibrated_run(tmp_path, problem)
    np.testing.assert_allclose(found.values, problem.template.base_values())
    assert found.first_seed == 7
    assert "run.json" in found.warnings[0]


# the first of the first group is not the first of all, and vans want twice its time gap
APART = ParameterLayout(
    ("main", "on1"), (("f",), ("g",)), ("van", "truck", "car"), ("tau", "minGap"),
    factors=((2.0, 1.0), (1.0, 1.0), (1.0, 1.0)), most=(math.inf, math.inf), groups=(("car", "van"), ("truck",)),
)  # fmt: skip
VALUES_APART = (2900.0, 410.0, 1.1, 2.2, 1.9, 3.1)


def apart_result() -> dict:
    behaviour = {vtype: APART.values_of(vtype, VALUES_APART[2:]) for vtype in APART.vtypes}
    return {"format": 1, "parameters": {"demand": {"main": 2900.0, "on1": 410.0}, "behaviour": behaviour}}


def with_layout(problem: CalibrationProblem, layout: ParameterLayout) -> CalibrationProblem:
    return dataclasses.replace(problem, template=dataclasses.replace(problem.template, layout=layout))


def test_each_group_s_values_are_read_back(problem: CalibrationProblem, tmp_path: Path):
    (tmp_path / "result.json").write_text(json.dumps(apart_result()))
    assert read_calibrated_run(tmp_path, with_layout(problem, APART)).values == VALUES_APART


@pytest.mark.parametrize(
    "layout",
    [
        dataclasses.replace(APART, groups=(("car", "van", "truck"),)),  # the case lets all move together
        dataclasses.replace(APART, factors=(), most=()),  # or gives vans the values of cars
    ],
)
def test_values_that_the_case_cannot_mean_are_refused(
    layout: ParameterLayout, problem: CalibrationProblem, tmp_path: Path
):
    (tmp_path / "result.json").write_text(json.dumps(apart_result()))
    with pytest.raises(CaseError, match=r"behaviour\.(van|truck): expected values that follow from those of \"car\""):
        read_calibrated_run(tmp_path, with_layout(problem, layout))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda found: found.update(format=2), "format"),
        (lambda found: found.pop("parameters"), "demand"),
        (lambda found: found["parameters"]["demand"].pop("on1"), "parameters.demand: expected those of the case"),
        (lambda found: found["parameters"]["demand"].update(main=None), "parameters.demand.main: expected a number"),
        (lambda found: found["parameters"].update(behaviour={"truck": {}}), "vTypes of the case, car"),
        (lambda found: found["parameters"]["behaviour"]["car"].pop("tau"), "parameters.behaviour"),
    ],
)
def test_results_that_are_refused(problem: CalibrationProblem, tmp_path: Path, change, says: str):
    found = result_of(problem)
    change(found)
    (tmp_path / "result.json").write_text(json.dumps(found))
    with pytest.raises(CaseError, match=re.escape(says)):
        read_calibrated_run(tmp_path, problem)


def test_a_run_without_result_is_refused_before_anything_is_written(tmp_path: Path):
    with pytest.raises(CaseError, match=r"result\.json: expected the result of a calibration"):
        validate(CORRIDOR, tmp_path)
    assert not list(tmp_path.iterdir())
    with pytest.raises(CaseError, match="--seeds"):
        validate(CORRIDOR, tmp_path, seeds=2)


def test_no_two_runs_share_a_seed():
    starts = (DriveStart(300.0), DriveStart(320.0, 5), DriveStart(300.0, 3))
    requests = round_requests(CalibratedRun((1.0,), 3_000_000, ()), starts, 4)
    assert [one.seed for one in requests] == list(range(3_500_000, 3_500_012))
    assert [one.drive_start for one in requests] == [*starts] * 4


def test_a_round_with_a_failed_run_is_left_out():
    def outcome(number: int, fails: bool) -> RunOutcome:
        none = np.zeros(1)
        status = Status.FAILED if fails else Status.OK
        return RunOutcome(RunRequest((1.0,), number, 0.0), status, None if fails else np.full(2, number), none, none, 0)

    outcomes = [outcome(number, number == 3) for number in range(8)]
    rounds = complete_rounds(outcomes, 2)
    assert rounds[:, :, 0].tolist() == [[0, 1], [4, 5], [6, 7]]
    with pytest.raises(AllRunsFailedError, match="but 2 rounds"):
        complete_rounds([outcome(number, number in (3, 4)) for number in range(8)], 2)


COUNTS = """edge,begin_s,end_s,vehicles,day
in0,300,420,130,monday
in0,420,540,140,monday
in0,300,420,120,tuesday
in0,420,540,150,tuesday
in0,300,420,126,friday
in0,420,540,144,friday
m1,300,600,310,monday
"""


def test_counts(problem: CalibrationProblem, tmp_path: Path):
    file = tmp_path / "counts.csv"
    file.write_text(COUNTS)
    counts = read_counts(file, problem)
    assert counts.edges == ("in0", "m1")
    assert counts.vehicles.shape == (3, 3)
    passed = {"in0": np.asarray([280.0, 300.0, 301.0, 420.0, 420.1, 580.0]), "m1": np.asarray([300.1, 599.0])}
    assert counts(passed).tolist() == [2.0, 1.0, 2.0]  # begin excluded, end included: no vehicle counts twice
    volumes = count_volumes(counts, np.asarray([[124.0, 148.0, 300.0], [128.0, 140.0, 320.0]]))
    assert volumes[0].field_vehph == pytest.approx(30 * (130 + 120 + 126) / 3)
    assert volumes[0].simulated_vehph == pytest.approx(30 * 126)
    assert volumes[2].field_vehph == pytest.approx(12 * 310)
    criteria = count_criteria(counts, np.asarray([[124.0, 148.0, 300.0], [128.0, 140.0, 320.0]]))
    assert len(criteria) == 4 + 4 + 1  # those of 2019 for in0 only: m1 was counted on one day
    assert all(one.passes for one in criteria[:-1])
    assert (criteria[-1].passes, criteria[-1].name.endswith("volume at m1")) == (None, True)
    assert "120 s" in criteria[0].note


def test_an_interval_more_on_one_day_costs_an_edge_nothing(problem: CalibrationProblem, tmp_path: Path):
    file = tmp_path / "counts.csv"
    file.write_text(COUNTS.replace("m1,300,600,310", "in0,540,660,144"))
    counts = read_counts(file, problem)
    criteria = count_criteria(counts, np.asarray([[124.0, 148.0, 140.0], [128.0, 140.0, 140.0]]))
    assert [one.passes for one in criteria] == [True] * 8


def test_vehicles_are_not_counted_on_an_edge_shorter_than_their_step(problem: CalibrationProblem, tmp_path: Path):
    short = SimpleNamespace(getLength=lambda: 1.5, getSpeed=lambda: 33.0, getLaneNumber=lambda: 3)
    net = SimpleNamespace(getEdge=lambda edge: short)
    scenario = dataclasses.replace(problem.scenario, network=dataclasses.replace(problem.scenario.network, net=net))
    known = cast(CalibrationProblem, SimpleNamespace(scenario=scenario, parts=problem.parts))
    file = tmp_path / "counts.csv"
    file.write_text(COUNTS)
    with pytest.raises(CaseError, match="expected an edge of 4 m or more, the way of a step"):
        read_counts(file, known)


def test_one_day_of_counts_is_not_enough_for_2019(problem: CalibrationProblem, tmp_path: Path):
    file = tmp_path / "counts.csv"
    file.write_text("edge,begin_s,end_s,vehicles\nin0,300,600,300\n")
    criteria = count_criteria(read_counts(file, problem), np.asarray([[310.0]]))
    assert criteria[-1].passes is None
    assert "3 days" in criteria[-1].note


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("nowhere,300,600,5,a", "row 2, column edge: expected an edge"),
        ("in0,240,600,5,a", "row 2, column begin_s: expected intervals after the warm-up (300 s)"),
        ("in0,300,600,1500,a", "row 2, column vehicles: expected at most 750, what 3 lanes carry in 300 s"),
        ("in0,300,300,5,a", "row 2, column begin_s"),
        ("in0,300,99999,5,a", "720, the scenario's end"),
        ("in0,300,600,-5,a", "row 2, column vehicles"),
        ("in0,300,600,,a", "row 2, column vehicles"),
        ("in0,300,600,5,a\nin0,300,600,6,a", "row 3: expected edge"),
        ("", "at least one row"),
    ],
)
def test_counts_that_are_refused(problem: CalibrationProblem, tmp_path: Path, row: str, says: str):
    file = tmp_path / "counts.csv"
    file.write_text(f"edge,begin_s,end_s,vehicles,day\n{row}\n")
    with pytest.raises(CaseError, match=re.escape(says)):
        read_counts(file, problem)
