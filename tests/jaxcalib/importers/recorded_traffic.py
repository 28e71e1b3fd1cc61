"""Traffic whose every place is known, and how each format would write it down."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

STEP_S, LASTS_S = 0.2, 24.0
ROAD_M, LANE_M, NUM_LANES = 600.0, 3.6, 3
SUBJECT = "11"


def traffic() -> pd.DataFrame:
    """Fronts of vehicles on a straight road of three lanes; each at its own speed, cars and trucks, one changing lanes.

    They stay while they are on the recorded stretch.
    """
    times = np.round(np.arange(0.0, LASTS_S, STEP_S), 3)
    tracks = []
    for number in range(40):
        lane = number % NUM_LANES + 1
        speed_mps = 18.0 + 5.0 * lane + 0.7 * (number % 5)
        length_m = 12.0 if lane == 1 and number % 2 else 4.0 + 0.2 * (number % 4)
        x_m = 620.0 - 55.0 * number + speed_mps * times
        y_m = (lane - 0.5) * LANE_M + np.zeros(len(times))
        lanes = np.full(len(times), lane)
        if number == 9:  # goes over to the next lane in the fifteenth second
            share = np.clip((times - 14.0) / 4.0, 0.0, 1.0)
            y_m, lanes = y_m + LANE_M * share, np.where(share > 0.5, lane + 1, lane)
        track = pd.DataFrame(
            {
                "vehicle": str(number + 1), "time_s": times, "x_m": x_m, "y_m": y_m, "speed_mps": speed_mps,
                "lane": lanes, "length_m": length_m,
            }
        )  # fmt: skip
        tracks.append(track[(x_m > 0.0) & (x_m - length_m < ROAD_M)])
    return pd.concat(tracks, ignore_index=True)


def write_ngsim(folder: Path, is_feet: bool) -> Path:
    """As the US DOT has published it: lanes from the left, places from the left edge, milliseconds since 1970."""
    unit_m, truth = 0.3048 if is_feet else 1.0, traffic()
    table = pd.DataFrame(
        {
            "Vehicle_ID": truth.vehicle.astype(int),
            "Frame_ID": (truth.time_s / 0.1).round().astype(int),
            "Global_Time": (1118847000000 + 1000 * truth.time_s).round().astype("int64"),
            "Local_X": (NUM_LANES * LANE_M - truth.y_m) / unit_m,
            "Local_Y": truth.x_m / unit_m,
            "v_Length": truth.length_m / unit_m,
            "v_Vel": truth.speed_mps / unit_m,
            "v_Acc": 0.0,
            "Lane_ID": NUM_LANES + 1 - truth.lane,
            "Location": "us-101",
        }
    )
    on_ramp = table.head(20).assign(Vehicle_ID=999, Lane_ID=7)
    file = folder / "trajectories.csv"
    pd.concat([table, on_ramp]).to_csv(file, index=False)
    return file


def write_highd(folder: Path, is_upper: bool) -> Path:
    """highD: corners of boxes in a picture with y downwards; the upper carriageway drives to the left."""
    truth = traffic()
    middle = 40.0 + truth.y_m if is_upper else 40.0 - truth.y_m
    left = -truth.x_m if is_upper else truth.x_m - truth.length_m
    width = np.where(truth.length_m > 7.5, 2.5, 1.9)
    tracks = pd.DataFrame(
        {
            "frame": (truth.time_s / STEP_S).round().astype(int) + 1,
            "id": truth.vehicle.astype(int),
            "x": left + (700.0 if is_upper else 0.0),
            "y": middle - width / 2.0,
            "width": truth.length_m,
            "height": width,
            "xVelocity": -truth.speed_mps if is_upper else truth.speed_mps,
            "yVelocity": 0.0,
            "xAcceleration": 0.0,
            "yAcceleration": 0.0,
            "laneId": truth.lane + 1 if is_upper else NUM_LANES + 5 - truth.lane,
        }
    )
    oncoming = tracks.head(5).assign(id=777)
    direction = 1 if is_upper else 2
    meta = pd.DataFrame({"id": truth.vehicle.astype(int).unique()}).assign(drivingDirection=direction)
    meta = pd.concat([meta, pd.DataFrame({"id": [777], "drivingDirection": [3 - direction]})])
    pd.concat([tracks, oncoming]).to_csv(folder / "01_tracks.csv", index=False)
    meta.to_csv(folder / "01_tracksMeta.csv", index=False)
    recording = pd.DataFrame([{"id": 1, "frameRate": 1 / STEP_S, "speedLimit": 36.11, "locationId": 1}])
    recording.to_csv(folder / "01_recordingMeta.csv", index=False)
    return folder


MAPPING = """
[log]
[log.columns]
time_s = { column = "t_ms", unit = "ms" }
vehicle_id = { column = "track" }
x_m = { column = "east", unit = "ft" }
y_m = { column = "north", unit = "ft" }
speed_kmh = { column = "v", unit = "m/s" }
"""


def write_table(folder: Path) -> Path:
    """A table of somebody's: other names and units, for MAPPING."""
    truth = traffic()
    table = pd.DataFrame(
        {
            "track": "veh/" + truth.vehicle,
            "t_ms": 1000.0 * truth.time_s,
            "east": truth.x_m / 0.3048,
            "north": truth.y_m / 0.3048,
            "v": truth.speed_mps,
            "lane": truth.lane,
            "length_m": truth.length_m,
        }
    )
    file = folder / "tracks.csv"
    table.to_csv(file, index=False)
    (folder / "mapping.toml").write_text(MAPPING)
    return file


