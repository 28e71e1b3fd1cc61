"""Bags of ROS that hold a drive of which everything is known."""

import sqlite3
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from jaxcalib.importers.importer import Imported, ImportedDrive, ImportOptions
from jaxcalib.importers.ros.definitions import DEFINITIONS
from jaxcalib.importers.rosbag import read_recording

BEGIN_S, LASTS_S, STEP_S = 1_700_000_000, 4.0, 0.1
TIMES_S = np.round(np.arange(0.0, LASTS_S, STEP_S), 3)
HEADING_RAD, SPEED_MPS, OVERHANG_M = 2.2, 20.0, 3.8
BEGIN_M = np.array([1200.0, -300.0])  # where base_link is at first
FORWARD = np.array([np.cos(HEADING_RAD), np.sin(HEADING_RAD)])
LEFT = np.array([-FORWARD[1], FORWARD[0]])
# Each object: distances from front bumper to front bumper at first, ahead and left; speed and length.
OBJECTS = ((30.0, 3.6, 24.0, 4.4), (-25.0, 0.0, 18.0, 12.0))
UUIDS = (bytes(range(16)), bytes(range(100, 116)))
HEX = tuple(uuid.hex() for uuid in UUIDS)

# Of vision_msgs as much as is read; ROS 1 has no ids that are unique everywhere.
OTHER_DEFINITIONS = {
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nBoundingBox3D bbox\nstring id",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    "unique_identifier_msgs/msg/UUID": "uint8[16] uuid",
}
Topic = tuple[str, list[tuple[float, dict[str, Any]]]]  # type, times and messages
Bag = dict[str, Topic]


def make(store: Typestore, name: str, values: Any = None) -> Any:
    """A message with some of its values, the others 0."""
    fields = {}
    for field, (node, detail) in store.fielddefs[name][1]:
        given = None if values is None else values.get(field)
        if node == Nodetype.NAME:
            fields[field] = make(store, detail, given)
        elif node == Nodetype.BASE:
            fields[field] = given if given is not None else "" if detail[0] == "string" else 0
        elif detail[0][0] == Nodetype.NAME:
            fields[field] = [make(store, detail[0][1], one) for one in given or ()]
        else:
            size = detail[1] if node == Nodetype.ARRAY else 0
            fields[field] = np.asarray(np.zeros(size) if given is None else given, dtype=detail[0][1][0])
    return store.types[name](**fields)


@cache
def typestore(release: Stores, changed: tuple[tuple[str, str], ...] = ()) -> Typestore:
    """The types of a release of ROS and those that are imported, some of them with other definitions."""
    store = get_typestore(release)
    types = {}
    for name, fields in (DEFINITIONS | OTHER_DEFINITIONS | dict(changed)).items():
        types |= get_types_from_msg(fields, name) if name not in store.types else {}
    store.register(types)
    return store


def write(path: Path, bag: Bag, store: Typestore | None = None) -> Path:
    """Write a bag: *.bag for ROS 1, *.mcap without metadata, another name for the folder of a ROS 2 bag."""
    store = store or typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
    if path.suffix == ".bag":
        writer, serialize = rosbag1.Writer(path), store.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin.MCAP if "mcap" in path.name else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path.with_suffix(""), version=8, storage_plugin=plugin)
        serialize = store.serialize_cdr
    with writer:
        for topic, (name, messages) in bag.items():
            name = name.replace("/", "/msg/")
            connection = writer.add_connection(topic, name, typestore=store)
            for time_s, values in messages:
                received_ns = round((BEGIN_S + time_s + 0.02) * 1e9)
                writer.write(connection, received_ns, serialize(make(store, name, values), name))
    if path.suffix == ".mcap":
        (path.with_suffix("") / f"{path.stem}.mcap").rename(path)
    return path


def without_definitions(folder: Path) -> Path:
    """Make a database of what a release before Iron would have written."""
    with closing(sqlite3.connect(folder / f"{folder.name}.db3")) as database, database:
        database.execute("UPDATE schema SET schema_version = 3")
        database.execute("DROP TABLE message_definitions")
    return folder


