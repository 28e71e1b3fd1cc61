"""A drive in tables with other names, units, clocks, lanes and points of vehicles is the same drive."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyproj
import pytest

from jaxcalib.case.case import Case, read_case
from jaxcalib.case.case_file import read_log_section
from jaxcalib.case.log_form import LogForm
from jaxcalib.case.log_units import log_form_of
from jaxcalib.errors import CaseError
from jaxcalib.field.field_log import DriveLog, read_drive
from sim_adapters.scenario.road_builder import RowMap

Tables = tuple[pd.DataFrame, pd.DataFrame]
Rewrite = Callable[[pd.DataFrame, pd.DataFrame], Tables]
OWN_M, OTHER_M = 5.6, 4.0  # lengths


@pytest.fixture
def form_of(tmp_path: Path) -> Callable[[str], LogForm]:
    def read(text: str) -> LogForm:
        file = tmp_path / "log.toml"
        file.write_text(text)
        return log_form_of(read_log_section(file)[0])

    return read


@pytest.fixture
def read(drive_case: Case, row_map: RowMap) -> Callable[..., DriveLog]:
    def write_and_read(tables: Tables, form: LogForm | None = None, time_zero: float | None = None) -> DriveLog:
        drive = replace(drive_case.drives[0], time_zero=time_zero)
        tables[0].to_csv(drive.subject_file, index=False)
        tables[1].to_csv(drive.objects_file, index=False)
        case = replace(drive_case, log_form=form or LogForm(), drives=(drive,))
        return read_drive(case, drive, row_map)

    return write_and_read


def assert_same(found: DriveLog, expected: DriveLog, tolerance: float = 1e-6) -> None:
    for mine, theirs in ((found.subject, expected.subject), (found.objects, expected.objects)):
        for name in mine.__dataclass_fields__:
            given, wanted = getattr(mine, name), getattr(theirs, name)
            np.testing.assert_allclose(given, wanted, atol=tolerance, err_msg=name)
    np.testing.assert_allclose(found.yaw_rate_radps, expected.yaw_rate_radps)
    assert (found.counts, found.warnings) == (expected.counts, expected.warnings)


def in_units(subject: pd.DataFrame, objects: pd.DataFrame) -> Tables:
    def clock(time_s: pd.Series) -> pd.Series:
        return 1.7e12 + 1000.0 * time_s

    mine = subject.assign(
        unix_ms=clock(subject.time_s),
        v_ego=subject.speed_kmh / 3.6,
        lon=np.degrees(subject.longitude_rad),
        lat=np.degrees(subject.latitude_rad),
        wz=np.degrees(subject.yaw_rate_radps),
    )
    theirs = objects.assign(
        unix_ms=clock(objects.time_s),
        v_obj=objects.speed_kmh / 3.6 / 0.44704,
        dx=objects.relative_x_m / 0.3048,
        track=objects.vehicle_id + 1000000007,
    )
    ours = ["time_s", "speed_kmh", "longitude_rad", "latitude_rad", "yaw_rate_radps", "relative_x_m", "vehicle_id"]
    return mine.drop(columns=ours, errors="ignore"), theirs.drop(columns=ours, errors="ignore")


UNITS = """
[log]
[log.columns]
time_s = { column = "unix_ms", unit = "ms" }
[log.subject_columns]
speed_kmh = { column = "v_ego", unit = "m/s" }
longitude_rad = { column = "lon", unit = "deg" }
latitude_rad = { column = "lat", unit = "deg" }
yaw_rate_radps = { column = "wz", unit = "deg/s" }
[log.object_columns]
vehicle_id = { column = "track" }
speed_kmh = { column = "v_obj", unit = "mph" }
relative_x_m = { column = "dx", unit = "ft" }
"""


def test_names_units_and_a_clock_of_ones_own(read: Callable, form_of: Callable, straight_drive: Tables):
    expected = read(straight_drive)
    assert_same(read(in_units(*straight_drive), form_of(UNITS), 1.7e12), expected, 1e-5)
    text = UNITS.replace('unit = "ms" }', 'unit = "ms", zero = 1.7e12 }')
    assert_same(read(in_units(*straight_drive), form_of(text)), expected, 1e-5)


@pytest.mark.parametrize(
    ("rewrite", "text"),
    [
        (lambda lane, lanes: lane - 1, "first_lane = 0"),
        (lambda lane, lanes: lanes + 1 - lane, 'lanes_from = "left"'),
        (lambda lane, lanes: lanes - lane, 'first_lane = 0\nlanes_from = "left"'),
    ],
)
def test_lanes_counted_otherwise(
    read: Callable, form_of: Callable, straight_drive: Tables, rewrite: Callable, text: str
):
    subject, objects = straight_drive
    position_m = dict(zip(subject.time_s, 250.0 + 20.0 * (subject.time_s - 10.0), strict=True))
    lanes = np.where(subject.time_s.map(position_m) < 300.0, 3, 4)
    there_m = objects.time_s.map(position_m) + objects.relative_x_m
    changed = (
        subject.assign(lane=rewrite(subject.lane, lanes)),
        objects.assign(lane=rewrite(objects.lane, np.where(there_m < 300.0, 3, 4))),
    )
    assert_same(read(changed, form_of(f"[log]\n{text}")), read(straight_drive))


def test_objects_with_places_of_their_own(
    read: Callable, form_of: Callable, straight_drive: Tables, row_map: RowMap, to_lon_lat: Callable
):
    """On the globe, in the network's plane, in a plane that EPSG names: distances follow from the road."""
    subject, objects = straight_drive
    net = row_map.network.net
    x_m, y_m = np.asarray(
        [net.convertLonLat2XY(*np.degrees(place)) for place in subject[["longitude_rad", "latitude_rad"]].to_numpy()]
    ).T
    own = pd.DataFrame({"time_s": subject.time_s, "own_x_m": x_m, "own_y_m": y_m})
    placed = objects.merge(own, on="time_s")
    placed = placed.assign(x_m=placed.own_x_m + placed.relative_x_m, y_m=placed.own_y_m + placed.relative_y_m)
    placed = placed.drop(columns=["own_x_m", "own_y_m", "relative_x_m", "relative_y_m"])
    expected = read(straight_drive)
    in_plane = subject.assign(x_m=x_m, y_m=y_m).drop(columns=["longitude_rad", "latitude_rad"])
    assert_same(read((in_plane, placed)), expected, 0.05)
    lon_lat = to_lon_lat(placed[["x_m", "y_m"]].to_numpy())
    on_globe = placed.assign(longitude_rad=lon_lat[:, 0], latitude_rad=lon_lat[:, 1]).drop(columns=["x_m", "y_m"])
    assert_same(read((subject, on_globe)), expected, 0.05)
    project = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32651", always_xy=True).transform

    def projected(table: pd.DataFrame) -> pd.DataFrame:
        east_m, north_m = project(np.degrees(table.longitude_rad), np.degrees(table.latitude_rad))
        return table.assign(x_m=east_m, y_m=north_m).drop(columns=["longitude_rad", "latitude_rad"])

    form = form_of('[log]\ncrs = "EPSG:32651"')
    assert_same(read((projected(subject), projected(on_globe)), form), expected, 0.05)