def _fcd_xml(folder: Path) -> Path:
    lines = ['<?xml version="1.0" encoding="UTF-8"?>', "<fcd-export>"]
    for time_s, rows in traffic().groupby("time_s"):
        lines.append(f'<timestep time="{time_s:.2f}">')
        lines += [
            f'<vehicle id="{row.vehicle}" x="{row.x_m:.3f}" y="{row.y_m:.3f}" angle="90.00" type="car" '
            f'speed="{row.speed_mps:.3f}" pos="{row.x_m:.2f}" lane="road_{row.lane - 1}" slope="0.00"/>'
            for row in rows.itertuples()
        ]
        lines.append("</timestep>")
    file = folder / "fcd.xml.gz"
    with gzip.open(file, "wt") as stream:
        stream.write("\n".join([*lines, "</fcd-export>"]))
    return file


def _fcd_table(folder: Path, suffix: str) -> Path:
    truth = traffic().sort_values("time_s", kind="stable")
    table = pd.DataFrame(
        {
            "timestep_time": truth.time_s,
            "vehicle_angle": 90.0,
            "vehicle_id": truth.vehicle,
            "vehicle_speed": truth.speed_mps,
            "vehicle_x": truth.x_m,
            "vehicle_y": truth.y_m,
        }
    )
    empty = table.head(1).assign(timestep_time=-STEP_S, **{name: None for name in table if name != "timestep_time"})
    file = folder / f"fcd.{suffix}"
    if suffix == "csv":
        pd.concat([empty, table]).to_csv(file, index=False, sep=";")
    else:
        table.to_parquet(file, index=False)
    return file


def write_fcd(folder: Path, suffix: str) -> Path:
    """SUMO's floating car data as XML, CSV or Parquet."""
    return _fcd_xml(folder) if suffix == "xml" else _fcd_table(folder, suffix)


WRITERS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "ngsim in feet": ("ngsim", lambda folder: write_ngsim(folder, True)),
    "ngsim in metres": ("ngsim", lambda folder: write_ngsim(folder, False)),
    "highd, lower carriageway": ("highd", lambda folder: write_highd(folder, False)),
    "highd, upper carriageway": ("highd", lambda folder: write_highd(folder, True)),
    "table": ("trajectories", write_table),
    "fcd, xml": ("sumo-fcd", lambda folder: write_fcd(folder, "xml")),
    "fcd, csv": ("sumo-fcd", lambda folder: write_fcd(folder, "csv")),
    "fcd, parquet": ("sumo-fcd", lambda folder: write_fcd(folder, "parquet")),
}
