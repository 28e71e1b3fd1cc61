"""The same traffic in every format becomes the same logs, and a case that can be calibrated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest

from jaxcalib.case.case import read_case
from jaxcalib.check.scenario_check import check_case
from jaxcalib.errors import CaseError
from jaxcalib.importers import sumo_fcd
from jaxcalib.importers.import_case import import_case
from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.registry import load_importer
from jaxcalib.importers.straight_road import straight_road_of, write_scenario
from jaxcalib.importers.sumo_fcd import slices_in
from tests.jaxcalib.importers.recorded_traffic import (
    LANE_M,
    LASTS_S,
    NUM_LANES,
    STEP_S,
    SUBJECT,
    WRITERS,
    traffic,
    write_fcd,
    write_ngsim,
    write_table,
)

RANGE_M = 120.0


def own_rows() -> pd.DataFrame:
    """The subject vehicle, while its whole range lies on the stretch on which there are vehicles."""
    truth = traffic()
    has_room = truth.x_m.between(truth.x_m.min() + RANGE_M, truth.x_m.max() - RANGE_M)
    return truth[(truth.vehicle == SUBJECT) & has_room].sort_values("time_s")


def expected_objects() -> pd.DataFrame:
    """Who is within range of the subject vehicle, and where: by the definition of relative places."""
    truth = traffic()
    own = own_rows()[["time_s", "x_m", "y_m"]]
    others = truth[truth.vehicle != SUBJECT].merge(own, on="time_s", suffixes=("", "_own"))
    others = others.assign(relative_x_m=others.x_m - others.x_m_own, relative_y_m=others.y_m - others.y_m_own)
    near = np.hypot(others.relative_x_m, others.relative_y_m) <= RANGE_M
    return others[near].sort_values(["time_s", "vehicle"], ignore_index=True)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A scenario of the road, for formats that need one."""
    return write_scenario(straight_road_of(traffic()), tmp_path / "road", 900.0)


def read(kind: str, folder: Path, scenario: Path, subjects: tuple[str, ...] | None = None) -> Imported:
    name, write = WRITERS[kind]
    source = write(folder)
    if subjects is None:
        subjects = ("veh/" + SUBJECT,) if name == "trajectories" else (SUBJECT,)
    mapping = folder / "mapping.toml" if name == "trajectories" else None
    config = scenario if name == "sumo-fcd" else None
    options = ImportOptions(subjects=subjects, probes=6, range_m=RANGE_M, mapping=mapping, config=config)
    return load_importer(name)(source, options)


@pytest.mark.parametrize("kind", WRITERS)
def test_the_same_logs_from_every_format(kind: str, tmp_path: Path, scenario: Path):
    (drive,) = read(kind, tmp_path, scenario).drives
    own = own_rows()
    subject = drive.subject.sort_values("time_s")
    later_s = 0.0 if kind.startswith("fcd") else 600.0
    np.testing.assert_allclose(subject.time_s - later_s, own.time_s, atol=1e-6)
    np.testing.assert_allclose(subject.speed_kmh, 3.6 * own.speed_mps, rtol=1e-4)
    np.testing.assert_allclose(np.diff(subject.x_m), np.diff(own.x_m), atol=2e-3)
    seen = drive.objects.merge(subject[["time_s", "x_m", "y_m"]], on="time_s", suffixes=("", "_own"))
    seen = seen.assign(vehicle=seen.vehicle_id.str.removeprefix("veh/"))
    seen = seen.sort_values(["time_s", "vehicle"], ignore_index=True)
    expected = expected_objects()
    assert seen.vehicle.tolist() == expected.vehicle.tolist()
    np.testing.assert_allclose(seen.x_m - seen.x_m_own, expected.relative_x_m, atol=2e-3)
    np.testing.assert_allclose(seen.y_m - seen.y_m_own, expected.relative_y_m, atol=2e-3)
    np.testing.assert_allclose(seen.speed_kmh, 3.6 * expected.speed_mps, rtol=1e-4)
    if not kind.startswith("fcd"):
        np.testing.assert_allclose(seen.length_m, expected.length_m, atol=1e-3)


