"""The vehicle's own motion: places of its reference point, each with heading, speed, yaw rate and acceleration."""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxcalib.errors import CaseError
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.planes import plane_of
from jaxcalib.importers.recorded_drive import SMOOTHED_S
from jaxcalib.importers.ros.bag import Topic
from jaxcalib.importers.ros.mapping import RosbagSection
from jaxcalib.importers.ros.messages import COLUMNS
from jaxcalib.importers.trajectories import path_heading_rad

MOST_HZ = 20.0  # logs hold at most 25 rows a second, and traffic needs fewer
HALF_S = 0.5  # places this long before and after show a speed


def own_motion(
    source: Path, chosen: Mapping[str, Topic], section: RosbagSection, options: ImportOptions, said: list[str]
) -> tuple[Frame, str | None]:
    """The vehicle's reference point, heading and motion, and the name of the plane.

    Raises:
        CaseError: there are not two places.
    """
    by_fix = "odometry" not in chosen or section.fix is not None
    topic, crs = chosen["fix" if by_fix else "odometry"], options.crs
    if by_fix:
        places = _places(source, topic, "fix")
        x_m, y_m, crs = plane_of(places["longitude_deg"].to_numpy(float), places["latitude_deg"].to_numpy(float))
        places = places[["time_s"]].assign(x_m=x_m, y_m=y_m, heading_rad=np.nan)
        where = f"on the globe; the antenna is taken for the point {section.front_overhang_m:g} m behind the front"
    else:
        places = _places(source, topic, "odometry")
        where = f"in the plane {options.crs or 'of the scenario network'}"
    own = _headed(places)
    said.append(f"{topic}: {len(places)} places, {len(own)} of them taken, {where}.")
    if "fix" in chosen and not by_fix:
        said.append(f"{chosen['fix']} is left out; name it as fix in --mapping for places on the globe.")
    return _with_motion(own, chosen, section, said), crs


def odometry_places(source: Path, odometry: Topic) -> Frame:
    """Places of odometry, each with a heading.

    Raises:
        CaseError: there are not two places.
    """
    return _headed(_places(source, odometry, "odometry"))


def _places(source: Path, topic: Topic, kind: str) -> Frame:
    places = topic.table(kind).drop_duplicates("time_s", ignore_index=True)
    if len(places) < 2:
        raise CaseError(source, str(topic), f"expected places at two times at least, got {len(places)}.")
    return places


def _headed(places: Frame) -> Frame:
    """Places at most so often as logs may have them, each with a heading."""
    step_s = float(np.median(np.diff(places["time_s"])))
    every = max(1, math.ceil(1.0 / MOST_HZ / step_s - 0.01))
    places = places.iloc[::every].reset_index(drop=True)
    if places["heading_rad"].isna().any():
        num_rows = max(1, round(SMOOTHED_S / (step_s * every)))
        smooth = places[["x_m", "y_m"]].rolling(num_rows, 1, center=True).mean().to_numpy()
        places["heading_rad"] = np.nan_to_num(path_heading_rad(smooth[:, 0], smooth[:, 1]))
    return places


def _with_motion(own: Frame, chosen: Mapping[str, Topic], section: RosbagSection, said: list[str]) -> Frame:
    """Speeds, yaw rates and accelerations at the times of places."""
    time_s = own["time_s"].to_numpy(float)
    kinds = ("odometry", "speed") if section.speed is None else ("speed", "odometry")
    tables = {kind: chosen[kind].table(kind) for kind in kinds if kind in chosen}
    # Some leave the twist of their odometry empty.
    moving = [kind for kind, table in tables.items() if table["speed_mps"].abs().max() > 0.0]
    if moving:
        own = own.assign(**{name: column_at(time_s, tables[moving[0]], name) for name in COLUMNS["speed"]})
        if not own["yaw_rate_radps"].any():
            own["yaw_rate_radps"] = np.nan
    else:
        velocity = velocity_mps(time_s, own[["x_m", "y_m"]].to_numpy(float))
        own = own.assign(speed_mps=np.hypot(*velocity.T), yaw_rate_radps=np.nan)
    accelerated = chosen.get("acceleration")
    if accelerated is not None:
        own["acceleration_mps2"] = column_at(time_s, accelerated.table("acceleration"), "acceleration_mps2")
    speeds = chosen[moving[0]] if moving else "places"
    accelerations = f"taken from {accelerated}" if accelerated else "unknown"
    said.append(f"its speeds are taken from {speeds}; its accelerations are {accelerations}.")
    return own


def column_at(time_s: np.ndarray, table: Frame, column: str) -> np.ndarray:
    """A column of a table at other times than the table's."""
    values = table[column].to_numpy(float)
    return np.interp(time_s, table["time_s"].to_numpy(float), np.unwrap(values) if column == "heading_rad" else values)


def velocity_mps(time_s: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Velocity by the places a little before and after; nan of what was seen but once."""
    before_s, after_s = np.maximum(time_s - HALF_S, time_s[0]), np.minimum(time_s + HALF_S, time_s[-1])
    moved_m = [np.interp(after_s, time_s, x_m) - np.interp(before_s, time_s, x_m) for x_m in places_m.T]
    lasted_s = np.where(after_s > before_s, after_s - before_s, np.nan)
    return np.stack(moved_m, axis=-1) / lasted_s[:, None]