def header(time_s: float, frame: str) -> dict[str, Any]:
    nanoseconds = round(time_s * 1e9)
    stamp = {"sec": BEGIN_S + nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
    return {"stamp": stamp, "frame_id": frame}


def pose(place: np.ndarray, yaw_rad: float) -> dict[str, Any]:
    turn = {"z": np.sin(yaw_rad / 2), "w": np.cos(yaw_rad / 2)}
    return {"position": {"x": place[0], "y": place[1]}, "orientation": turn}


def linear(x: float, y: float = 0.0) -> dict[str, Any]:
    return {"linear": {"x": x, "y": y}}


def base(time_s: float) -> np.ndarray:
    return BEGIN_M + FORWARD * SPEED_MPS * time_s


def odometry(every_s: float = STEP_S, frame: str = "map") -> Topic:
    messages = []
    for time_s in np.arange(0.0, LASTS_S, every_s):
        motion = {"twist": linear(SPEED_MPS) | {"angular": {"z": 1e-4}}}
        values = {"header": header(time_s, frame), "pose": {"pose": pose(base(time_s), HEADING_RAD)}, "twist": motion}
        messages.append((time_s, values))
    return "nav_msgs/Odometry", messages


def objects(kind: str, frame: str, is_relative: bool = False) -> Topic:
    """Messages of objects, which are the middles of boxes seen from base_link or in the map."""
    return {
        "tracked": "autoware_perception_msgs/TrackedObjects",
        "predicted": "autoware_perception_msgs/PredictedObjects",
        "detected": "autoware_perception_msgs/DetectedObjects",
        "derived": "derived_object_msgs/ObjectArray",
        "boxes": "vision_msgs/Detection3DArray",
    }[kind], [(time_s, _objects_at(time_s, kind, frame, is_relative)) for time_s in TIMES_S]


def _objects_at(time_s: float, kind: str, frame: str, is_relative: bool) -> dict[str, Any]:
    every = []
    for number, (ahead_m, left_m, speed_mps, length_m) in enumerate(OBJECTS):
        place = np.array([ahead_m + (speed_mps - SPEED_MPS) * time_s + OVERHANG_M - length_m / 2, left_m])
        yaw_rad, velocity = 0.0, np.array([speed_mps - is_relative * SPEED_MPS, 0.0])
        if frame == "map":
            place, yaw_rad = base(time_s) + place[0] * FORWARD + place[1] * LEFT, HEADING_RAD
            velocity = velocity[0] * FORWARD
        one: dict[str, Any] = {"shape": {"type": 1, "dimensions": [length_m, 1.8, 1.5]}, "id": 7 + number}
        one |= {"pose": pose(place, yaw_rad), "twist": linear(*velocity), "object_classified": 1, "classification": 6}
        if kind == "boxes":
            one = {"bbox": {"center": one["pose"], "size": {"x": length_m}}, "id": f"box{number}"}
        elif kind != "derived":
            first = "initial_" if kind == "predicted" else ""
            motion: dict[str, Any] = {f"{first}pose_with_covariance": {"pose": one["pose"]}}
            if kind != "detected":
                motion[f"{first}twist_with_covariance"] = {"twist": linear(speed_mps - is_relative * SPEED_MPS)}
            one = {"kinematics": motion, "shape": {"dimensions": {"x": length_m, "y": 1.8}}}
            one |= {"object_id": {"uuid": list(UUIDS[number])}, "classification": [{"label": 1, "probability": 0.9}]}
        every.append(one)
    return {"header": header(time_s, frame), "detections" if kind == "boxes" else "objects": every}


def a_bag(path: Path, kind: str = "tracked", frame: str = "map", is_relative: bool = False, **more: Topic) -> Path:
    return write(path, topics(kind, frame, is_relative, **more))


def topics(kind: str = "tracked", frame: str = "map", is_relative: bool = False, **more: Topic) -> Bag:
    every = {"odometry": odometry(), "objects": objects(kind, frame, is_relative)} | more
    return {f"/{name}": topic for name, topic in every.items() if topic[1]}


def read(source: Path, mapping: str = "") -> Imported:
    file = source.parent / "mapping.toml"
    file.write_text(f"[rosbag]\n{mapping}")
    return read_recording(source, ImportOptions(mapping=file if mapping else None))


def check_drive(drive: ImportedDrive, ids: tuple[str, ...]):
    """Compare a drive with what was written, by the definition of front bumpers."""
    front_m = np.stack([base(time_s) + OVERHANG_M * FORWARD for time_s in TIMES_S])
    np.testing.assert_allclose(drive.subject.time_s - 600.0, TIMES_S, atol=1e-6)
    np.testing.assert_allclose(drive.subject[["x_m", "y_m"]], front_m, atol=1e-3)
    np.testing.assert_allclose(drive.subject.speed_kmh, 3.6 * SPEED_MPS, rtol=1e-5)
    assert sorted(set(drive.objects.vehicle_id)) == sorted(ids)
    for name, (first_m, left_m, speed_mps, length_m) in zip(ids, OBJECTS, strict=True):
        one = drive.objects[drive.objects.vehicle_id == name]
        ahead_m = first_m + (speed_mps - SPEED_MPS) * TIMES_S[:, None]
        np.testing.assert_allclose(one.time_s - 600.0, TIMES_S, atol=1e-6)
        np.testing.assert_allclose(one[["x_m", "y_m"]], front_m + ahead_m * FORWARD + left_m * LEFT, atol=1e-3)
        np.testing.assert_allclose(one.speed_kmh, 3.6 * speed_mps, rtol=1e-5)
        np.testing.assert_allclose(one.length_m, length_m, rtol=1e-6)