def test_objects_on_edges(read: Callable, straight_drive: Tables):
    subject, objects = straight_drive
    position_m = 250.0 + 20.0 * (objects.time_s - 10.0) + objects.relative_x_m
    is_on_a = position_m < 301.0
    placed = objects.assign(
        edge=np.where(is_on_a, "a", "b"),
        position_m=position_m - np.where(is_on_a, 0.0, 303.0),
        lane=objects.relative_y_m / 3.75 + np.where(is_on_a, 1, 2),
    ).drop(columns=["relative_x_m", "relative_y_m"])
    elsewhere = placed.iloc[:3].assign(vehicle_id=99, edge="elsewhere")
    found, expected = read((subject, pd.concat([placed, elsewhere]))), read(straight_drive)
    np.testing.assert_allclose(found.objects.offset_m, expected.objects.offset_m, atol=1e-6)
    np.testing.assert_array_equal(found.objects.row, expected.objects.row)
    assert found.counts.rows_without_place == 3


@pytest.mark.parametrize(
    ("reference", "shift_m"),
    [("centre", (OWN_M - OTHER_M) / 2), ("near_end", -OTHER_M)],
)
def test_distances_between_other_points(
    read: Callable, form_of: Callable, straight_drive: Tables, reference: str, shift_m: float
):
    """Between centres; from the front bumper to the nearer one: the rear of 7 ahead, the front of 9 behind."""
    subject, objects = straight_drive
    is_shifted = (objects.vehicle_id == 7) | (reference == "centre")
    changed = objects.assign(relative_x_m=objects.relative_x_m + np.where(is_shifted, shift_m, 0.0), length_m=OTHER_M)
    form = form_of(f'[log]\nreference = "{reference}"\nsubject_length_m = {OWN_M}')
    found, expected = read((subject, changed), form), read(straight_drive)
    np.testing.assert_allclose(found.objects.offset_m, expected.objects.offset_m, atol=1e-9)
    further_m = OWN_M / 2 if reference == "centre" else 0.0
    np.testing.assert_allclose(found.subject.position_m, expected.subject.position_m + further_m, atol=1e-9)
    assert found.counts.rows_without_length == expected.counts.rows_without_length == 0
    lacking = read((subject, changed.drop(columns="length_m")), form)
    assert lacking.counts.rows_without_length == is_shifted.sum()  # the rear of 9 is nowhere asked for


