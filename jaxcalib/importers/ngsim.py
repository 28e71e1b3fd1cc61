"""NGSIM's vehicle trajectories (I-80, US-101): as published, in feet, or in one of the metric tables made of them."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyproj

from jaxcalib.errors import CaseError
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.planes import plane_of
from jaxcalib.importers.straight_road import straight_road_of
from jaxcalib.importers.tables import read_table, with_numbers
from jaxcalib.importers.trajectories import Recording, completed, slices_of
from jaxcalib.importers.virtual_probes import virtual_probes

FOOT_M = 0.3048
LONGEST_GAP_S = 60.0  # ids are used again in the next period of a location
LONGEST_CAR_M = 9.0  # typical length beyond which lengths are in feet
MOST_LANES = 8
AUXILIARY_LANES: Mapping[str, tuple[int, ...]] = {"us-101": (6, 7, 8), "i-80": (7, 8, 9)}  # auxiliary, on-, off-ramp

# Names of the published file (US DOT, 8ect-6jqj), in lower case; places from the left edge, across and along.
PUBLISHED: Mapping[str, str] = {
    "vehicle_id": "vehicle", "global_time": "time_ms", "local_y": "along", "local_x": "across", "v_vel": "speed",
    "v_acc": "acceleration", "v_length": "length", "lane_id": "lane_from_left", "location": "location",
    "global_x": "east", "global_y": "north",
}  # fmt: skip
# Metric tables name their units; y_m is to the left, lanes count from the right, 0 and less are no main lanes.
METRIC: Mapping[str, str] = {
    "vehicle_id": "vehicle", "time_s": "time_s", "x_m": "x_m", "y_m": "y_m", "speed_mps": "speed_mps",
    "accel_mps2": "acceleration_mps2", "length_m": "length_m", "lane_id": "lane", "segment_id": "segment",
    "period": "segment",
}  # fmt: skip
USUAL_LANE_M = 3.6


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Make virtual probes of NGSIM's trajectories.

    Raises:
        CaseError: a column is missing, or nothing drives on the main lanes.
    """
    table = read_table(source)
    table.columns = [str(name).strip().lower() for name in table.columns]
    said: list[str] = []
    crs: str | None = None
    if {"local_x", "local_y"} <= set(table.columns):
        table = _published(source, table, said)
        if options.crs is not None and {"east", "north"} <= set(table.columns):
            table, crs = _on_globe(table, options.crs)
            said.append(f"{source.name}: places by Global_X and Global_Y, in {options.crs}.")
    elif {"x_m", "time_s", "lane_id"} <= set(table.columns):
        table = _metric(source, table, said)
    else:
        expected = "expected NGSIM's columns Vehicle_ID, Global_Time, Local_X, Local_Y, v_Vel, Lane_ID, in any case;"
        raise CaseError(source, "header", f"{expected} the file has {', '.join(table.columns)[:120]}.")
    main = table["lane"].between(1, MOST_LANES)
    if not main.all():
        said.append(f"{int((~main).sum())} of {len(table)} rows on auxiliary lanes and ramps are left out.")
    table = table[main]
    places = sorted(set(table["location"])) if "location" in table else []
    if len(places) > 1:
        expected = f"expected one location, got {', '.join(places)}; cut the table into parts, one for each."
        raise CaseError(source, "column Location", expected)
    table = table.assign(lane=table["lane"].rank(method="dense").astype(int))
    if table.empty:
        raise CaseError(source, "", "expected vehicles on main lanes; there is none.")
    recordings = [
        Recording(str(name), partial(slices_of, completed(rows)), crs)
        for name, rows in table.groupby("recording", sort=False)
    ]
    drives, why = virtual_probes(recordings, options)
    said += [f"{source.name}: {len(recordings)} recordings, {len(drives)} of their vehicles as subject vehicles.", why]
    road = straight_road_of(completed(table)) if options.config is None and crs is None else None
    return Imported(tuple(drives), tuple(said), road)


