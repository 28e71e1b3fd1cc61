"""openpilot's tables: the same drive under its own names and under those of tables made of them; what is no drive."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxcalib.check.scenario_check import check_case
from jaxcalib.errors import CaseError
from jaxcalib.importers.comma import USUAL_LENGTH_M, read_recording
from jaxcalib.importers.import_case import import_case
from jaxcalib.importers.importer import ImportOptions
from tests.places import SHARED_DATA

SPEED_MPS, EARTH_RADIUS_M = 25.0, 6_371_000.0


def write_drive(folder: Path, is_plain: bool) -> None:
    """North-east at 25 m/s: a leader 40 m ahead, 2 m/s faster, a gantry that stands, one who comes the other way."""
    time_s = np.round(np.arange(0.0, 30.0, 0.1), 3)
    north_m = east_m = SPEED_MPS * time_s / np.sqrt(2.0)
    latitude_deg = 37.5 + np.degrees(north_m / EARTH_RADIUS_M)
    longitude_deg = -122.2 + np.degrees(east_m / EARTH_RADIUS_M / np.cos(np.radians(37.5)))
    car = pd.DataFrame({"t": time_s, "vEgo": SPEED_MPS, "aEgo": 0.1 * np.sin(time_s), "yawRate": 0.001})
    place = pd.DataFrame({"t": time_s, "latitude": latitude_deg, "longitude": longitude_deg})
    tracks = [
        pd.DataFrame({"t": time_s, "trackId": number, "dRel": ahead_m, "yRel": left_m, "vRel": relative_mps})
        for number, ahead_m, left_m, relative_mps in (
            (7, 40.0 + 2.0 * time_s, 0.0, 2.0), (8, 80.0, -6.0, -SPEED_MPS), (9, 60.0, 9.0, -2.0 * SPEED_MPS),
        )
    ]  # fmt: skip
    radar = pd.concat(tracks, ignore_index=True)
    if is_plain:
        names = {"t": "time_s", "vEgo": "speed_mps", "trackId": "track_id", "dRel": "x_rel_m", "yRel": "y_rel_left_m"}
        car, radar, place = (
            table.rename(columns=names | {"vRel": "v_rel_mps", "latitude": "lat", "longitude": "lon"})
            for table in (car, radar, place)
        )
    else:
        clock = {"logMonoTime": (5e13 + 1e9 * time_s).astype("int64")}
        car, place = (table.drop(columns="t").assign(**clock) for table in (car, place))
        radar = radar.assign(logMonoTime=(5e13 + 1e9 * radar.t).astype("int64")).drop(columns="t")
    car.to_csv(folder / "carState.csv", index=False)
    radar.to_parquet(folder / "radar.parquet", index=False)
    place.to_csv(folder / "location.csv.gz", index=False)


@pytest.mark.parametrize("is_plain", [True, False])
def test_a_drive_under_either_names(is_plain: bool, tmp_path: Path):
    write_drive(tmp_path, is_plain)
    imported = read_recording(tmp_path, ImportOptions())
    (drive,) = imported.drives
    np.testing.assert_allclose(drive.subject.speed_kmh, 90.0, rtol=1e-9)
    assert drive.subject.time_s.iloc[0] == 600.0
    assert set(drive.objects.vehicle_id.astype(str)) == {"7"}  # neither the gantry nor who comes the other way
    assert "300 that stand at the roadside and 300 of oncoming traffic" in imported.said[0]
    np.testing.assert_allclose(drive.objects.speed_kmh, 3.6 * 27.0, rtol=1e-9)
    seen = drive.objects.merge(drive.subject, on="time_s", suffixes=("", "_own"))
    north_m = EARTH_RADIUS_M * (seen.latitude_rad - seen.latitude_rad_own)
    east_m = EARTH_RADIUS_M * np.cos(seen.latitude_rad) * (seen.longitude_rad - seen.longitude_rad_own)
    gap_m = 40.0 + 2.0 * (seen.time_s - 600.0) + USUAL_LENGTH_M
    np.testing.assert_allclose(np.hypot(north_m, east_m), gap_m, rtol=0.01)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vEgo": "fast"}, 'carState.csv: column speed_mps: expected numbers, got "fast"'),
        ({"vEgo": None}, "a table of car state"),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, str | None], words: str, tmp_path: Path):
    write_drive(tmp_path, False)
    for name, value in change.items():
        table = pd.read_csv(tmp_path / "carState.csv")
        table = table.drop(columns=name) if value is None else table.assign(**{name: value})
        table.to_csv(tmp_path / "carState.csv", index=False)
    with pytest.raises(CaseError) as error:
        read_recording(tmp_path, ImportOptions())
    assert words in str(error.value)


def test_a_recorded_minute_is_believed(tmp_path: Path):
    source = SHARED_DATA / "perception"
    if not source.is_dir():
        pytest.skip("needs shared/data: perception/comma2k19_*.csv.gz")
    import_case("comma", source, tmp_path / "case", ImportOptions())
    found = check_case(tmp_path / "case")
    assert found.refusals == ()
    assert not found.has_scenario
