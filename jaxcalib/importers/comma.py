"""openpilot's logs as tables: car state, radar tracks and location, told apart by their columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from jaxcalib.errors import CaseError
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import Imported, ImportedDrive, ImportOptions
from jaxcalib.importers.planes import plane_of
from jaxcalib.importers.recorded_drive import recorded_drive
from jaxcalib.importers.tables import read_table, with_numbers

TABLES = (".csv", ".csv.gz", ".parquet")
USUAL_LENGTH_M = 4.8  # from the rear that a radar sees to the front bumper
STANDING_MPS, DRIVING_MPS = 1.5, 8.0  # who stands while the subject vehicle drives is the roadside
NANOSECONDS = 1e12  # times beyond are in nanoseconds since the start of the device

# Names of openpilot's messages (carState, liveTracks, gpsLocation) and of tables made of them, by ours.
NAMES: Mapping[str, Sequence[str]] = {
    "time_s": ("time_s", "t", "time", "logMonoTime", "timestamp"),
    "speed_mps": ("speed_mps", "vEgo", "v_ego", "carState.vEgo"),
    "acceleration_mps2": ("accel_mps2", "aEgo", "a_ego", "carState.aEgo"),
    "yaw_rate_radps": ("yaw_rate_radps", "yawRate", "carState.yawRate"),
    "latitude_deg": ("lat", "latitude", "gpsLocation.latitude", "gpsLocationExternal.latitude"),
    "longitude_deg": ("lon", "longitude", "gpsLocation.longitude", "gpsLocationExternal.longitude"),
    "vehicle_id": ("track_id", "trackId", "radarTracks.trackId"),
    "ahead_m": ("x_rel_m", "dRel"),
    "left_m": ("y_rel_left_m", "yRel"),
    "relative_mps": ("v_rel_mps", "vRel"),
}
RADAR = ("time_s", "vehicle_id", "ahead_m", "left_m", "relative_mps")
CAR = ("time_s", "speed_mps")
PLACE = ("time_s", "latitude_deg", "longitude_deg")


@dataclass(frozen=True)
class _Segment:
    """The tables of a drive."""

    radar: Frame
    car: Frame
    place: Frame


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Read a drive from the tables of a folder, or several from folders in it.

    Raises:
        CaseError: car state, radar tracks or location are nowhere.
    """
    folder = source if source.is_dir() else source.parent
    folders = [one for one in sorted(folder.iterdir()) if one.is_dir() and _tables_in(one)] or [folder]
    drives, said = [], []
    for one in folders:
        drives.append(_drive(one, _read(one), options, said))
    return Imported(tuple(drives), tuple(said))


def _tables_in(folder: Path) -> list[Path]:
    return [file for file in sorted(folder.iterdir()) if file.name.lower().endswith(TABLES)]


def _read(folder: Path) -> _Segment:
    tables = [_numbers(file, _renamed(read_table(file))) for file in _tables_in(folder)]

    def having(columns: Sequence[str], what: str) -> Frame:
        found = [table for table in tables if set(columns) <= set(table)]
        if not found:
            names = " and ".join(NAMES[column][0] for column in columns)
            raise CaseError(folder, "", f"expected a table of {what} (columns {names}, or openpilot's names); none.")
        return found[0]

    return _Segment(having(RADAR, "radar tracks"), having(CAR, "car state"), having(PLACE, "location"))


def _numbers(file: Path, table: Frame) -> Frame:
    table = with_numbers(file, table, [name for name in NAMES if name in table and name != "vehicle_id"])
    if "time_s" in table and float(table["time_s"].max()) > NANOSECONDS:
        table = table.assign(time_s=table["time_s"] * 1e-9)
    return table


def _renamed(table: Frame) -> Frame:
    names = {theirs: ours for ours, several in NAMES.items() for theirs in several[::-1]}
    table = table.rename(columns={theirs: names[theirs] for theirs in table if theirs in names})
    return table.loc[:, ~table.columns.duplicated()]


def _drive(folder: Path, segment: _Segment, options: ImportOptions, said: list[str]) -> ImportedDrive:
    if len(place := segment.place.dropna(subset=list(PLACE))) < 2:
        expected = f"expected two rows at least with time, latitude and longitude; got {len(place)}."
        raise CaseError(folder, "", expected)
    car = segment.car.sort_values("time_s").dropna(subset=["time_s", "speed_mps"])
    place = segment.place.sort_values("time_s").dropna(subset=["time_s", "latitude_deg", "longitude_deg"])
    x_m, y_m, crs = plane_of(place["longitude_deg"].to_numpy(float), place["latitude_deg"].to_numpy(float))
    time_s = place["time_s"].to_numpy(float)

    def at_place(column: str) -> np.ndarray:
        if column not in car:
            return np.full(len(time_s), np.nan)
        return np.interp(time_s, car["time_s"].to_numpy(float), car[column].to_numpy(float))

    own = pd.DataFrame({"time_s": time_s, "x_m": x_m, "y_m": y_m})
    own = own.assign(**{name: at_place(name) for name in ("speed_mps", "acceleration_mps2", "yaw_rate_radps")})
    radar = segment.radar.dropna(subset=list(RADAR))
    seen_s = radar["time_s"].to_numpy(float)
    own_mps = np.interp(seen_s, car["time_s"].to_numpy(float), car["speed_mps"].to_numpy(float))
    speed_mps = own_mps + radar["relative_mps"].to_numpy(float)
    standing = (np.abs(speed_mps) < STANDING_MPS) & (own_mps > DRIVING_MPS)
    oncoming = speed_mps <= -STANDING_MPS
    objects: Frame = pd.DataFrame(
        {
            "time_s": seen_s,
            "vehicle_id": radar["vehicle_id"].to_numpy(),
            "ahead_m": radar["ahead_m"].to_numpy(float) + USUAL_LENGTH_M,
            "left_m": radar["left_m"].to_numpy(float),
            "speed_mps": np.maximum(speed_mps, 0.0),
        }
    )[~standing & ~oncoming]
    said += [
        f"{folder.name}: {len(time_s)} places, {len(objects)} of {len(radar)} radar targets; left out are "
        f"{int(standing.sum())} that stand at the roadside and {int(oncoming.sum())} of oncoming traffic.",
        f"{folder.name}: a radar sees rears; {USUAL_LENGTH_M:g} m are added to reach the front bumpers.",
    ]
    return recorded_drive(folder.name, own, objects.drop_duplicates(["time_s", "vehicle_id"]), crs, options)
