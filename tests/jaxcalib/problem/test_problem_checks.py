"""What a case is refused for, or warned of, once scenario and drives are read; on copies of a real one."""

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.problem.problem import read_problem
from tests.copies import copy_corridor


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a copy with two drives."""
    return copy_corridor(tmp_path / "corridor", "d01", "d02")


def change(folder: Path, pattern: str, what: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    for file in sorted((folder / "field").glob(pattern)):
        what(pd.read_csv(file)).to_csv(file, index=False)


def test_drives_that_detect_nobody_are_no_field(folder: Path):
    change(folder, "*_objects.csv.gz", lambda table: table[:0])
    with pytest.raises(CaseError, match=r"d01_objects\.csv\.gz: expected rows in one of the drives with role"):
        read_problem(folder)
    case = folder / "case.toml"
    case.write_text(case.read_text() + "\n[log]\nempty_road = true\n")
    with pytest.raises(CaseError, match=r"d01_objects\.csv\.gz: expected detected vehicles in one of the drives"):
        read_problem(folder)


def test_one_drive_that_detects_nobody_is_no_empty_road_unless_the_case_says_so(folder: Path):
    change(folder, "d02_objects.csv.gz", lambda table: table[:0])
    problem = read_problem(folder)
    assert "d02" not in {drive.id for drive in problem.drives}
    assert any("drive d02 is left out" in line and "empty_road" in line for line in problem.warnings())
    case = folder / "case.toml"
    case.write_text(case.read_text() + "\n[log]\nempty_road = true\n")
    problem = read_problem(folder)
    assert "d02" in {drive.id for drive in problem.drives}
    assert any("d02_objects.csv.gz: no rows" in line for line in problem.warnings())


def test_a_drive_between_two_instants_is_refused(folder: Path):
    def shorten(table: pd.DataFrame) -> pd.DataFrame:
        first_s = table["time_s"].iloc[0]
        later = table["time_s"] > int(first_s) + 1.0
        return table[later & (table["time_s"] < int(first_s) + 1.5)]

    change(folder, "d01_*.csv.gz", shorten)
    with pytest.raises(CaseError, match=r"d01_subject\.csv\.gz: expected rows at the instants that count"):
        read_problem(folder)


def test_a_log_of_half_the_route_is_told(folder: Path):
    change(folder, "d02_*.csv.gz", lambda table: table[table["time_s"] < table["time_s"].iloc[0] + 60.0])
    (line,) = [line for line in read_problem(folder).warnings() if "of the route" in line]
    assert re.match(r"drive d02: the log covers 1?\d{3} of 3\d{3} m", line)


def test_an_input_without_vehicles_is_refused(folder: Path):
    (file,) = folder.rglob("*.rou.xml")
    flows = re.sub(
        r'(<flow id="f_on1[^>]*?)(period|vehsPerHour|probability)="[^"]*"', r'\1vehsPerHour="0"', file.read_text()
    )
    file.write_text(flows)
    with pytest.raises(CaseError, match=r"SUMO refuses the scenario: .*f_on1"):
        read_problem(folder)
