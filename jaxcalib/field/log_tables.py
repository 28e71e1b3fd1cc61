"""The two tables of a drive as they were recorded: checked row by row, in SI units.

This is the only place that knows the columns of the files and their units.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jaxcalib.case.log_form import TABLE_1, LogForm
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.log_columns import our_names, read_log_columns
from jaxcalib.field.logged_place import LoggedPlace, logged_place, place_columns, place_columns_among
from jaxcalib.field.size_limit import SizeLimit
from jaxcalib.field.table_files import ColumnTable, Kind, row_place
from sim_adapters.units import mps_from_kmh

LANE_UNKNOWN = 0
CLOCK_TOLERANCE_S = 1e-3  # time stamps are rounded
LEAST_SAMPLING_HZ = 1.0
MOST_SAMPLING_HZ = 25.0
SAMPLING_TOLERANCE = 0.05  # of the rate: clocks drift, and time stamps are rounded
HIGHEST_SPEED_KMH = 400.0  # beyond it the unit is surely another one
MOST_LANES = 20
FEW_NEGATIVE, MANY_NEGATIVE = 5, 0.02  # rows, and share of them
EARLY_START_S = 1.0  # a drive may begin this long before its nominal departure

SUBJECT_COLUMNS: Mapping[str, Kind] = {
    "time_s": "number",
    "road": "text",
    "speed_limit_kmh": "number",
    "speed_kmh": "number",
    "yaw_rate_radps": "number",
    "acceleration_mps2": "number",
    "lane": "number",
    "lane_offset_m": "number",
}
OBJECT_COLUMNS: Mapping[str, Kind] = {
    "time_s": "number",
    "vehicle_id": "text",
    "lane": "number",
    "speed_kmh": "number",
    "heading_deg": "number",
}
RELATIVE_COLUMNS: Mapping[str, Kind] = {"relative_x_m": "number", "relative_y_m": "number"}
LENGTH_COLUMN: Mapping[str, Kind] = {"length_m": "number"}  # read where it is there


class EmptyLogError(CaseError):
    """A table of the subject vehicle that has no drive in it."""


@dataclass(frozen=True)
class SubjectLog:
    """The subject vehicle, one row per time stamp, in time order; nan where the log has no value."""

    file: Path  # where it was read
    time_s: np.ndarray  # time on the scenario's clock
    road: np.ndarray  # SUMO edge id or the road's name, empty where unknown
    speed_limit_mps: np.ndarray  # legal limit
    speed_mps: np.ndarray
    yaw_rate_radps: np.ndarray  # angular velocity around the vertical axis
    place: LoggedPlace  # where the front bumper's middle is
    acceleration_mps2: np.ndarray  # longitudinal acceleration
    lane: np.ndarray  # counted from 1, LANE_UNKNOWN where empty
    lane_offset_m: np.ndarray  # centre line to the nearest lane marking
    extra_columns: tuple[str, ...]  # columns that nobody reads
    lanes_from_left: bool = False  # lane 1 is the leftmost

    @property
    def sampling_s(self) -> float:
        """Median time between two rows."""
        return float(np.median(np.diff(self.time_s)))


@dataclass(frozen=True)
class ObjectLog:
    """The detected vehicles, one row per time stamp and vehicle, in the file's order; nan where it says nothing."""

    file: Path  # where it was read
    time_s: np.ndarray  # time on the scenario's clock
    vehicle: np.ndarray  # number of the vehicle, an index into `vehicle_ids`
    vehicle_ids: tuple[str, ...]  # ids, sorted
    lane: np.ndarray  # 1 = rightmost, LANE_UNKNOWN where empty
    # along the road from the subject vehicle, + ahead, and across, + left; nan at first where the log has places
    relative_x_m: np.ndarray
    relative_y_m: np.ndarray
    speed_mps: np.ndarray  # absolute speed
    heading_rad: np.ndarray  # against the road's direction
    length_m: np.ndarray
    place: LoggedPlace | None  # where the log has them, instead of distances from the subject vehicle
    extra_columns: tuple[str, ...]  # columns that nobody reads
    lanes_from_left: bool = False  # lane 1 is the leftmost

    def without(self, rows: np.ndarray) -> "ObjectLog":
        """The table less some of its rows; vehicles keep their numbers."""
        columns = ("time_s", "vehicle", "lane", "relative_x_m", "relative_y_m", "speed_mps", "heading_rad", "length_m")
        place = self.place and replace(self.place, first=self.place.first[~rows], second=self.place.second[~rows])
        return replace(self, place=place, **{name: getattr(self, name)[~rows] for name in columns})


