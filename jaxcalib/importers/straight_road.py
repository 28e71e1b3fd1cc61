"""A straight carriageway, as recordings from above show it, and a SUMO scenario of it."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxcalib.errors import CaseError
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import StraightRoad
from sim_adapters.units import mps_from_kmh, vehph_from_vehps

TRUCK_M = 7.5  # length from which a vehicle is taken for a truck
USUAL_LENGTH_M: Mapping[str, float] = {"car": 4.6, "truck": 14.0}
USUAL_WIDTH_M = 3.5  # of a lane where there is but one
LEAST_WIDTH_M = 2.5
LEAST_LIMIT_KMH = 120.0  # congested recordings do not show the limit; desired speeds are calibrated in any case
UPSTREAM_M, DOWNSTREAM_M = 500.0, 200.0  # of the recorded stretch: who enters has found lane and speed when it is seen
FASTEST = 99.0  # percentile of the speeds
STANDS_SHARE = 0.8  # of a recording's stretch is occupied at once, in the mean, where the camera stands
EDGE = "road"
IDM = {  # Treiber & Kesting 2013, Table 11.2, motorway
    "carFollowModel": "IDM", "tau": "1.0", "minGap": "2.0", "accel": "1.0", "decel": "1.5",
}  # fmt: skip
GUI_SHAPE: Mapping[str, str] = {"car": "passenger", "truck": "truck"}


def straight_road_of(table: Frame, speed_limit_mps: float | None = None) -> StraightRoad:
    """The road that trajectories show.

    Args:
        table: columns vehicle, time_s, x_m, y_m, speed_mps, lane (from 1 = rightmost, all known) and length_m;
            several recordings have a column `recording`.
        speed_limit_mps: legal limit, if it is known.

    Raises:
        CaseError: no lanes are to be seen.
    """
    centre_m = table.groupby("lane")["y_m"].median().sort_index()
    if not len(centre_m) or (np.diff(centre_m) < LEAST_WIDTH_M).any():
        raise CaseError("command line", "SOURCE", "expected lanes beside one another, numbered from right to left.")
    edges_m = (centre_m.to_numpy()[1:] + centre_m.to_numpy()[:-1]) / 2.0
    half_m = np.diff(centre_m).mean() / 2.0 if len(centre_m) > 1 else USUAL_WIDTH_M / 2.0
    bounds_m = np.concatenate([[centre_m.iloc[0] - half_m], edges_m, [centre_m.iloc[-1] + half_m]])
    begin_m, end_m = float(table["x_m"].min()), float(table["x_m"].max())
    is_truck = table.groupby("vehicle")["length_m"].median() >= TRUCK_M
    kinds = {"car": is_truck.index[~is_truck], "truck": is_truck.index[is_truck]}
    fastest_mps = float(np.nanpercentile(table["speed_mps"], FASTEST))
    limit_mps = speed_limit_mps or max(float(mps_from_kmh(LEAST_LIMIT_KMH)), fastest_mps)
    return StraightRoad(
        begin_m=begin_m,
        end_m=end_m,
        right_m=float(bounds_m[0]),
        widths_m=tuple(map(float, np.diff(bounds_m))),
        vehicles_per_hour={kind: _flow_vehph(table, mine) for kind, mine in kinds.items()},
        lengths_m={kind: _length_m(table, mine, USUAL_LENGTH_M[kind]) for kind, mine in kinds.items()},
        speed_limit_mps=limit_mps,
    )


def _flow_vehph(table: Frame, vehicles: Frame) -> float:
    """Flow by Edie's definition (1963): way driven by all, by length times duration of what each recording shows."""
    recording = table["recording"] if "recording" in table else pd.Series(0, table.index)
    area_ms = sum(_shown_ms(rows) for _, rows in table.groupby(recording))
    mine = table[table["vehicle"].isin(vehicles)]
    way_m = float(mine.groupby([recording[mine.index], "vehicle"])["x_m"].agg(np.ptp).sum())
    return float(vehph_from_vehps(way_m / max(area_ms, 1e-9)))


