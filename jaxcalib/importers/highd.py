"""The highD family: highD's straight motorways, which show their road, and exiD's exits, which need a scenario."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxcalib.errors import CaseError
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import Imported, ImportOptions, StraightRoad
from jaxcalib.importers.planes import utm_at
from jaxcalib.importers.straight_road import straight_road_of
from jaxcalib.importers.tables import read_table, with_numbers
from jaxcalib.importers.trajectories import Recording, completed, slices_of
from jaxcalib.importers.virtual_probes import virtual_probes

TRACKS = re.compile(r"(\d+)_tracks\.(csv|csv\.gz|parquet)", re.IGNORECASE)
HIGHD_COLUMNS = ("frame", "id", "x", "y", "width", "height", "xVelocity", "xAcceleration", "laneId")
EXID_COLUMNS = ("frame", "trackId", "xCenter", "yCenter", "heading", "lonVelocity", "lonAcceleration")
UPPER, LOWER = 1, 2  # drivingDirection: to the left in the upper half of the picture, to the right in the lower


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Make virtual probes of recordings NN_tracks, NN_tracksMeta and NN_recordingMeta in a folder.

    Of highD the carriageway with more vehicles is taken. Its picture has y downwards, places are the upper left
    corners of boxes, lengths their widths (Krajewski et al. 2018; format of the data set's documentation).

    Raises:
        CaseError: there is no such file, or a column is missing.
    """
    files = _tracks_in(source)
    tables, said, limits = [], [], []
    places: set[str] = set()
    crs: str | None = None
    for file in files:
        of_recording = _beside(file, "recordingMeta")
        meta = with_numbers(of_recording, read_table(of_recording), ("frameRate",)).iloc[0]
        places.add(str(meta.get("locationId", "")))
        if len(places) > 1:
            expected = (
                f"expected recordings of one place, got locationId {', '.join(sorted(places))}; import them apart."
            )
            raise CaseError(file, "", expected)
        tracks, own = read_table(file), read_table(_beside(file, "tracksMeta"))
        if "xCenter" in tracks:
            table, crs = _exid(file, tracks, own, meta)
        else:
            table = _highd(file, tracks, own, meta, said)
            limits.append(float(meta.get("speedLimit", -1.0)))
        tables.append(completed(table).assign(recording=file.name.split("_")[0]))
    if crs is not None and options.config is None:
        raise CaseError("command line", "--scenario", "expected a scenario of the road: exiD's is not straight.")
    recordings = [
        Recording(str(table["recording"].iloc[0]), lambda rows=table: slices_of(rows), crs) for table in tables
    ]
    drives, why = virtual_probes(recordings, options)
    said += [f"{len(recordings)} recordings, {len(drives)} of their vehicles as subject vehicles.", why]
    return Imported(tuple(drives), tuple(said), None if options.config else _road(tables, limits))


def _road(tables: Sequence[Frame], limits: Sequence[float]) -> StraightRoad:
    known = [limit for limit in limits if limit > 0.0]
    together = pd.concat(tables, ignore_index=True)
    together["vehicle"] = together["recording"] + "-" + together["vehicle"]
    return straight_road_of(together, max(known) if known else None)


def _tracks_in(source: Path) -> list[Path]:
    if source.is_file() and TRACKS.fullmatch(source.name):
        return [source]
    files = sorted(file for file in source.iterdir() if TRACKS.fullmatch(file.name)) if source.is_dir() else []
    if not files:
        raise CaseError(source, "", "expected a file NN_tracks.csv, or a folder with such files.")
    return files


def _beside(tracks: Path, what: str) -> Path:
    file = tracks.with_name(tracks.name.replace("_tracks.", f"_{what}."))
    if not file.is_file():
        raise CaseError(tracks, "", f"expected {file.name} beside it; there is none.")
    return file


def _highd(file: Path, tracks: Frame, own: Frame, meta: Frame, said: list[str]) -> Frame:
    """The carriageway with more vehicles, turned so that traffic moves along +x and y is to the left."""
    tracks = with_numbers(file, tracks, HIGHD_COLUMNS)
    own = with_numbers(_beside(file, "tracksMeta"), own, ("id", "drivingDirection"))
    counts = own["drivingDirection"].value_counts()
    if counts.empty:
        raise CaseError(_beside(file, "tracksMeta"), "column drivingDirection", "expected 1 or 2; it is empty.")
    direction = int(counts.idxmax())
    if len(counts) > 1:
        what = "upper" if direction == UPPER else "lower"
        left_out = int(counts.sum() - counts.max())
        said.append(f"{file.name}: the {what} carriageway; {left_out} vehicles of the other are left out.")
    table = tracks[tracks["id"].isin(own["id"][own["drivingDirection"] == direction])]
    sign = -1.0 if direction == UPPER else 1.0
    front = table["x"] if direction == UPPER else table["x"] + table["width"]
    middle = table["y"] + table["height"] / 2.0
    lanes = sorted(table["laneId"].unique(), reverse=direction == LOWER)  # ids rise downwards in the picture
    return pd.DataFrame(
        {
            "vehicle": table["id"],
            "time_s": (table["frame"] - tracks["frame"].min()) / float(meta["frameRate"]),
            "x_m": sign * front,
            "y_m": -sign * middle,
            "speed_mps": np.abs(table["xVelocity"]),
            "acceleration_mps2": sign * table["xAcceleration"],
            "length_m": table["width"],
            "lane": table["laneId"].map({lane: number for number, lane in enumerate(lanes, start=1)}),
        }
    )


def _exid(file: Path, tracks: Frame, own: Frame, meta: Frame) -> tuple[Frame, str]:
    """All vehicles, in the UTM zone of the place; centres of boxes are moved to the front."""
    tracks = with_numbers(file, tracks, EXID_COLUMNS)
    own = with_numbers(_beside(file, "tracksMeta"), own, ("trackId", "length"))
    length_m = tracks["trackId"].map(own.set_index("trackId")["length"])
    heading = np.radians(tracks["heading"])
    table = pd.DataFrame(
        {
            "vehicle": tracks["trackId"],
            "time_s": (tracks["frame"] - tracks["frame"].min()) / float(meta["frameRate"]),
            "x_m": float(meta["xUtmOrigin"]) + tracks["xCenter"] + np.cos(heading) * length_m / 2.0,
            "y_m": float(meta["yUtmOrigin"]) + tracks["yCenter"] + np.sin(heading) * length_m / 2.0,
            "heading_rad": heading,
            "speed_mps": np.abs(tracks["lonVelocity"]),
            "acceleration_mps2": tracks["lonAcceleration"],
            "length_m": length_m,
        }
    )
    return table, utm_at(float(meta["lonLocation"]), float(meta["latLocation"]))