@pytest.mark.parametrize("kind", [kind for kind in WRITERS if not kind.startswith("fcd")])
def test_the_road_that_a_recording_shows(kind: str, tmp_path: Path, scenario: Path):
    road = read(kind, tmp_path, scenario).road
    assert road is not None
    assert road.widths_m == pytest.approx([LANE_M] * NUM_LANES, abs=0.01)
    assert road.lengths_m == pytest.approx({"car": 4.3, "truck": 12.0}, abs=0.2)
    truth = traffic()
    area_ms = (truth.x_m.max() - truth.x_m.min()) * (LASTS_S - STEP_S)
    driven_m = truth.groupby("vehicle").x_m.agg(np.ptp)
    is_truck = truth.groupby("vehicle").length_m.median() > 7.5
    for kind_of_vehicle, mine in (("car", ~is_truck), ("truck", is_truck)):
        flow_vehph = 3600.0 * driven_m[mine].sum() / area_ms
        assert road.vehicles_per_hour[kind_of_vehicle] == pytest.approx(flow_vehph, rel=0.01)
    assert road.speed_limit_mps == pytest.approx(36.11 if kind.startswith("highd") else 36.03, abs=1.0)


def test_flow_where_recordings_show_parts_that_move_with_their_vehicles():
    """Cut out of a steady stream of 1,800 veh/h in each of two lanes, at 25 m/s."""
    rows = []
    for recording in range(3):
        for number in range(200):
            for time_s in np.arange(0.0, 10.0, 0.5):
                x_m = 25.0 * time_s - 25.0 * number
                begin_m = 25.0 * time_s - 250.0 - 40.0 * recording
                if begin_m <= x_m <= begin_m + 200.0:
                    lane = 1 + number % 2
                    rows.append((f"{recording}", f"{recording}-{number}", time_s, x_m, 3.5 * lane, 25.0, lane, 4.5))
    names = ["recording", "vehicle", "time_s", "x_m", "y_m", "speed_mps", "lane", "length_m"]
    road = straight_road_of(pd.DataFrame(rows, columns=names))
    assert road.vehicles_per_hour["car"] == pytest.approx(3600.0, rel=0.12)
    assert road.vehicles_per_hour["truck"] == 0.0


@pytest.mark.parametrize("kind", ["ngsim in feet", "highd, upper carriageway", "table", "fcd, csv"])
def test_an_imported_case_passes_the_check(kind: str, tmp_path: Path, scenario: Path):
    name, write = WRITERS[kind]
    source = write(tmp_path)
    mapping = tmp_path / "mapping.toml" if name == "trajectories" else None
    options = ImportOptions(probes=6, range_m=RANGE_M, mapping=mapping, config=scenario if "fcd" in kind else None)
    said = import_case(name, source, tmp_path / "case", options)
    assert any("held out" in line for line in said)
    found = check_case(tmp_path / "case")
    assert found.refusals == ()
    case = read_case(tmp_path / "case")
    assert len(case.drives_of("fit")) == 2 * len(case.drives_of("held_out"))
    begins = {role: [drive.depart_s for drive in case.drives_of(role)] for role in ("fit", "held_out")}
    assert max(begins["fit"]) <= min(begins["held_out"])


def test_floating_car_data_without_its_scenario(tmp_path: Path, scenario: Path):
    source = WRITERS["fcd, xml"][1](tmp_path)
    with pytest.raises(CaseError, match="--scenario: expected the scenario that SUMO ran"):
        import_case("sumo-fcd", source, tmp_path / "case", ImportOptions())
    assert not (tmp_path / "case").exists()


def test_a_vehicle_that_is_not_there(tmp_path: Path, scenario: Path):
    with pytest.raises(CaseError, match='--subject: expected a vehicle of the recording, got "nobody"'):
        read("ngsim in feet", tmp_path, scenario, ("nobody",))


@pytest.mark.parametrize(
    ("kind", "content", "message"),
    [
        ("ngsim", "a,b\n1,2\n", "expected NGSIM's columns"),
        ("trajectories", "time_s,vehicle_id\n1,2\n", "header: expected columns x_m and y_m; or"),
        ("trajectories", "time_s,x_m,y_m\n1,2,3\n", "column vehicle_id: expected this column"),
        ("highd", "frame\n1\n", "expected a file NN_tracks.csv"),
        ("comma", "frame\n1\n", "expected a table of radar tracks"),
    ],
)
def test_what_is_no_such_recording_is_named(kind: str, content: str, message: str, tmp_path: Path):
    folder = tmp_path / "recording"
    folder.mkdir()
    file = folder / "t.csv"
    file.write_text(content)
    with pytest.raises(CaseError) as error:
        import_case(kind, file, tmp_path / "case", ImportOptions())
    assert message in str(error.value)
    assert not (tmp_path / "case").exists()


