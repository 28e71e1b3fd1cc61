"""The columns of the two tables, their units, and values that a quantity cannot have."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxcalib.errors import LONGEST_MESSAGE, CaseError
from jaxcalib.field.log_tables import LANE_UNKNOWN, ObjectLog, SubjectLog, read_object_log, read_subject_log

SUBJECT = """\
time_s,road,speed_limit_kmh,speed_kmh,yaw_rate_radps,longitude_rad,latitude_rad,acceleration_mps2,lane,lane_offset_m
10.0,a,80,36,0.01,2.187,0.766,-1.5,1,-1.88
10.5,,80,54,,2.187,0.766,,,
11.0,a,80,72,0.03,2.187,0.766,0.5,2,1.2
"""
OBJECTS = """\
time_s,vehicle_id,lane,relative_x_m,relative_y_m,speed_kmh,heading_deg
10.5,7,2,20.5,3.75,36,180
10.0,10,,-3,,,
10.0,7,1,20,0,18,0
"""


def write(folder: Path, content: str) -> Path:
    (folder / "t.csv").write_text(content)
    return folder / "t.csv"


def message(read: Callable[[], SubjectLog | ObjectLog]) -> str:
    with pytest.raises(CaseError) as error:
        read()
    line = str(error.value)
    assert len(line) <= LONGEST_MESSAGE
    assert line.isprintable()
    return line


def test_subject_table_in_si_units(tmp_path: Path):
    log = read_subject_log(write(tmp_path, SUBJECT))
    np.testing.assert_array_equal(log.time_s, [10.0, 10.5, 11.0])
    np.testing.assert_allclose(log.speed_mps, [10.0, 15.0, 20.0], rtol=1e-12)
    np.testing.assert_allclose(log.speed_limit_mps, 80 / 3.6, rtol=1e-12)
    np.testing.assert_array_equal(log.yaw_rate_radps, [0.01, np.nan, 0.03])
    np.testing.assert_array_equal(log.acceleration_mps2, [-1.5, np.nan, 0.5])
    np.testing.assert_array_equal(log.lane, [1, LANE_UNKNOWN, 2])
    np.testing.assert_array_equal(log.lane_offset_m, [-1.88, np.nan, 1.2])
    assert log.road.tolist() == ["a", "", "a"]
    assert log.sampling_s == 0.5
    assert log.extra_columns == ()


def test_object_table_in_si_units(tmp_path: Path):
    log = read_object_log(write(tmp_path, OBJECTS))
    assert log.vehicle_ids == ("10", "7")
    np.testing.assert_array_equal(log.vehicle, [1, 0, 1])
    np.testing.assert_allclose(log.speed_mps, [10.0, np.nan, 5.0], rtol=1e-12)
    np.testing.assert_allclose(log.heading_rad, [np.pi, np.nan, 0.0], rtol=1e-12)
    np.testing.assert_array_equal(log.lane, [2, LANE_UNKNOWN, 1])
    np.testing.assert_array_equal(log.relative_y_m, [3.75, np.nan, 0.0])


def test_object_table_may_be_empty(tmp_path: Path):
    log = read_object_log(write(tmp_path, OBJECTS.splitlines()[0] + "\n"))
    assert len(log.time_s) == 0
    assert log.vehicle_ids == ()


def test_unknown_columns_are_named(tmp_path: Path):
    lines = SUBJECT.splitlines()
    content = "\n".join([lines[0] + ",weather,note", *(line + ",sun,x" for line in lines[1:])])
    assert read_subject_log(write(tmp_path, content)).extra_columns == ("weather", "note")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("10.5,,", "9.5,,", "row 3, column time_s: expected time_s to increase, got 9.5, less."),
        ("10.5,,", "10,,", "row 3, column time_s: expected time_s to increase, got 10, the same time again."),
        ("10.5,,", ",,", "row 3, column time_s: expected a time, got nothing."),
        ("10.0,a", "8.9,a", "row 2, column time_s: expected 9 to 100 on the scenario's clock, got 8.9."),
        ("11.0,a", "100.5,a", "row 4, column time_s: expected 9 to 100 on the scenario's clock, got 100.5."),
        ("11.0,a", "14.0,a", "column time_s: expected 1 to 25 rows per second, got 0.5."),
        ("80,36", "80,-36", "row 2, column speed_kmh: expected a speed of 0 to 400 km/h, got -36."),
        ("80,36", "80,401", "row 2, column speed_kmh: expected a speed of 0 to 400 km/h, got 401."),
        ("10.0,a,80", "10.0,a,-80", "row 2, column speed_limit_kmh: expected a speed of 0 to 400 km/h, got -80."),
        ("0.01,2.187", "0.01,125.3", "row 2, column longitude_rad: expected radians, -pi to pi, got 125.3."),
        (
            "0.01,2.187,0.766",
            "0.01,2.187,43.9",
            "row 2, column latitude_rad: expected radians, -pi/2 to pi/2, got 43.9.",
        ),
        ("-1.5,1,", "-1.5,0,", "row 2, column lane: expected a whole number from 1 (rightmost), got 0."),
        ("-1.5,1,", "-1.5,1.5,", "row 2, column lane: expected a whole number from 1 (rightmost), got 1.5."),
        ("-1.5,1,", "-1.5,1e300,", "row 2, column lane: expected a whole number from 1 (rightmost), got 1e+300."),
        ("-1.5,1,", "-1.5,right,", 'row 2, column lane: expected a number or nothing, got "right".'),
    ],
)
def test_says_what_is_wrong_with_the_subject_table(tmp_path: Path, old: str, new: str, expected: str):
    assert old in SUBJECT
    content = SUBJECT.replace(old, new, 1)
    if new.startswith("14.0"):
        content = content.replace("10.5,,", "12.0,,")
    assert message(lambda: read_subject_log(write(tmp_path, content), 9.0, 100.0)) == f"t.csv: {expected}"


def test_refuses_too_fast_sampling(tmp_path: Path):
    header, row = SUBJECT.splitlines()[:2]
    rows = [row.replace("10.0,", f"{10 + 0.02 * i:.2f},", 1) for i in range(10)]
    line = message(lambda: read_subject_log(write(tmp_path, "\n".join([header, *rows]))))
    assert line == "t.csv: column time_s: expected 1 to 25 rows per second, got 50."


@pytest.mark.parametrize("step_s", [1.0, 0.04])
def test_accepts_the_slowest_and_the_fastest_sampling(tmp_path: Path, step_s: float):
    header, row = SUBJECT.splitlines()[:2]
    rows = [row.replace("10.0,", f"{10 + step_s * i:.2f},", 1) for i in range(10)]
    assert read_subject_log(write(tmp_path, "\n".join([header, *rows]))).sampling_s == pytest.approx(step_s)


def test_refuses_a_subject_table_of_one_row(tmp_path: Path):
    content = "\n".join(SUBJECT.splitlines()[:2])
    line = message(lambda: read_subject_log(write(tmp_path, content)))
    assert line == "t.csv: expected at least two rows of data, got 1."


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("10.0,10", "10.0,", "row 3, column vehicle_id: expected an id, got nothing."),
        ("10.0,10", "10.0,7", 'row 4: expected each vehicle once per time stamp, got vehicle "7" again at 10 s.'),
        ("10.0,10", "100.5,10", "row 3, column time_s: expected 9 to 100 on the scenario's clock, got 100.5."),
        ("3.75,36", "3.75,-1", "row 2, column speed_kmh: expected a speed of 0 to 400 km/h, got -1."),
        ("20.5,3.75", "far,3.75", 'row 2, column relative_x_m: expected a number or nothing, got "far".'),
        ("20.5,3.75", "inf,3.75", "row 2, column relative_x_m: expected a finite number, got inf."),
        ("10.5,7,2", "10.5,7,-2", "row 2, column lane: expected a whole number from 1 (rightmost), got -2."),
    ],
)
def test_says_what_is_wrong_with_the_object_table(tmp_path: Path, old: str, new: str, expected: str):
    assert old in OBJECTS
    file = write(tmp_path, OBJECTS.replace(old, new, 1))
    assert message(lambda: read_object_log(file, 9.0, 100.0)) == f"t.csv: {expected}"


def test_shows_ids_without_control_characters(tmp_path: Path):
    content = OBJECTS.replace(",7,", ",\x1b[2J,").replace("10.5,", "10.0,")
    line = message(lambda: read_object_log(write(tmp_path, content)))
    assert 'vehicle "[2J" again' in line


def test_reads_parquet_like_csv(tmp_path: Path):
    plain = read_subject_log(write(tmp_path, SUBJECT))
    pd.read_csv(tmp_path / "t.csv").to_parquet(tmp_path / "t.parquet")
    packed = read_subject_log(tmp_path / "t.parquet")
    np.testing.assert_array_equal(packed.place.first, plain.place.first)
    for name in ("time_s", "speed_mps", "lane", "acceleration_mps2"):
        np.testing.assert_array_equal(getattr(packed, name), getattr(plain, name))
    assert packed.road.tolist() == plain.road.tolist()