def _shown_ms(recording: Frame) -> float:
    """Length times duration of what a recording shows.

    A camera that stands shows the same stretch all the time. Where vehicles never are on most of it at once, as in
    parts that were cut out around some of them, it is what is occupied at each instant: n places drawn evenly from a
    stretch span (n - 1) / (n + 1) of it.
    """
    whole_m, lasted_s = np.ptp(recording["x_m"]), np.ptp(recording["time_s"])
    at_once = recording.groupby("time_s")["x_m"].agg(["min", "max", "size"])
    several = at_once["size"] > 1
    stretched_m = (at_once["max"] - at_once["min"]) * (at_once["size"] + 1) / (at_once["size"] - 1).where(several)
    seen_m = float(stretched_m.clip(upper=whole_m).fillna(whole_m).mean())
    return float(lasted_s * (whole_m if seen_m > STANDS_SHARE * whole_m else seen_m))


def _length_m(table: Frame, vehicles: Frame, usual_m: float) -> float:
    known = table.loc[table["vehicle"].isin(vehicles), "length_m"].dropna()
    return float(known.median()) if len(known) else usual_m


def write_scenario(road: StraightRoad, folder: Path, end_s: float) -> Path:
    """Write a network, a demand and a configuration; the network's plane is the recording's.

    Args:
        road: the road.
        folder: where to write.
        end_s: end of the simulation.

    Returns:
        The configuration.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _write(_network(road), folder / "net.net.xml")
    _write(_demand(road, end_s), folder / "demand.rou.xml")
    root = ET.Element("configuration")
    values = {
        "input": {"net-file": "net.net.xml", "route-files": "demand.rou.xml"},
        "time": {"begin": "0", "end": f"{end_s:g}", "step-length": "0.1"},
        "processing": {"time-to-teleport": "-1"},
    }
    for section, options in values.items():
        element = ET.SubElement(root, section)
        for option, value in options.items():
            ET.SubElement(element, option, value=value)
    return _write(root, folder / "scenario.sumocfg")


def _network(road: StraightRoad) -> ET.Element:
    first_m, last_m = road.begin_m - UPSTREAM_M, road.end_m + DOWNSTREAM_M
    root = ET.Element("net", version="1.20")
    left_m = road.right_m + sum(road.widths_m)
    boundary = f"{first_m:.2f},{road.right_m:.2f},{last_m:.2f},{left_m:.2f}"
    ET.SubElement(
        root, "location", netOffset="0.00,0.00", convBoundary=boundary, origBoundary=boundary, projParameter="!"
    )
    edge = ET.SubElement(root, "edge", {"id": EDGE, "from": "begin", "to": "end", "priority": "1"})
    below_m = road.right_m
    for index, width_m in enumerate(road.widths_m):
        y_m = below_m + width_m / 2.0
        below_m += width_m
        ET.SubElement(
            edge, "lane", id=f"{EDGE}_{index}", index=str(index), speed=f"{road.speed_limit_mps:.2f}",
            length=f"{last_m - first_m:.2f}", width=f"{width_m:.2f}",
            shape=f"{first_m:.2f},{y_m:.2f} {last_m:.2f},{y_m:.2f}",
        )  # fmt: skip
    lanes = " ".join(f"{EDGE}_{index}" for index in range(len(road.widths_m)))
    for name, x_m, incoming in (("begin", first_m, ""), ("end", last_m, lanes)):
        ET.SubElement(
            root, "junction", id=name, type="dead_end", x=f"{x_m:.2f}", y=f"{road.right_m:.2f}", incLanes=incoming,
            intLanes="", shape=f"{x_m:.2f},{road.right_m:.2f} {x_m:.2f},{left_m:.2f}",
        )  # fmt: skip
    return root


def _demand(road: StraightRoad, end_s: float) -> ET.Element:
    root = ET.Element("routes")
    flows = {kind: rate for kind, rate in road.vehicles_per_hour.items() if rate > 0.0}
    for kind in flows:
        own = {"id": kind, "vClass": GUI_SHAPE[kind], "length": f"{road.lengths_m[kind]:.2f}", "speedDev": "0.1"}
        ET.SubElement(root, "vType", own | IDM)
    ET.SubElement(root, "route", id="along", edges=EDGE)
    for kind, rate in flows.items():
        # not "last": on an edge as long as this one SUMO would put vehicles where the road ends
        departure = {"departLane": "best", "departPos": "base", "departSpeed": "avg"}
        times = {"begin": "0", "end": f"{end_s:g}", "vehsPerHour": f"{rate:.1f}"}
        ET.SubElement(root, "flow", {"id": kind, "type": kind, "route": "along"} | times | departure)
    return root


def _write(root: ET.Element, file: Path) -> Path:
    ET.indent(root, "    ")
    file.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    return file
