"""Traffic seen from above: all vehicles of a stretch of road at each instant, in the order of time."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from jaxcalib.importers.data_frame import Frame

SLICE_COLUMNS = ("vehicle", "x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "lane", "length_m")
LEAST_MOVED_M = 1.0  # between the places that a direction of travel is taken from


@dataclass(frozen=True)
class Slice:
    """The vehicles at one instant; nan where something is unknown."""

    time_s: float
    vehicle: np.ndarray  # ids, texts
    x_m: np.ndarray  # of the front bumper's middle
    y_m: np.ndarray
    heading_rad: np.ndarray  # counterclockwise from +x
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray
    lane: np.ndarray  # 1 = rightmost
    length_m: np.ndarray


@dataclass(frozen=True)
class Recording:
    """A recording that may be too long to be held in memory."""

    id: str
    slices: Callable[[], Iterable[Slice]]  # from its begin, each time that it is called; times rise
    crs: str | None = None  # coordinate reference system of x_m and y_m; None for the network's plane
    has_scenario_clock: bool = False  # its times are the scenario's already


def slices_of(table: Frame) -> Iterator[Slice]:
    """The slices of a table with the columns `time_s` and SLICE_COLUMNS, in any order of its rows."""
    table = table.sort_values("time_s", kind="stable")
    time_s = table["time_s"].to_numpy(float)
    columns = {name: table[name].to_numpy() for name in SLICE_COLUMNS}
    bounds = np.append(np.flatnonzero(np.diff(time_s, prepend=np.nan) != 0.0), len(time_s))
    for first, last in itertools.pairwise(bounds):
        yield Slice(float(time_s[first]), **{name: values[first:last] for name, values in columns.items()})


def completed(table: Frame) -> Frame:
    """A table of trajectories with all columns: what it lacks follows from places, or is unknown.

    Args:
        table: columns time_s, vehicle, x_m and y_m at least.
    """
    table = table.dropna(subset=["vehicle", "time_s"]).sort_values(["vehicle", "time_s"], kind="stable")
    table = table.drop_duplicates(["vehicle", "time_s"]).reset_index(drop=True)
    for name in ("acceleration_mps2", "lane", "length_m"):
        if name not in table:
            table[name] = np.nan
    tracks = list(table.groupby("vehicle", sort=False).indices.values())
    if "speed_mps" not in table:
        table["speed_mps"] = _by_track(table, tracks, _speed_mps)
    if "heading_rad" not in table:
        table["heading_rad"] = _by_track(table, tracks, _heading_rad)
    table["vehicle"] = table["vehicle"].astype(str)
    return table


def _by_track(table: Frame, tracks: list[np.ndarray], derive: Callable[..., np.ndarray]) -> np.ndarray:
    values = np.full(len(table), np.nan)
    time_s, x_m, y_m = (table[name].to_numpy(float) for name in ("time_s", "x_m", "y_m"))
    for rows in tracks:
        values[rows] = derive(time_s[rows], x_m[rows], y_m[rows])
    return values


def _speed_mps(time_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    if len(time_s) < 2:
        return np.full(len(time_s), np.nan)
    return np.hypot(np.gradient(x_m, time_s), np.gradient(y_m, time_s))


def _heading_rad(time_s: np.ndarray, x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    return path_heading_rad(x_m, y_m)


def path_heading_rad(x_m: np.ndarray, y_m: np.ndarray) -> np.ndarray:
    """Direction of travel along places, from those at least a metre apart; nan where nothing moves."""
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m)))])
    kept = np.flatnonzero(np.diff(np.floor(driven_m / LEAST_MOVED_M), prepend=-1.0) > 0.0)
    if len(kept) < 2:
        return np.full(len(x_m), np.nan)
    heading = np.unwrap(np.arctan2(np.gradient(y_m[kept]), np.gradient(x_m[kept])))
    return np.interp(driven_m, driven_m[kept], heading)
