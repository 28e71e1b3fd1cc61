"""Databases without definitions are read by the layouts that the packages have published, and by no other."""

import math
import struct
from pathlib import Path

import pytest

pytest.importorskip("rosbags", reason="the extra 'rosbag' is not installed")

from rosbags.typesys import Stores

from jaxcalib.errors import CaseError
from jaxcalib.importers.ros import definitions
from jaxcalib.importers.ros.definitions import DEFINITIONS
from jaxcalib.importers.ros.messages import TYPES
from tests.jaxcalib.importers.ros_bags import (
    BEGIN_S,
    HEX,
    SPEED_MPS,
    TIMES_S,
    Topic,
    check_drive,
    header,
    objects,
    read,
    topics,
    typestore,
    without_definitions,
    write,
)

IDS = {"tracked": HEX, "predicted": HEX, "detected": ("n1", "n2"), "derived": ("7", "8")}


def of_older_package(topic: Topic) -> Topic:
    return topic[0].replace("autoware_", "autoware_auto_"), topic[1]


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same objects in every type of message."""
    values = {"longitudinal_velocity": SPEED_MPS, "heading_rate": 1e-4}
    messages = [(time_s, values | {"header": header(time_s, "base_link")}) for time_s in TIMES_S]
    speed = "autoware_vehicle_msgs/VelocityReport", messages
    kinds = {kind: objects(kind, "map") for kind in (*IDS, "boxes")}
    older = {"older_speed": of_older_package(speed), "older_tracked": of_older_package(kinds["tracked"])}
    bag = topics(speed=speed, **kinds, **older)
    return without_definitions(write(tmp_path_factory.mktemp("bags") / "drive", bag))


@pytest.mark.parametrize("name", [*IDS, "older_tracked"])
def test_the_same_drive_without_definitions(name: str, database: Path):
    speed = "/older_speed" if "older" in name else "/speed"
    imported = read(database, f'speed = "{speed}"\nobjects = "/{name}"')
    check_drive(imported.drives[0], IDS[name.removeprefix("older_")])
    for topic in (speed, f"/{name}"):
        (line,) = (line for line in imported.said if line.startswith(topic) and "the bag has no definition" in line)
        assert "_auto_" in line if "older" in name else "_auto_" not in line


def test_what_is_not_certain_is_not_supposed(database: Path):
    with pytest.raises(CaseError, match="/boxes: expected the definition of vision_msgs/Detection3DArray, which this"):
        read(database, 'objects = "/boxes"')


def cdr(*fields: tuple) -> bytes:
    """A message byte by byte: values of one code of `struct` each, aligned to their size."""
    data = b""
    for code, *values in fields:
        data += bytes(-len(data) % struct.calcsize(code)) + struct.pack(f"<{len(values)}{code}", *values)
    return b"\0\1\0\0" + data


YAW_RAD, COVARIANCE = 0.5, [0.01] * 36
HEAD = ("i", BEGIN_S), ("I", 5, 4), ("B", *b"map\0"), ("I", 1)  # stamp, frame_id, number of objects
POSE = "d", 10.0, 20.0, 0.0, 0.0, 0.0, math.sin(YAW_RAD / 2), math.cos(YAW_RAD / 2)
POSE_WITH, TWIST_WITH, ACCEL_WITH = (*POSE, *COVARIANCE), ("d", 24.0, *[0.0] * 5, *COVARIANCE), ("d", *[0.5] * 42)
ID, KNOWN = ("B", *range(16)), (("f", 0.9), ("I", 2), ("B", 7), ("f", 0.1), ("B", 1), ("f", 0.8))
SHAPE = ("B", 0), ("I", 1), ("f", 1.0, 1.0, 0.0), ("d", 4.4, 1.8, 1.5)
PATHS = ("I", 1), ("I", 2), POSE, POSE, ("i", 0), ("I", 500_000_000), ("f", 1.0)
AVAILABLE, IS_STATIONARY, YES = ("B", 2), ("B", 0), ("B", 1)

TRACKED = ACCEL_WITH, AVAILABLE, IS_STATIONARY
OLDER_TRACKED = POSE_WITH, AVAILABLE, TWIST_WITH, ACCEL_WITH, IS_STATIONARY
PREDICTED = *HEAD, ID, *KNOWN, POSE_WITH, TWIST_WITH, ACCEL_WITH, *PATHS, *SHAPE
DETECTED = *HEAD, *KNOWN, POSE_WITH, YES, AVAILABLE, TWIST_WITH, YES, YES, *SHAPE
VELOCITY = 24.0 * math.cos(YAW_RAD), 24.0 * math.sin(YAW_RAD)
BYTES = {
    "autoware_perception_msgs/TrackedObjects": (*HEAD, ID, *KNOWN, POSE_WITH, TWIST_WITH, *TRACKED, *SHAPE),
    "autoware_auto_perception_msgs/TrackedObjects": (*HEAD, ID, *KNOWN, *OLDER_TRACKED, *SHAPE),
    "autoware_perception_msgs/PredictedObjects": PREDICTED,
    "autoware_auto_perception_msgs/PredictedObjects": PREDICTED,
    "autoware_perception_msgs/DetectedObjects": DETECTED,
    "autoware_auto_perception_msgs/DetectedObjects": DETECTED,
    "derived_object_msgs/ObjectArray": (
        *HEAD, *HEAD[:3], ("I", 7), ("B", 1, 1), POSE, ("d", *VELOCITY, *[0.0] * 4), ("d", *[0.5] * 6),
        ("I", 1), ("f", 1.0, 1.0, 0.0), ("B", 1), ("I", 3), ("d", 4.4, 1.8, 1.5), ("I", 0), ("B", 6, 255), ("I", 9),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BYTES)
def test_objects_byte_by_byte(name: str):
    message = definitions.typestore().deserialize_cdr(cdr(*BYTES[name]), name.replace("/", "/msg/"))
    ((identity, *numbers, kind),) = TYPES["objects"][name](message)
    assert identity == {"D": "", "O": "7"}.get(name.split("/")[1][0], bytes(range(16)).hex())
    assert numbers == pytest.approx([10.0, 20.0, YAW_RAD, *VELOCITY, 4.4])
    assert kind == "vehicle"


AUTO, PERCEPTION = "autoware_auto_perception_msgs/msg/", "autoware_perception_msgs/msg/"
OTHER_LAYOUTS = {
    # That of Autoware.Auto, the package with the name of the older one.
    AUTO + "TrackedObject": DEFINITIONS[AUTO + "TrackedObject"]
    .replace("UUID object_id", "UUID uuid\nuint64 object_id")
    .replace("Shape shape", "Shape[<=5] shape"),
    # The order of the older package.
    PERCEPTION + "TrackedObjectKinematics": DEFINITIONS[AUTO + "TrackedObjectKinematics"],
    # A field more, a field less.
    PERCEPTION + "PredictedObjects": DEFINITIONS[PERCEPTION + "PredictedObjects"] + "\nbool is_complete",
    PERCEPTION + "DetectedObject": DEFINITIONS[PERCEPTION + "DetectedObject"].partition("\n")[2],
}


@pytest.fixture(scope="module")
def other_database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Objects laid out in other ways; SolidPrimitive, which is in derived objects, has no polygon before Humble."""
    store = typestore(Stores.ROS2_FOXY, tuple(OTHER_LAYOUTS.items()))
    auto, messages = of_older_package(objects("tracked", "map"))
    for _, values in messages:
        for one in values["objects"]:
            one |= {"uuid": one["object_id"], "object_id": 3, "shape": [one["shape"]]}
    bag = topics(auto=(auto, messages), **{kind: objects(kind, "map") for kind in IDS})
    return without_definitions(write(tmp_path_factory.mktemp("bags") / "drive", bag, store))


@pytest.mark.parametrize("name", ["auto", *IDS])
def test_another_layout_is_refused(name: str, other_database: Path):
    message = rf"drive: /{name} \(.*: expected messages laid out as in .*_msgs [14]\..* is installed\.$"
    with pytest.raises(CaseError, match=message) as error:
        read(other_database, f'objects = "/{name}"')
    assert "\n" not in str(error.value)