def _renamed(source: Path, table: Frame, names: Mapping[str, str], needed: tuple[str, ...]) -> Frame:
    texts = ("vehicle", "location", "segment")
    numbers = [name for name, ours in names.items() if name in table and ours not in texts]
    table = with_numbers(source, table, numbers)
    table = table[[name for name in names if name in table]].rename(columns=dict(names))
    missing = [name for name, ours in names.items() if ours in needed and ours not in table]
    if missing:
        raise CaseError(source, f"column {missing[0]}", "expected this column of NGSIM's; it is not there.")
    return table


def _published(source: Path, table: Frame, said: list[str]) -> Frame:
    table = _renamed(source, table, PUBLISHED, ("vehicle", "time_ms", "along", "across", "speed", "lane_from_left"))
    lengths = table["length"] if "length" in table else pd.Series([15.0])
    is_feet = float(lengths.median()) > LONGEST_CAR_M
    unit_m = FOOT_M if is_feet else 1.0
    said.append(f"{source.name}: {'feet' if is_feet else 'metres'}, by the typical length of a vehicle.")
    location = table["location"].astype(str).str.lower() if "location" in table else pd.Series("", table.index)
    lane = table["lane_from_left"].to_numpy(int)
    is_main = np.ones(len(lane), bool)
    for place, auxiliary in AUXILIARY_LANES.items():
        is_main &= (location != place).to_numpy() | ~np.isin(lane, auxiliary)
    most = int(lane[is_main].max(initial=1))
    table = pd.DataFrame(
        {
            "vehicle": table["vehicle"],
            "time_s": (table["time_ms"] - table["time_ms"].min()) / 1000.0,
            "x_m": table["along"] * unit_m,
            "y_m": -table["across"] * unit_m,
            "speed_mps": table["speed"] * unit_m,
            "acceleration_mps2": table["acceleration"] * unit_m if "acceleration" in table else np.nan,
            "length_m": table["length"] * unit_m if "length" in table else np.nan,
            "lane": np.where(is_main, most + 1 - lane, 0),
            "location": location,
            **{name: table[name] for name in ("east", "north") if name in table},
        }
    ).drop_duplicates(["location", "vehicle", "time_s"])
    return _in_recordings(table.sort_values(["location", "time_s"], kind="stable"))


def _on_globe(table: Frame, crs: str) -> tuple[Frame, str]:
    """The table with its geographic places instead of those along and across the road."""
    to_globe = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    longitude_deg, latitude_deg = to_globe.transform(table["east"].to_numpy(float), table["north"].to_numpy(float))
    x_m, y_m, plane = plane_of(np.asarray(longitude_deg), np.asarray(latitude_deg))
    return table.assign(x_m=x_m, y_m=y_m), plane


def _in_recordings(table: Frame) -> Frame:
    """Cut where nothing was recorded for a minute: locations, and their periods; each has its own clock."""
    gaps_s = table.groupby("location")["time_s"].diff().fillna(np.inf)
    number = (gaps_s > LONGEST_GAP_S).cumsum()
    begin_s = table.groupby(number)["time_s"].transform("min")
    name = table["location"].where(table["location"] != "", "ngsim") + "-" + number.astype(str)
    return table.assign(time_s=(table["time_s"] - begin_s).round(3), recording=name)


def _metric(source: Path, table: Frame, said: list[str]) -> Frame:
    table = _renamed(source, table, METRIC, ("vehicle", "time_s", "x_m", "lane"))
    segment = table["segment"].astype(str) if "segment" in table else pd.Series("ngsim", table.index)
    if "y_m" not in table:
        said.append(f"{source.name}: no places across; lanes of {USUAL_LANE_M:g} m are assumed.")
        table = table.assign(y_m=(table["lane"] - 0.5) * USUAL_LANE_M)
    begin_s = table.groupby(segment)["time_s"].transform("min")
    return table.assign(time_s=table["time_s"] - begin_s, recording=segment).drop_duplicates(
        ["recording", "vehicle", "time_s"]
    )