def read_subject_log(
    file: Path,
    earliest_s: float = -np.inf,
    latest_s: float = np.inf,
    limit: SizeLimit | None = None,
    form: LogForm = TABLE_1,
) -> SubjectLog:
    """Read the subject vehicle's table.

    Rows must be in time order: in a table with one row per time stamp, a time that runs backwards is a fault of the
    clock or of the file, and sorting would hide it. (The objects' table may come in any order.)

    Args:
        file: the table.
        earliest_s: earliest time on the scenario's clock.
        latest_s: latest.
        limit: what the file may grow to.
        form: how the table is written.

    Raises:
        EmptyLogError: the table has no two rows.
        CaseError: see `read_columns`; times that do not increase or lie outside the scenario's clock; a sampling rate
            outside of 1 to 25 Hz; a value that the quantity cannot have.
    """
    kind, columns = place_columns(file, our_names(file, form.subject))
    table = read_log_columns(file, {**SUBJECT_COLUMNS, **columns}, form.subject, form.absent, limit)
    if table.num_rows < 2:
        raise EmptyLogError(file, "", f"expected at least two rows of data, got {table.num_rows}.")
    time_s = table.numbers["time_s"]
    _check_time(table, earliest_s, latest_s)
    step_s = np.diff(time_s)
    if np.any(step_s <= 0.0):
        index = int(np.argmax(step_s <= 0.0)) + 1
        found = "the same time again" if time_s[index] == time_s[index - 1] else "less"
        place = table.place(index, "time_s")
        raise CaseError(file, place, f"expected time_s to increase, got {time_s[index]:.10g}, {found}.")
    rate_hz = 1.0 / float(np.median(step_s))
    tolerance = 1.0 + SAMPLING_TOLERANCE
    if rate_hz < LEAST_SAMPLING_HZ / tolerance or rate_hz > MOST_SAMPLING_HZ * tolerance:
        expected = f"expected {LEAST_SAMPLING_HZ:g} to {MOST_SAMPLING_HZ:g} rows per second, got {rate_hz:.3g}."
        raise CaseError(file, "column time_s", expected)
    _check_range(table, "speed_kmh", 0.0, HIGHEST_SPEED_KMH, "a speed of 0 to 400 km/h")
    _check_range(table, "speed_limit_kmh", 0.0, HIGHEST_SPEED_KMH, "a speed of 0 to 400 km/h")
    if kind == "globe":
        _check_range(table, "longitude_rad", -np.pi, np.pi, "radians, -pi to pi")
        _check_range(table, "latitude_rad", -np.pi / 2, np.pi / 2, "radians, -pi/2 to pi/2")
    index, words = table.texts["road"]
    return SubjectLog(
        file=file,
        time_s=time_s,
        road=np.asarray([*words, ""], object)[index],
        speed_limit_mps=_speeds_mps(table, "speed_limit_kmh"),
        speed_mps=_speeds_mps(table, "speed_kmh"),
        yaw_rate_radps=table.numbers["yaw_rate_radps"],
        place=logged_place(table, kind, form.crs),
        acceleration_mps2=table.numbers["acceleration_mps2"],
        lane=_lanes(table, form),
        lane_offset_m=table.numbers["lane_offset_m"],
        extra_columns=table.extra_columns,
        lanes_from_left=form.lanes_from == "left",
    )