def test_broken_xml_is_said_in_one_line(tmp_path: Path, scenario: Path):
    file = tmp_path / "fcd.xml"
    file.write_text('<fcd-export><timestep time="1"><vehicle id="a" x="1"')
    with pytest.raises(CaseError, match=r"fcd\.xml: expected SUMO's XML"):
        load_importer("sumo-fcd")(file, replace(ImportOptions(), config=scenario))


def test_geographic_places_of_ngsim(tmp_path: Path, scenario: Path):
    """Global_X and Global_Y in the feet of a state plane (EPSG:2229) are the same way on the globe."""
    file = write_ngsim(tmp_path, True)
    table = pd.read_csv(file)
    east_ft, north_ft = 6_452_000.0, 1_872_000.0  # near US-101 in Los Angeles
    table = table.assign(Global_X=east_ft + 0.6 * table.Local_Y, Global_Y=north_ft - 0.8 * table.Local_Y)
    table.to_csv(file, index=False)
    imported = load_importer("ngsim")(file, ImportOptions(subjects=(SUBJECT,), range_m=RANGE_M, crs="EPSG:2229"))
    (drive,) = imported.drives
    assert imported.road is None
    assert any("Global_X" in line for line in imported.said)
    latitude, longitude = drive.subject.latitude_rad.to_numpy(), drive.subject.longitude_rad.to_numpy()
    north_m = 6_371_000.0 * np.diff(latitude)
    east_m = 6_371_000.0 * np.cos(latitude[0]) * np.diff(longitude)
    own = own_rows()
    np.testing.assert_allclose(np.hypot(east_m, north_m), np.diff(own.x_m), rtol=0.01)
    assert np.degrees(longitude[0]) == pytest.approx(-118.4, abs=0.3)
    assert set(drive.objects.vehicle_id) == set(expected_objects().vehicle)


@pytest.mark.parametrize("shift", [0, 4])
def test_lanes_count_from_the_rightmost_that_was_recorded(shift: int, tmp_path: Path):
    """Numbers of 0 and less are ramps; a part of a road whose first lane has number 5 has a first lane all the same."""
    file = write_table(tmp_path)
    table = pd.read_csv(file)
    on_ramp = table.head(30).assign(track="ramp", lane=0, north=-1.8 / 0.3048)
    pd.concat([table.assign(lane=table.lane + shift), on_ramp]).to_csv(file, index=False)
    imported = load_importer("trajectories")(file, ImportOptions(probes=3, mapping=tmp_path / "mapping.toml"))
    assert imported.road is not None
    assert len(imported.road.widths_m) == NUM_LANES
    assert set(imported.drives[0].objects.lane.dropna()) <= {1.0, 2.0, 3.0}


@pytest.mark.parametrize("turn_rad", [np.pi, 0.5])
def test_traffic_in_another_direction_is_no_road(turn_rad: float, tmp_path: Path):
    file = write_table(tmp_path)
    table = pd.read_csv(file)
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turned = table.assign(east=cos * table.east - sin * table.north, north=sin * table.east + cos * table.north)
    turned.to_csv(file, index=False)
    with pytest.raises(CaseError, match=r"columns x_m and y_m: expected traffic along \+x"):
        load_importer("trajectories")(file, ImportOptions(probes=3, mapping=tmp_path / "mapping.toml"))


def test_two_locations_are_no_road(tmp_path: Path):
    file = write_ngsim(tmp_path, True)
    table = pd.read_csv(file)
    pd.concat([table, table.assign(Location="i-80")]).to_csv(file, index=False)
    with pytest.raises(CaseError, match="column Location: expected one location, got i-80, us-101"):
        load_importer("ngsim")(file, ImportOptions())


@pytest.mark.parametrize("rows_per_batch", [1, 7, 1000])
def test_an_instant_that_goes_on_in_the_next_batch_comes_once_and_whole(
    rows_per_batch: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    file = write_fcd(tmp_path, "parquet")

    def batches(source: Path):
        with pyarrow.parquet.ParquetFile(source) as table:
            yield from table.iter_batches(batch_size=rows_per_batch)

    whole = [(one.time_s, one.vehicle.tolist()) for one in slices_in(file)()]
    monkeypatch.setattr(sumo_fcd, "_parquet_batches", batches)
    assert [(one.time_s, one.vehicle.tolist()) for one in slices_in(file)()] == whole
    times_s = [time_s for time_s, _ in whole]
    assert times_s == sorted(set(times_s))
