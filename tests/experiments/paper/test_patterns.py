"""Traffic patterns: known parameters, and drives of SUMO that read back as what SUMO showed."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from experiments.paper import patterns
from experiments.paper.drive_writer import write_drives
from experiments.paper.patterns import DEMANDS, HELD_OUT_FACTOR, drawn_drivers, prepare_pattern, true_values
from jaxcalib.case.case import read_case
from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.parameter_space import parameter_space
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunRequest
from tests.places import CORRIDOR


@pytest.fixture(scope="module")
def problem() -> CalibrationProblem:
    return read_problem(CORRIDOR)


def test_patterns_share_their_drivers_and_differ_in_demand(problem: CalibrationProblem):
    num_inputs = problem.layout.num_inputs
    base = problem.template.base_values()[:num_inputs]
    values = np.stack([true_values(problem, demand) for demand in DEMANDS])
    assert (values[:, num_inputs:] == values[0, num_inputs:]).all()
    space = parameter_space(problem.layout, problem.model, base, 0.5, {})
    away = np.abs(space.unit_of(values[0]) - space.unit_of(problem.template.base_values()))[num_inputs:]
    assert away.min() > 0.19
    assert away.max() < 0.36
    for row, demand in zip(values, DEMANDS, strict=True):
        expected = base * demand.total * np.asarray([1.0, demand.ramps])
        np.testing.assert_allclose(row[:num_inputs], expected, rtol=1e-5)


def test_the_first_pattern_is_the_field_itself(problem: CalibrationProblem, tmp_path: Path):
    assert prepare_pattern(problem, 1, tmp_path) == problem.case.folder
    with pytest.raises(CaseError, match="--patterns"):
        prepare_pattern(problem, len(DEMANDS) + 1, tmp_path)


def test_a_pattern_that_was_begun_is_made_anew_and_one_that_is_there_is_kept(
    problem: CalibrationProblem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    made = []

    def write(problem: CalibrationProblem, values: list[float], first_seed: int, folder: Path) -> None:
        made.append(first_seed)
        for drive in problem.case.drives:
            for file in (drive.subject_file, drive.objects_file):
                (folder / file.relative_to(problem.case.folder)).touch()

    monkeypatch.setattr(patterns, "write_drives", write)
    monkeypatch.setattr(patterns, "first_crash_free_draw", lambda problem, values_of: 3)
    (tmp_path / "pattern-2").mkdir()
    folder = prepare_pattern(problem, 2, tmp_path)
    assert (folder / "case.toml").is_file()
    assert prepare_pattern(problem, 2, tmp_path) == folder
    assert len(made) == 1
    about = json.loads((folder / "pattern.json").read_text())
    held_out, again = problem.case.drives_of("held_out"), read_case(folder).drives_of("held_out")
    assert len(again) == about["held_out_drives"] == HELD_OUT_FACTOR * len(held_out)
    assert sorted(one.depart_s for one in again) == sorted(HELD_OUT_FACTOR * [one.depart_s for one in held_out])
    assert len({file for one in again for file in (one.subject_file, one.objects_file)}) == 2 * len(again)
    assert about["parameters"]["main"] == pytest.approx(0.7 * problem.template.base_values()[0])
    assert list(about["parameters"].values()) == true_values(problem, DEMANDS[1], 3).tolist()
    assert drawn_drivers(problem, tmp_path) == 3


@pytest.mark.long
def test_written_drives_read_back_as_what_sumo_showed(
    small_case: Path, small_problem: CalibrationProblem, tmp_path: Path
):
    """Logs at 0.1 s, matched and cleaned, show the tallies of the same SUMO runs folded directly."""
    problem = small_problem
    values = tuple(true_values(problem, DEMANDS[1]).tolist())
    two = dataclasses.replace(problem, case=dataclasses.replace(problem.case, drives=problem.case.drives[:2]))
    folder = tmp_path / "case"
    shutil.copytree(small_case, folder)
    write_drives(two, values, 77, folder, num_processes=1)
    with sumo_engine(problem, 1) as sumo:
        outcomes = sumo.run([RunRequest(values, 77 + n, drive.depart_s) for n, drive in enumerate(two.case.drives)])
    direct = np.stack([outcome.observed for outcome in outcomes])
    written = read_problem(folder)
    for name in ("vehicle_frames", "vehicle_speed", "subject_time_s", "subject_distance_m", "cut_ins"):
        if name in problem.tally_index:
            place = problem.tally_index[name]
            np.testing.assert_allclose(written.field_tally[:2, place], direct[:, place], rtol=0.02, err_msg=name)
    for name in ("traffic_speed_mps", "traffic_density_vehpkm", "subject_time_headway_s"):
        value = [
            problem.measures[name].value(dict(zip(problem.tally_names, tally.sum(axis=0), strict=True))).value
            for tally in (written.field_tally[:2], direct)
        ]
        assert value[0] == pytest.approx(value[1], rel=0.02), name
