"""The page of `jaxcalib check`: what is drawn is what the logs say, and it is there when a case is refused, too."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.log_faults.faults import FAULTS
from jaxcalib.case.case import Case, read_case
from jaxcalib.check import scenario_check
from jaxcalib.check.check_figures import MOST_POINTS, thinned
from jaxcalib.check.check_page import check_html
from jaxcalib.check.check_records import STAYS, DriveRecord, log_records, shown_speed_mps
from jaxcalib.check.check_road import cross_section
from jaxcalib.check.scenario_check import CaseCheck
from jaxcalib.cli.app import check
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from jaxcalib.field.drive_logs import DriveLogs, judge_without_road, read_drives
from jaxcalib.field.field_log import DriveCounts
from jaxcalib.field.route_geometry import build_route_geometry
from sim_adapters.scenario.scenario import Scenario
from tests.copies import copy_corridor
from tests.places import CORRIDOR

Table = pd.DataFrame
Spoil = Callable[[Table, Table], tuple[Table, Table]]
LANE_WIDTH_M = 3.75
EARTH_RADIUS_M = 6_371_000.0


@pytest.fixture(scope="module")
def case() -> Case:
    """The corridor with one drive."""
    whole = read_case(CORRIDOR)
    return dataclasses.replace(whole, drives=whole.drives[:1])


@pytest.fixture
def spoilt(case: Case, tmp_path: Path) -> Callable[[Spoil], Case]:
    """Return what spoils the tables of the drive."""

    def spoil(change: Spoil) -> Case:
        (drive,) = case.drives
        files = tmp_path / "d01_subject.csv", tmp_path / "d01_objects.csv"
        tables = change(pd.read_csv(drive.subject_file), pd.read_csv(drive.objects_file))
        for table, file in zip(tables, files, strict=True):
            table.to_csv(file, index=False)
        drive = dataclasses.replace(drive, subject_file=files[0], objects_file=files[1])
        return dataclasses.replace(case, drives=(drive,))

    return spoil


def in_mps(subject: Table, objects: Table) -> tuple[Table, Table]:
    return subject.assign(speed_kmh=subject.speed_kmh / 3.6), objects


def far(subject: Table, objects: Table) -> tuple[Table, Table]:
    return subject.assign(longitude_rad=subject.longitude_rad + 0.02), objects


def with_strangers(subject: Table, objects: Table) -> tuple[Table, Table]:
    """Four hundred rows of the vehicle itself, 30 of a number for nothing, 20 beside the road, 10 behind its end."""
    itself = subject[:400].assign(vehicle_id="itself", relative_x_m=0.3, relative_y_m=0.1, heading_deg=0.0)
    changed = objects.copy()
    for first, count, column, value in (
        (3, 30, "relative_x_m", 1023.0),
        (541, 20, "relative_y_m", 40.0),
        (977, 10, "relative_x_m", 8765.4),
    ):
        rows = changed.index[first : first + 100 * count : 100]
        # Numbers that come again and again stand for nothing; those that differ are far off.
        changed.loc[rows, column] = value if value == 1023.0 else value + 0.7 * np.arange(count)
        if column == "relative_y_m":
            changed.loc[rows, "lane"] = np.nan
    return subject, pd.concat([changed, itself[objects.columns]], ignore_index=True)


def record_of(case: Case, logs: DriveLogs | None) -> DriveRecord:
    (record,) = log_records(case, logs, 12).drives
    return record


@pytest.fixture
def drawn(spoilt: Callable[[Spoil], Case], corridor: Scenario) -> Callable[[Spoil], tuple[DriveRecord, DriveLogs]]:
    """Return what is drawn of the drive where its tables are spoilt, and what was read."""

    def read(change: Spoil) -> tuple[DriveRecord, DriveLogs]:
        changed = spoilt(change)
        logs = read_drives(changed, corridor.row_map)
        return record_of(changed, logs), logs

    return read


@pytest.fixture(scope="module")
def whole(case: Case, corridor: Scenario) -> DriveRecord:
    """What is drawn of the drive as it is."""
    return record_of(case, read_drives(case, corridor.row_map))


def test_the_speed_that_places_show_is_the_derivative():
    time_s = np.round(40.0 + 0.1 * np.arange(200), 1)
    time_s = time_s[(time_s < 50.0) | (time_s > 53.0)]
    way_m = 7.0 + 20.0 * (time_s - 40.0) + 0.6 * (time_s - 40.0) ** 2
    shown = shown_speed_mps(time_s, np.stack([0.6 * way_m, 0.8 * way_m], axis=1))  # a slope of 3 to 4 to 5
    inner = (time_s > 41.0) & (time_s < 59.0) & (np.abs(time_s - 51.5) > 2.6)
    assert shown[inner] == pytest.approx(20.0 + 1.2 * (time_s[inner] - 40.0), rel=1e-9)
    assert np.isnan(shown[np.abs(time_s - 51.5) < 2.3]).all()  # nothing is said across a gap of three seconds
    assert shown_speed_mps(time_s, -way_m[:, None])[inner] == pytest.approx(-shown[inner])


def test_speeds_in_another_unit_lie_beside_those_of_the_places(drawn: Callable, whole: DriveRecord):
    wrong, logs = drawn(in_mps)
    assert whole.shown_over_logged == pytest.approx(1.0, abs=0.01)
    assert wrong.shown_over_logged == pytest.approx(3.6, rel=0.01)
    assert logs.refusals
    assert wrong.shown_speed_mps == pytest.approx(whole.shown_speed_mps, nan_ok=True)
    assert wrong.speed_mps == pytest.approx(whole.speed_mps / 3.6)


def test_rows_that_are_left_out_are_those_of_the_counts(drawn: Callable):
    record, logs = drawn(with_strangers)
    assert record.counts == {"subject_itself": 400, "sentinel": 30, "off_route": 10, "off_road": 20}
    counts: DriveCounts = logs.drives[0].counts
    assert counts.rows_impossible == 430
    assert (counts.rows_off_route, counts.rows_off_road) == (10, 20)
    assert len(record.kind) == counts.object_rows
    assert np.abs(record.relative_x_m[record.kind == STAYS]).max() <= 150.0


def test_objects_lie_in_lanes_where_all_is_right(drawn: Callable, whole: DriveRecord, corridor: Scenario):
    borders_m = cross_section(build_route_geometry(corridor.row_map)).borders_m
    through = [border_m for border_m, share in borders_m.items() if share > 0.99]
    assert sorted(through) == pytest.approx(LANE_WIDTH_M * np.arange(4), abs=0.01)
    assert min(borders_m) == pytest.approx(-LANE_WIDTH_M, abs=0.01)  # of the lanes at the ramps
    assert whole.has_lanes
    from_centre_m = (whole.across_m + LANE_WIDTH_M / 2) % LANE_WIDTH_M
    assert np.nanquantile(np.minimum(from_centre_m, LANE_WIDTH_M - from_centre_m), 0.99) < 0.3
    turned, _ = drawn(lambda subject, objects: (subject, objects.assign(relative_y_m=-objects.relative_y_m)))
    assert np.mean(turned.across_m < min(borders_m)) > 0.2  # on the wrong side of a vehicle in the rightmost lane


def test_lanes_keep_their_places_where_an_edge_counts_from_elsewhere(corridor: Scenario):
    road = build_route_geometry(corridor.row_map)
    shifted_m = np.where(np.arange(len(road.edges)) % 2 == 1, 1.7, 0.0)[:, None]
    moved = dataclasses.replace(road, lane_centre_m=road.lane_centre_m + shifted_m)
    at_m = 0.4 + road.lane_centre_m[:, 1]
    edge = np.arange(len(road.edges))
    laid = cross_section(road).laid(edge, at_m)
    assert laid - laid[0] == pytest.approx(at_m - at_m[0])  # on the corridor itself nothing is shifted
    again = cross_section(moved).laid(edge, at_m + shifted_m[:, 0])
    assert again - again[0] == pytest.approx(laid - laid[0])
    left_hand = cross_section(dataclasses.replace(road, is_mirrored=True))  # whose plane has + left on the right
    assert left_hand.laid(edge, at_m) == pytest.approx(-laid)
    assert sorted(left_hand.borders_m) == pytest.approx(sorted(-border_m for border_m in cross_section(road).borders_m))


def test_without_a_place_across_the_lane_tells_where(drawn: Callable, whole: DriveRecord):
    record, _ = drawn(lambda subject, objects: (subject, objects.assign(relative_y_m=np.nan)))
    known = np.isfinite(record.across_m) & np.isfinite(whole.across_m)
    assert known.mean() > 0.99
    # In the lane's middle, but where a lane's number may be that of the next edge.
    assert np.quantile(np.abs(record.across_m - whole.across_m)[known], 0.98) < 0.3


def test_a_drive_beside_the_road_is_drawn_beside_its_lanes(drawn: Callable, whole: DriveRecord):
    record, logs = drawn(FAULTS["aside"].spoil)
    assert logs.refusals
    assert not logs.drives
    assert not record.is_placed
    assert np.nanmedian(record.own_across_m - whole.own_across_m) == pytest.approx(12.0, abs=0.3)
    assert np.nanmedian(record.across_m) > np.nanmedian(whole.across_m) + 11.0


def test_a_drive_of_another_road_is_drawn_from_itself(spoilt: Callable[[Spoil], Case], corridor: Scenario):
    case = spoilt(far)
    records = log_records(case, read_drives(case, corridor.row_map), 12)
    (record,) = records.drives
    assert not record.has_lanes
    assert record.shown_over_logged == pytest.approx(1.0, abs=0.02)
    road_m = np.nanmean(np.concatenate(records.lanes_xy_m), axis=0)
    away_m = np.hypot(*(np.nanmean(records.ways_xy_m["d01"], axis=0) - road_m))
    latitude_rad = pd.read_csv(case.drives[0].subject_file).latitude_rad.median()
    assert away_m == pytest.approx(0.02 * EARTH_RADIUS_M * np.cos(latitude_rad), rel=0.02)


def test_without_a_scenario_the_places_are_the_map(spoilt: Callable[[Spoil], Case]):
    case = dataclasses.replace(spoilt(with_strangers), scenario=None, subject=None, behaviour=None, inputs=())
    logs = judge_without_road(case)
    records = log_records(case, logs, 12)
    (record,) = records.drives
    assert records.lanes_xy_m == ()
    assert records.borders_m == {}
    assert record.is_placed
    assert record.counts == {"subject_itself": 400, "sentinel": 30}  # without a road nothing is beside it
    way_m = np.hypot(*np.diff(records.ways_xy_m["d01"], axis=0).T).sum()
    assert way_m == pytest.approx(np.trapezoid(record.speed_mps, record.time_s), rel=0.01)
    page = check_html(CaseCheck(case.name, {}, (), (), has_scenario=False, case=case, logs=logs))
    assert "Places alone" in page
    assert "400 left out: the subject vehicle among its own objects" in page


def test_drives_that_are_refused_are_shown_first(case: Case):
    drives = tuple(dataclasses.replace(case.drives[0], id=name) for name in ("first", "second", "third"))
    records = log_records(dataclasses.replace(case, drives=drives), None, 2, frozenset({"third"}))
    assert [drive.id for drive in records.drives] == ["first", "third"]


def test_thinning_takes_each_row_once_at_most():
    for num_rows in (0, 1, MOST_POINTS, MOST_POINTS + 1, 54321):
        rows = thinned(num_rows, MOST_POINTS)
        assert len(np.unique(rows)) == len(rows) == min(num_rows, MOST_POINTS)
        assert num_rows == 0 or (rows.min() >= 0 and rows.max() < num_rows)


def test_names_are_escaped(case: Case):
    name = '<u>$\\frac&"x"_'
    named = dataclasses.replace(case, name=name, drives=(dataclasses.replace(case.drives[0], id=name),))
    page = check_html(CaseCheck(name, {name: ()}, (), (name,), (f"d01_subject.csv.gz: {name}",), case=named))
    assert "<u>" not in page
    assert "<script" not in page
    assert page.count("&lt;u&gt;$\\frac&amp;&#34;x&#34;_") >= 6
    assert page.count("<svg") == 2
    assert "refused" in page


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the corridor with a drive whose speeds are of another unit."""
    copy = copy_corridor(tmp_path_factory.mktemp("case") / "corridor", "d01")
    file = copy / "field/d01_subject.csv.gz"
    table = pd.read_csv(file)
    table.assign(speed_kmh=table.speed_kmh / 3.6).to_csv(file, index=False)
    return copy


