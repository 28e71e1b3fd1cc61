"""The range that logs show, where it is well below the stated one: made-up objects, and a drive that is cut short."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from jaxcalib.case.case import Perception
from jaxcalib.field.seen_range import FEWEST_ROWS, range_warnings, seen_perception
from jaxcalib.problem.problem import read_problem
from tests.copies import copy_corridor

STATED = Perception(150.0, 120.0, 4.8)
CUT_M = 60.0


def drives(ahead_m: float, behind_m: float, num_rows: int = 12 * FEWEST_ROWS) -> list:
    offset_m = np.random.default_rng(3).uniform(-behind_m, ahead_m, num_rows)
    halves = np.array_split(offset_m, 2)
    return [SimpleNamespace(objects=SimpleNamespace(offset_m=half)) for half in halves]


@pytest.mark.parametrize(
    ("ahead_m", "behind_m", "expected"),
    [
        (149.9, 119.0, STATED),
        (150.0 * 0.88, 120.0 * 0.88, STATED),  # a sensor whose scale is wrong by an eighth
        (54.3, 119.0, dataclasses.replace(STATED, ahead_m=55.0)),
        (149.0, 43.6, dataclasses.replace(STATED, behind_m=44.0)),
        (149.0, 0.0, dataclasses.replace(STATED, behind_m=1.0)),  # sensors that look ahead only
    ],
)
def test_a_range_is_taken_from_the_logs_only_where_it_is_well_below(
    ahead_m: float, behind_m: float, expected: Perception
):
    assert seen_perception(drives(ahead_m, behind_m), STATED) == expected


def test_few_objects_say_nothing_and_none_do_no_harm():
    assert seen_perception(drives(50.0, 40.0, num_rows=FEWEST_ROWS), STATED) == STATED
    assert seen_perception([], STATED) == STATED


def test_the_line_names_key_and_both_ranges():
    (line,) = range_warnings(STATED, dataclasses.replace(STATED, behind_m=44.0))
    assert re.search(r"perception\.behind_m is 120.*44 m", line)
    assert range_warnings(STATED, STATED) == ()


def test_a_case_is_measured_with_what_its_sensors_saw(tmp_path: Path):
    folder = copy_corridor(tmp_path / "corridor", "d01", "d02")
    for file in (folder / "field").glob("*_objects.csv.gz"):
        objects = pd.read_csv(file)
        objects[objects["relative_x_m"].abs() < CUT_M].to_csv(file, index=False)
    seen, stated = read_problem(folder), read_problem(folder, as_stated=True)
    assert seen.case.perception.ahead_m == CUT_M
    assert all(drive.ahead_m == CUT_M for drive in seen.drives)
    assert sum("perception" in line for line in seen.warnings()) == 2
    assert stated.case.perception.ahead_m > 2 * CUT_M
    assert not any("perception" in line for line in stated.warnings())
