"""Any table of vehicle, time and place: its columns are named by a mapping, as those of logs are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import sumolib
from sumolib.geomhelper import positionAtShapeOffset

from jaxcalib.case.case_file import read_log_section
from jaxcalib.case.log_form import TABLE_1, LogForm
from jaxcalib.case.log_units import log_form_of
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.log_columns import our_names, read_log_columns
from jaxcalib.field.size_limit import OF_RECORDINGS
from jaxcalib.field.table_files import ColumnTable, Kind
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import Imported, ImportOptions
from jaxcalib.importers.planes import plane_of
from jaxcalib.importers.straight_road import straight_road_of
from jaxcalib.importers.trajectories import Recording, completed, slices_of
from jaxcalib.importers.virtual_probes import virtual_probes
from sim_adapters.scenario.configuration import read_configuration
from sim_adapters.units import mps_from_kmh

OPTIONAL = ("speed_kmh", "acceleration_mps2", "lane", "length_m")
USUAL_LANE_M = 3.6
USUAL_LENGTH_M = 4.6
MOST_LANES = 8
ALONG, MOST_ALONG = 0.95, 0.9  # cosine of the direction, and share of the rows


def read_recording(source: Path, options: ImportOptions) -> Imported:
    """Make virtual probes of a table of trajectories (.csv, .csv.gz, .parquet).

    Places are x_m and y_m (in the network's plane, in that of --crs, or along and across a straight road),
    longitude_rad and latitude_rad, edge and position_m, or position_m and lane along a straight road.

    Raises:
        CaseError: a column is missing, or cannot be read.
    """
    form = TABLE_1 if options.mapping is None else log_form_of(read_log_section(options.mapping)[0], options.mapping)
    if options.crs is not None:
        form = replace(form, crs=options.crs)
    names = our_names(source, form.objects)
    kinds: dict[str, Kind] = {"time_s": "number", "vehicle_id": "text"}
    kinds |= {name: "number" for name in OPTIONAL if name in names}
    place = _place(source, names)
    kinds |= {name: "text" if name == "edge" else "number" for name in place}
    columns = read_log_columns(source, kinds, form.objects, limit=OF_RECORDINGS)
    table = _table(columns)
    said = [f"{source.name}: {len(table)} rows of {table['vehicle'].nunique()} vehicles; places by {', '.join(place)}."]
    table, crs, is_straight = _placed(source, table, columns, place, form, options)
    table = completed(table.dropna(subset=["time_s", "x_m", "y_m"]))
    table = _at_front(table, form)
    recording = Recording(source.name.split(".")[0], lambda: slices_of(table), crs)
    recording = replace(recording, has_scenario_clock=options.config is not None and options.begin_s is None)
    drives, why = virtual_probes([recording], options)
    said += [f"{len(drives)} of the vehicles as subject vehicles.", why]
    main = table[table["lane"].between(1, MOST_LANES)]
    road = None
    if is_straight and options.config is None and len(main):
        _check_direction(source, main)
        road = straight_road_of(main)
    return Imported(tuple(drives), tuple(said), road)


def _place(source: Path, names: list[str]) -> tuple[str, ...]:
    ways = (("x_m", "y_m"), ("longitude_rad", "latitude_rad"), ("edge", "position_m"), ("position_m", "lane"))
    for way in ways:
        if set(way) <= set(names):
            return way
    expected = "; or ".join(" and ".join(way) for way in ways)
    raise CaseError(source, "header", f"expected columns {expected} (name yours in --mapping, docs/import.md).")


def _table(columns: ColumnTable) -> Frame:
    index, words = columns.texts["vehicle_id"]
    table = pd.DataFrame({"vehicle": np.asarray([*words, ""], object)[index], "time_s": columns.numbers["time_s"]})
    if "speed_kmh" in columns.numbers:
        table["speed_mps"] = mps_from_kmh(columns.numbers["speed_kmh"])  # pyright: ignore[reportArgumentType]
    for name in ("acceleration_mps2", "lane", "length_m"):
        if name in columns.numbers:
            table[name] = columns.numbers[name]
    return table


def _placed(
    source: Path,
    table: Frame,
    columns: ColumnTable,
    place: tuple[str, ...],
    form: LogForm,
    options: ImportOptions,
) -> tuple[Frame, str | None, bool]:
    """The table with x_m, y_m and lanes from the right, the plane's name, and whether it may be a straight road's."""
    if "lane" in table:
        lane = table["lane"] + (1 - form.first_lane)
        lane = lane.max() + 1 - lane if form.lanes_from == "left" else lane
        # from 1, whichever were recorded; numbers below are ramps and auxiliary lanes, as those tables have them
        table = table.assign(lane=lane.where(lane >= 1).rank(method="dense"))
    numbers = columns.numbers
    if place == ("x_m", "y_m"):
        is_straight = form.crs is None
        return table.assign(x_m=numbers["x_m"], y_m=numbers["y_m"]), form.crs, is_straight
    if place[0] == "longitude_rad":
        x_m, y_m, crs = plane_of(np.degrees(numbers["longitude_rad"]), np.degrees(numbers["latitude_rad"]))
        return table.assign(x_m=x_m, y_m=y_m), crs, False
    if place[0] == "position_m":
        return table.assign(x_m=numbers["position_m"], y_m=(table["lane"] - 0.5) * USUAL_LANE_M), None, True
    return _on_edges(source, table, columns, options), None, False


def _check_direction(source: Path, table: Frame) -> None:
    """Raise a CaseError where traffic does not move along +x, as on a road that is to be made of it."""
    along = np.cos(table["heading_rad"].to_numpy(float))
    share = float(np.nanmean(along > ALONG))
    if share < MOST_ALONG:
        expected = (
            f"expected traffic along +x, with y to its left, to make a road of it; {1.0 - share:.0%} of the rows move "
            "otherwise. Turn the places, keep one direction, or give --scenario."
        )
        raise CaseError(source, "columns x_m and y_m", expected)


def _on_edges(source: Path, table: Frame, columns: ColumnTable, options: ImportOptions) -> Frame:
    if options.config is None:
        raise CaseError("command line", "--scenario", "expected the scenario whose edges the table names.")
    net = sumolib.net.readNet(str(read_configuration(options.config).net_file))
    index, words = columns.texts["edge"]
    edge = np.asarray([*words, ""], object)[index]
    unknown = [name for name in words if name and not net.hasEdge(name)]
    if len(unknown) == len(words):
        raise CaseError(source, "column edge", f"expected edges of the network, got {quote(unknown[0])}.")
    position_m = columns.numbers["position_m"]
    lane = table["lane"].fillna(1).to_numpy(int) if "lane" in table else np.ones(len(table), int)
    points = np.full((len(table), 2), np.nan)
    for row, name in enumerate(edge):
        if net.hasEdge(name):
            lanes = net.getEdge(name).getLanes()
            shape = lanes[min(max(lane[row] - 1, 0), len(lanes) - 1)].getShape()
            point = positionAtShapeOffset(shape, float(position_m[row]))
            points[row] = (np.nan, np.nan) if point is None else point[:2]
    return table.assign(x_m=points[:, 0], y_m=points[:, 1], lane=np.nan)


def _at_front(table: Frame, form: LogForm) -> Frame:
    """Move places from the centres of vehicles to their fronts, where the mapping says that they are centres."""
    if form.reference != "centre":
        return table
    half_m = table["length_m"].fillna(USUAL_LENGTH_M) / 2.0
    heading = table["heading_rad"].fillna(0.0)
    return table.assign(x_m=table["x_m"] + half_m * np.cos(heading), y_m=table["y_m"] + half_m * np.sin(heading))