def test_a_case_that_is_refused_has_a_page(folder: Path, capsys: pytest.CaptureFixture[str]):
    assert check(folder) == EXIT_CASE_WRONG
    said = capsys.readouterr()
    assert said.out.splitlines()[-1] == f"figure: {folder}/check.html"
    page = (folder / "check.html").read_text()
    assert "speeds are 3.60 times too small" in page
    assert '<span class="bad">refused</span>' in page
    assert "places show 3.60 x the logged speed" in page
    assert page.count("<svg") == 2


@pytest.fixture(params=[0, EXIT_CASE_WRONG])
def code(request: pytest.FixtureRequest, case: Case, monkeypatch: pytest.MonkeyPatch) -> int:
    """Exit code that a check is made to have, whose drives could not be laid anywhere."""
    found = CaseCheck(case.name, {}, (), (), ("case.toml: wrong.",) if request.param else (), case=case)
    monkeypatch.setattr(scenario_check, "check_case", lambda folder: found)
    return request.param


def test_the_page_goes_where_it_is_asked_for(code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    page = tmp_path / "new" / "page.html"
    assert check(tmp_path, out=page) == code
    assert capsys.readouterr().out.splitlines()[-1] == f"figure: {page}"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert [path.name for path in tmp_path.rglob("*.html")] == ["page.html"]


@pytest.mark.parametrize("place", ["beneath a file", "where nothing can be made"])
def test_a_place_that_was_asked_for_and_cannot_be_written_is_an_error(
    place: str, code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "file").write_text("mine")
    page = tmp_path / "file/check.html" if place == "beneath a file" else Path("/proc/jaxcalib/check.html")
    assert check(tmp_path, out=page) == EXIT_CASE_WRONG
    said = capsys.readouterr()
    assert "figure:" not in said.out
    assert said.err.splitlines()[-1].startswith("jaxcalib: check.html: expected a folder that can be written to")
    assert len(said.err.splitlines()) == (2 if code else 1)


def test_a_page_that_nobody_asked_for_and_that_cannot_be_written_changes_no_exit_code(
    code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "check.html").mkdir()
    assert check(tmp_path) == code
    said = capsys.readouterr()
    assert "figure:" not in said.out
    assert said.err.splitlines()[-1].startswith("jaxcalib: no figure: check.html: ")
    assert len(said.err.splitlines()) == (2 if code else 1)