def read_object_log(
    file: Path,
    earliest_s: float = -np.inf,
    latest_s: float = np.inf,
    limit: SizeLimit | None = None,
    form: LogForm = TABLE_1,
) -> ObjectLog:
    """Read the table of detected vehicles; its rows may come in any order, and it may be empty.

    Args:
        file: the table.
        earliest_s: earliest time on the scenario's clock.
        latest_s: latest.
        limit: what the file may grow to.
        form: how the table is written.

    Raises:
        CaseError: see `read_columns`; a time outside the scenario's clock, a missing id, one vehicle twice at one time,
            a value that the quantity cannot have.
    """
    names = our_names(file, form.objects)
    placed = None if "relative_x_m" in names else place_columns_among(names)
    kind, places = placed or (None, RELATIVE_COLUMNS)
    wanted: dict[str, Kind] = {**OBJECT_COLUMNS, **places, **(LENGTH_COLUMN if "length_m" in names else {})}
    table = read_log_columns(file, wanted, form.objects, form.absent, limit)
    nothing = np.full(table.num_rows, np.nan)
    _check_time(table, earliest_s, latest_s)
    _check_absolute_speeds(table)
    _check_range(table, "speed_kmh", 0.0, HIGHEST_SPEED_KMH, "a speed of 0 to 400 km/h")
    vehicle, vehicle_ids = _vehicles(table)
    time_s = table.numbers["time_s"]
    order = np.lexsort((time_s, vehicle))  # stable: equal rows stay in the file's order
    again = (np.diff(time_s[order]) == 0.0) & (np.diff(vehicle[order]) == 0)
    if np.any(again):
        index = int(order[1:][again].min())
        found = f"vehicle {quote(vehicle_ids[vehicle[index]])} again at {time_s[index]:.10g} s"
        raise CaseError(file, row_place(index), f"expected each vehicle once per time stamp, got {found}.")
    return ObjectLog(
        file=file,
        time_s=time_s,
        vehicle=vehicle,
        vehicle_ids=vehicle_ids,
        lane=_lanes(table, form),
        relative_x_m=table.numbers.get("relative_x_m", nothing),
        relative_y_m=table.numbers.get("relative_y_m", nothing),
        speed_mps=_speeds_mps(table, "speed_kmh"),
        heading_rad=np.radians(table.numbers["heading_deg"]),
        length_m=table.numbers.get("length_m", nothing),
        place=None if kind is None else logged_place(table, kind, form.crs),
        extra_columns=table.extra_columns,
        lanes_from_left=form.lanes_from == "left",
    )


def _check_time(table: ColumnTable, earliest_s: float, latest_s: float) -> None:
    time_s = table.numbers["time_s"]
    missing = np.isnan(time_s)
    if np.any(missing):
        raise CaseError(table.file, table.place(int(np.argmax(missing)), "time_s"), "expected a time, got nothing.")
    outside = (time_s < earliest_s) | (time_s > latest_s)
    if np.any(outside):
        index = int(np.argmax(outside))
        expected = f"expected {earliest_s:g} to {latest_s:g} on the scenario's clock, got {time_s[index]:.10g}."
        raise CaseError(table.file, table.place(index, "time_s"), expected)


def _check_absolute_speeds(table: ColumnTable) -> None:
    """Refuse speeds that are below 0 in many rows: they are not the vehicles' own."""
    is_negative = table.numbers["speed_kmh"] < 0.0
    if is_negative.sum() > max(FEW_NEGATIVE, MANY_NEGATIVE * len(is_negative)):
        expected = (
            f"expected absolute speeds, got {is_negative.mean():.0%} of the rows below 0: are they relative to the "
            "subject vehicle's, or of oncoming traffic?"
        )
        raise CaseError(table.file, table.place(int(np.argmax(is_negative)), "speed_kmh"), expected)


def _check_range(table: ColumnTable, column: str, least: float, most: float, expected: str) -> None:
    values = table.numbers[column]
    outside = (values < least) | (values > most)
    if np.any(outside):
        index = int(np.argmax(outside))
        raise CaseError(table.file, table.place(index, column), f"expected {expected}, got {values[index]:.10g}.")


def _speeds_mps(table: ColumnTable, column: str) -> np.ndarray:
    return np.asarray(mps_from_kmh(table.numbers[column]))  # pyright: ignore[reportArgumentType]


def _lanes(table: ColumnTable, form: LogForm) -> np.ndarray:
    """Lanes counted from 1, at whichever side the log begins."""
    logged = table.numbers["lane"]
    lane = logged + (1 - form.first_lane)
    filled = np.where(np.isnan(lane), 1.0, lane)
    wrong = (filled < 1.0) | (filled > MOST_LANES) | (filled != np.round(filled))
    if np.any(wrong):
        index = int(np.argmax(wrong))
        expected = f"expected a whole number from {form.first_lane} ({form.lanes_from}most), got {logged[index]:.10g}."
        raise CaseError(table.file, table.place(index, "lane"), expected)
    return np.where(np.isnan(lane), LANE_UNKNOWN, filled).astype(np.int64)


def _vehicles(table: ColumnTable) -> tuple[np.ndarray, tuple[str, ...]]:
    """Number the vehicles by their sorted ids, so that the numbers do not depend on the order of the rows."""
    index, words = table.texts["vehicle_id"]
    if "" in words:
        first = int(np.argmax(index == words.index("")))
        raise CaseError(table.file, table.place(first, "vehicle_id"), "expected an id, got nothing.")
    ranked = sorted(range(len(words)), key=words.__getitem__)
    rank = np.empty(len(words), np.int64)
    rank[ranked] = np.arange(len(words))
    return rank[index] if len(words) else np.zeros(0, np.int64), tuple(words[i] for i in ranked)
