"""The objects that the vehicle saw: each with an id and a velocity, from front bumper to front bumper."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from jaxcalib.errors import CaseError, quote
from jaxcalib.importers.data_frame import Frame
from jaxcalib.importers.planes import from_vehicle_frame
from jaxcalib.importers.ros.bag import Topic
from jaxcalib.importers.ros.mapping import RosbagSection
from jaxcalib.importers.ros.messages import VELOCITY
from jaxcalib.importers.ros.own_motion import column_at, odometry_places, velocity_mps

STANDING_MPS, DRIVING_MPS = 1.5, 8.0  # what nobody has recognised and stands while the vehicle drives is the roadside
MOST_JUMP_M = 2.5  # of what has no id, from message to message, as the vehicle sees it
ITSELF_M, ITSELF_ASIDE_M = 2.0, 1.0  # no other vehicle's front can be this close to one's own
FAR_M = 1e6  # stands for infinity, with which nothing can be assigned
FIXED_FRAMES = ("map", "odom", "world")


def seen_objects(
    source: Path, chosen: Mapping[str, Topic], own: Frame, section: RosbagSection, said: list[str]
) -> Frame:
    """The vehicles that were seen, from front bumper to front bumper.

    Raises:
        CaseError: there are none, or nothing says in which frame they are.
    """
    topic = chosen["objects"]
    every = topic.table("objects")
    seen = every[every["time_s"].between(own["time_s"].iloc[0], own["time_s"].iloc[-1])].reset_index(drop=True)
    if not len(seen):
        found = f"{len(every)} at other times than its places" if len(every) else "none in its messages"
        raise CaseError(source, str(topic), f"expected objects, got {found}.")
    if _is_fixed(source, chosen, section, said):
        seen = _in_vehicle_frame(seen, odometry_places(source, chosen["odometry"]))
    seen["own_mps"] = column_at(seen["time_s"].to_numpy(float), own, "speed_mps")
    if section.speed_of == "relative":
        seen["velocity_x_mps"] += seen["own_mps"]
    seen = _with_velocity(_with_ids(seen, said), own, said)
    seen = _at_front(seen, section.front_overhang_m)
    left_out, objects = _sorted_out(seen)
    left_out = {"at times without a place": len(every) - len(seen)} | left_out
    if not len(objects):
        raise CaseError(source, str(topic), f"expected vehicles among {len(every)} rows of objects; there are none.")
    why = ", ".join(f"{number} {words}" for words, number in left_out.items() if number)
    of_whom = "over ground" if section.speed_of == "objects" else "relative to the vehicle's"
    said.append(
        f"{topic}: {len(objects)} of {len(every)} rows, {objects['vehicle_id'].nunique()} vehicles, their speeds "
        f"{of_whom}; left out: {why or 'nothing'}."
    )
    return objects


def _is_fixed(source: Path, chosen: Mapping[str, Topic], section: RosbagSection, said: list[str]) -> bool:
    """Whether objects are in the odometry's plane, and not in the vehicle's own frame."""
    topic, odometry = chosen["objects"], chosen.get("odometry")
    frame = min(topic.frames)
    if section.frame is None and len(topic.frames) > 1:
        found = " and ".join(map(quote, sorted(topic.frames)))
        raise CaseError(source, str(topic), f"expected one frame, got {found}; say frame in --mapping.")
    is_same = odometry is not None and odometry.frames == {frame}
    is_fixed = section.frame == "map" if section.frame else is_same or frame in FIXED_FRAMES
    if is_fixed and (odometry is None or not (is_same or section.frame)):
        where = "no odometry" if odometry is None else f"odometry in {quote(min(odometry.frames))}"
        expected = f"expected odometry in the frame of objects, {quote(frame)}, got {where}; see frame in --mapping."
        raise CaseError(source, str(topic), expected)
    said.append(f"objects are in frame {quote(frame)}, taken as the {'odometry' if is_fixed else 'vehicle'}'s.")
    return is_fixed


def _in_vehicle_frame(seen: Frame, places: Frame) -> Frame:
    """Objects of the odometry's plane as the vehicle sees them: the inverse of `from_vehicle_frame`."""
    time_s = seen["time_s"].to_numpy(float)
    heading_rad = column_at(time_s, places, "heading_rad")
    x_m, y_m = (seen[name].to_numpy(float) - column_at(time_s, places, name) for name in ("x_m", "y_m"))
    x_m, y_m = _turned(heading_rad, x_m, y_m)
    velocity_x, velocity_y = (seen[name].to_numpy(float) for name in VELOCITY)
    velocity_x, velocity_y = _turned(heading_rad, velocity_x, velocity_y)
    yaw_rad = seen["yaw_rad"] - heading_rad
    return seen.assign(x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, velocity_x_mps=velocity_x, velocity_y_mps=velocity_y)