def test_absent_columns_are_unknown(read: Callable, form_of: Callable, straight_drive: Tables):
    gone = ["road", "speed_limit_kmh", "yaw_rate_radps", "acceleration_mps2", "lane_offset_m", "heading_deg"]
    subject, objects = (table.drop(columns=gone, errors="ignore") for table in straight_drive)
    found = read((subject, objects), form_of(f"[log]\nabsent = {gone}"))
    expected = read(straight_drive)
    np.testing.assert_allclose(found.subject.acceleration_mps2, expected.subject.acceleration_mps2, atol=1e-6)
    np.testing.assert_array_equal(found.objects.offset_m, expected.objects.offset_m)
    assert np.isnan(found.yaw_rate_radps).all()
    with pytest.raises(CaseError, match=r'column road: .*write absent = \["road"\] under \[log\]'):
        read((subject, objects))


WRONG = {
    '[log.columns]\nspeed_kmh = { column = "v", unit = "flutes" }': "log.columns.speed_kmh.unit: expected a unit",
    '[log.columns]\nspeed_kmh = { column = "v", unit = "m" }': "expected a unit that can be turned into km/h",
    '[log.columns]\nvehicle_id = { column = "v", unit = "m" }': "vehicle_id has no unit",
    '[log.columns]\nspeed_kph = { column = "v" }': 'did you mean "speed_kmh"',
    '[log.columns]\nspeed_kmh = "v"': r"log.columns.speed_kmh: expected { column",
    '[log]\nabsent = ["speed_kmh"]': "log.absent",
    '[log]\nlanes_from = "top"': '"right" or "left"',
    '[log]\ncrs = "EPSG:no"': "log.crs: expected a coordinate reference system",
    '[log]\n[scenario]\nconfig = "x"': "and nothing else",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_is_named(form_of: Callable, text: str):
    with pytest.raises(CaseError) as error:
        form_of(text if text.startswith("[log]") else f"[log]\n{text}")
    assert WRONG[text] in str(error.value)


def test_messages_have_the_users_name(read: Callable, form_of: Callable, straight_drive: Tables):
    subject, objects = in_units(*straight_drive)
    with pytest.raises(CaseError, match=r"row 4, column v_ego \(speed_kmh\): expected a speed"):
        read((subject.assign(v_ego=np.where(subject.index == 2, -1.0, subject.v_ego)), objects), form_of(UNITS), 1.7e12)
    with pytest.raises(CaseError, match=r"column v_ego: expected this column .*speed_kmh"):
        read((subject.drop(columns="v_ego"), objects), form_of(UNITS), 1.7e12)


def test_the_section_stands_in_case_toml(straight_drive: Tables, tmp_path: Path):
    for table, name in zip(in_units(*straight_drive), ("s.csv", "o.csv"), strict=True):
        table.to_csv(tmp_path / name, index=False)
    perception = '[perception]\nahead_m = 1\nbehind_m = 1\nreference = "front"\nnominal_length_m = 4.8'
    drive = '[[drive]]\nid = "d"\ndepart_s = 1\nsubject = "s.csv"\nobjects = "o.csv"\nrole = "fit"\ntime_zero = 5.5'
    (tmp_path / "case.toml").write_text(f'format = 1\nname = "a"\n{perception}\n{drive}\n{UNITS}')
    case = read_case(tmp_path)
    assert case.log_form.subject["speed_kmh"].factor == pytest.approx(3.6)
    assert case.log_form.objects["speed_kmh"].factor == pytest.approx(1.609344)
    assert case.drives[0].time_zero == 5.5


def test_all_faults_of_a_mapping_are_told_with_the_users_file(tmp_path: Path):
    file = tmp_path / "columns.toml"
    file.write_text('[log]\nfirst_lane = 7\nlanes_from = "up"\n')
    with pytest.raises(CaseError) as error:
        read_log_section(file)
    assert [str(fault) for fault in (error.value, *error.value.others)] == [
        "columns.toml: log.first_lane: expected 0 or 1, got 7.",
        'columns.toml: log.lanes_from: expected "right" or "left", got "up".',
    ]