def _with_ids(seen: Frame, said: list[str]) -> Frame:
    """Objects each with an id; where there is none, that of the nearest in the message before."""
    ids = seen["vehicle_id"].to_numpy(object, copy=True)
    nameless = np.flatnonzero(ids == "")
    if not len(nameless):
        return seen
    places_m, last, count = seen[["x_m", "y_m"]].to_numpy(float), np.zeros(0, int), 0
    for rows in np.split(nameless, np.flatnonzero(np.diff(seen["time_s"].to_numpy()[nameless])) + 1):
        apart_m = np.nan_to_num(np.linalg.norm(places_m[rows][:, None] - places_m[last], axis=-1), nan=np.inf)
        apart_m = np.minimum(apart_m, FAR_M)
        for row, before in zip(*linear_sum_assignment(apart_m), strict=True):
            if apart_m[row, before] <= MOST_JUMP_M:
                ids[rows[row]] = ids[last[before]]
        for row in rows[ids[rows] == ""]:
            count += 1
            ids[row] = f"n{count}"
        last = rows
    said.append(f"{len(nameless)} rows of objects have no id: {count} ids are made, by the nearest from row to row.")
    return seen.assign(vehicle_id=ids)


def _with_velocity(seen: Frame, own: Frame, said: list[str]) -> Frame:
    """Objects each with a velocity; where there is none, that of their places over ground."""
    unknown = seen["velocity_x_mps"].isna().to_numpy()
    if not unknown.any():
        return seen
    said.append(f"{int(unknown.sum())} rows of objects have no velocity; it is taken from their places.")
    time_s, x_m, y_m = (seen[name].to_numpy(float) for name in ("time_s", "x_m", "y_m"))
    own_s, own_x_m, own_y_m, own_rad = (own[name].to_numpy(float) for name in ("time_s", "x_m", "y_m", "heading_rad"))
    places_m = np.stack(from_vehicle_frame((own_s, own_x_m, own_y_m, own_rad), time_s, x_m, y_m), axis=-1)
    velocity = np.full((len(seen), 2), np.nan)
    for rows in seen.groupby("vehicle_id").indices.values():
        velocity[rows] = velocity_mps(time_s[rows], places_m[rows])
    by_places = _turned(column_at(time_s, own, "heading_rad"), velocity[:, 0], velocity[:, 1])
    return seen.assign(**{name: seen[name].where(~unknown, new) for name, new in zip(VELOCITY, by_places, strict=True)})


def _at_front(seen: Frame, overhang_m: float) -> Frame:
    """Objects with their speeds, and their fronts instead of their middles, ahead and left of the vehicle's."""
    velocity_x, velocity_y, yaw_rad = (seen[name].to_numpy(float) for name in (*VELOCITY, "yaw_rad"))
    speed_mps = np.hypot(velocity_x, velocity_y)
    course_rad = np.where(speed_mps > STANDING_MPS, np.arctan2(velocity_y, velocity_x), np.nan)
    # Of many a box the axis is known but not which end is its front: it drives forwards.
    yaw_rad = yaw_rad + np.where(np.cos(course_rad - yaw_rad) < 0.0, np.pi, 0.0)
    yaw_rad = np.nan_to_num(np.where(np.isnan(yaw_rad), course_rad, yaw_rad))
    length_m = seen["length_m"].where(seen["length_m"] > 0.0)
    half_m = length_m.fillna(0.0) / 2.0
    return seen.assign(
        ahead_m=seen["x_m"] + half_m * np.cos(yaw_rad) - overhang_m,
        left_m=seen["y_m"] + half_m * np.sin(yaw_rad),
        speed_mps=speed_mps,
        length_m=length_m,
    )


def _sorted_out(seen: Frame) -> tuple[dict[str, int], Frame]:
    """How many rows are left out and why, and the others."""
    is_standing = (seen["speed_mps"] < STANDING_MPS) & (seen["own_mps"] > DRIVING_MPS)
    reasons = {
        "of pedestrians, bicycles and signs": seen["kind"] == "other",
        "of the vehicle itself": (seen["ahead_m"].abs() < ITSELF_M) & (seen["left_m"].abs() < ITSELF_ASIDE_M),
        "of oncoming traffic": seen["velocity_x_mps"] <= -STANDING_MPS,
        "of the roadside": (seen["kind"] == "unknown") & is_standing,
        "without place or speed": seen[["ahead_m", "left_m", "speed_mps"]].isna().any(axis=1),
        "twice at one time": seen.duplicated(["time_s", "vehicle_id"]),
    }
    is_out = np.zeros(len(seen), bool)
    counts = {}
    for words, mask in reasons.items():
        counts[words] = int((mask & ~is_out).sum())
        is_out |= mask.to_numpy(bool)
    return counts, seen[~is_out]


def _turned(angle_rad: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is along x and y, along axes that are turned to the left."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return cos * x + sin * y, cos * y - sin * x
