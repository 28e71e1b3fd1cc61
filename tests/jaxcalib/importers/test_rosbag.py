"""Bags of every kind that hold the same drive become the same logs, and what is wrong with one is said in a line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

pytest.importorskip("rosbags", reason="the extra 'rosbag' is not installed")

from jaxcalib.check.scenario_check import check_case
from jaxcalib.errors import CaseError
from jaxcalib.importers.import_case import import_case
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.planes import plane_of
from tests.jaxcalib.importers.ros_bags import (
    HEX,
    OBJECTS,
    OVERHANG_M,
    SPEED_MPS,
    TIMES_S,
    a_bag,
    base,
    check_drive,
    header,
    linear,
    objects,
    odometry,
    pose,
    read,
    write,
)

CASES = {
    "a database, tracked, map": ("drive", "tracked", "map", "", HEX),
    "MCAP in a folder, predicted, map": ("drive_mcap", "predicted", "map", "", HEX),
    "MCAP, tracked, vehicle": ("drive.mcap", "tracked", "base_link", "", HEX),
    "MCAP, detected without ids and velocities": ("drive.mcap", "detected", "map", "", ("n1", "n2")),
    "MCAP, boxes": ("drive.mcap", "boxes", "base_link", 'objects = "/objects"', ("box0", "box1")),
    "ROS 1, map": ("drive.bag", "derived", "map", "", ("7", "8")),
    "ROS 1, vehicle, relative speeds": ("drive.bag", "derived", "radar", 'speed_of = "relative"', ("7", "8")),
}


@pytest.mark.parametrize("case", CASES)
def test_the_same_drive_from_every_bag(case: str, tmp_path: Path):
    name, kind, frame, mapping, ids = CASES[case]
    imported = read(a_bag(tmp_path / name, kind, frame, "relative" in mapping), mapping)
    (drive,) = imported.drives
    check_drive(drive, ids)
    assert drive.id == name.split(".")[0]
    np.testing.assert_allclose(drive.subject.yaw_rate_radps, 1e-4)
    number = len(OBJECTS) * len(TIMES_S)
    assert any(f"{number} of {number} rows, 2 vehicles" in line for line in imported.said)
    assert any("3.8 m ahead of its reference point" in line for line in imported.said)


@pytest.mark.parametrize("has_speed", [True, False])
def test_places_on_the_globe(has_speed: bool, tmp_path: Path):
    zone = "EPSG:32632"
    to_globe = pyproj.Transformer.from_crs(zone, "EPSG:4326", always_xy=True)
    far_m = np.array([500_000.0, 5_300_000.0])
    fixes, speeds = [], []
    degrees = to_globe.transform(*np.stack([base(time_s) + far_m for time_s in TIMES_S], axis=-1))
    for time_s, longitude, latitude in zip(TIMES_S, *degrees, strict=True):
        fixes.append((time_s, {"header": header(time_s, "gnss"), "longitude": longitude, "latitude": latitude}))
        speeds.append((time_s, {"header": header(time_s, "base_link"), "longitudinal_velocity": SPEED_MPS}))
    topics = {"fix": ("sensor_msgs/NavSatFix", fixes), "odometry": ("nav_msgs/Odometry", [])}
    if has_speed:
        topics["speed"] = ("autoware_vehicle_msgs/VelocityReport", speeds)
    (drive,) = read(a_bag(tmp_path / "drive.mcap", frame="base_link", **topics)).drives
    tables = {}
    for name in ("subject", "objects"):
        table = getattr(drive, name)
        x_m, y_m, crs = plane_of(np.degrees(table.longitude_rad), np.degrees(table.latitude_rad))
        assert crs == zone
        tables[name] = table.assign(x_m=x_m - far_m[0], y_m=y_m - far_m[1])
    check_drive(replace(drive, **tables), HEX)
    with pytest.raises(CaseError, match=r'in the frame of objects, "map", got no odometry'):
        read(a_bag(tmp_path / "other.mcap", frame="map", **topics))


def test_what_is_no_vehicle_ahead_or_behind_is_left_out(tmp_path: Path):
    kind, messages = objects("derived", "base_link")
    one = messages[0][1]["objects"][0]
    others = {
        "1 of pedestrians": one | {"id": 20, "classification": 4},
        "1 of the vehicle itself": one | {"id": 21, "pose": pose(np.array([OVERHANG_M - 2.2, 0.1]), 0.0)},
        "1 of oncoming traffic": one | {"id": 22, "twist": linear(-15.0)},
        "1 of the roadside": one | {"id": 23, "twist": linear(0.0), "object_classified": 0},
        "1 twice at one time": one,
    }
    messages[0][1]["objects"] += others.values()
    imported = read(a_bag(tmp_path / "drive.bag", objects=(kind, messages)))
    check_drive(imported.drives[0], ("7", "8"))
    (line,) = (line for line in imported.said if "left out: " in line)
    assert all(words in line for words in others)


def test_many_places_and_messages_without_a_stamp(tmp_path: Path):
    imported = read(a_bag(tmp_path / "drive.mcap", odometry=odometry(0.02)))
    assert np.diff(imported.drives[0].subject.time_s) == pytest.approx(0.06, abs=1e-5)
    kind, messages = odometry()
    without = [(time_s, values | {"header": {"frame_id": "map"}}) for time_s, values in messages]
    imported = read(a_bag(tmp_path / "other.mcap", odometry=(kind, without)))
    assert "/odometry: 40 messages have no time stamp; when they were received is taken." in imported.said
    assert len(imported.drives[0].subject) == len(TIMES_S)


def test_speeds_and_accelerations_of_other_topics(tmp_path: Path):
    heads = [(time_s, {"header": header(time_s, "base_link")}) for time_s in TIMES_S]
    topics = {
        "twist": ("geometry_msgs/TwistStamped", [(time_s, head | {"twist": linear(21.0)}) for time_s, head in heads]),
        "imu": ("sensor_msgs/Imu", [(time_s, head | {"linear_acceleration": {"x": 0.5}}) for time_s, head in heads]),
        "accel": (
            "geometry_msgs/AccelWithCovarianceStamped",
            [(time_s, head | {"accel": {"accel": linear(0.25)}}) for time_s, head in heads],
        ),
    }
    source = a_bag(tmp_path / "drive.mcap", **topics)
    for mapping, speed_mps, acceleration_mps2 in (
        ("", SPEED_MPS, 0.25),
        ('speed = "/twist"', 21.0, 0.25),
        ('acceleration = "/imu"', SPEED_MPS, 0.5),
    ):
        subject = read(source, mapping).drives[0].subject
        np.testing.assert_allclose(subject.speed_kmh, 3.6 * speed_mps, rtol=1e-6)
        np.testing.assert_allclose(subject.acceleration_mps2, acceleration_mps2, rtol=1e-6)


def test_frames_that_the_mapping_has_to_name(tmp_path: Path):
    source = a_bag(tmp_path / "drive.mcap", odometry=odometry(frame="odom"))
    with pytest.raises(CaseError, match='expected odometry in the frame of objects, "map", got odometry in "odom"'):
        read(source)
    check_drive(read(source, 'frame = "map"').drives[0], HEX)


WRONG = {
    'objects = "/radar"': r'rosbag.objects "/radar": expected a topic; the bag has /objects \(autoware_perception',
    'odometry = "/objects"': 'rosbag.odometry "/objects": expected a topic of Odometry, got autoware_perception_msgs/T',
    'objects = "/odometry"': ".*expected a topic of TrackedObjects or .* or Detection3DArray, got nav_msgs/Odometry",
    'topic = "/objects"': "rosbag.topic: expected no such key; the keys are odometry, fix",
    'frame = "sky"': 'rosbag.frame: expected "map" or "vehicle", got "sky"',
    "front_overhang_m = inf": "rosbag.front_overhang_m: expected a number of 0 to 20, got inf",
    "fix = 1": "rosbag.fix: expected text of 1 to 200 characters, got 1",
    "fix": "expected TOML that can be read",
    "[log]": "expected section .rosbag. and nothing else",
}


def test_what_is_wrong_with_a_mapping_is_named(tmp_path: Path):
    source = a_bag(tmp_path / "drive.mcap")
    for mapping, message in WRONG.items():
        with pytest.raises(CaseError, match=r"mapping\.toml: " + message) as error:
            read(source, mapping)
        assert "\n" not in str(error.value)


def test_a_bag_that_lacks_something_says_what_it_has(tmp_path: Path):
    with pytest.raises(CaseError, match=r"a\.bag: expected a topic of objects .*has /odometry \(nav_msgs/Odometry\)"):
        read(write(tmp_path / "a.bag", {"/odometry": odometry()}))
    with pytest.raises(CaseError, match=r"b\.mcap: expected a topic of nav_msgs/Odometry or .*/objects \(derived_obj"):
        read(write(tmp_path / "b.mcap", {"/objects": objects("derived", "base_link")}))
    with pytest.raises(CaseError, match=r"c\.mcap: expected a topic of objects .*/objects \(vision_msgs/Detection3DA"):
        read(a_bag(tmp_path / "c.mcap", "boxes"))
    for name in ("d.bag", "d.mcap", "d_database"):
        with pytest.raises(CaseError, match="expected messages; the bag is empty"):
            read(write(tmp_path / name, {}))
    (tmp_path / "d_database" / "metadata.yaml").unlink()
    with pytest.raises(CaseError, match=r"d_database: expected a ROS 2 bag; no metadata\.yaml is here"):
        read(tmp_path / "d_database")
    nothing = [(0.0, {"header": header(0.0, "map")})]
    with pytest.raises(CaseError, match="expected objects, got none in its messages"):
        read(a_bag(tmp_path / "e.mcap", objects=("autoware_perception_msgs/TrackedObjects", nothing)))
    kind, messages = odometry()
    late = [(time_s, values | {"header": header(time_s + 100.0, "map")}) for time_s, values in messages]
    with pytest.raises(CaseError, match="got 80 at other times than its places"):
        read(a_bag(tmp_path / "f.mcap", odometry=(kind, late)))


@pytest.mark.parametrize("name", ["drive.bag", "drive.mcap", "drive", "drive_mcap"])
def test_a_bag_that_was_cut_off(name: str, tmp_path: Path):
    source = a_bag(tmp_path / name, "derived")
    file = next(source.glob("drive*.*")) if source.is_dir() else source
    content = file.read_bytes()
    for share in (0.0, 0.001, 0.3, 0.7, 0.999):
        file.write_bytes(content[: int(share * len(content))])
        with pytest.raises(CaseError, match=r"expected a whole bag: .* may mend it") as error:
            read(source)
        assert "\n" not in str(error.value)


def test_a_bag_becomes_a_case(tmp_path: Path):
    source = a_bag(tmp_path / "drive.mcap")
    said = import_case("rosbag", source, tmp_path / "case", ImportOptions())
    assert any("no scenario: give --scenario" in line for line in said)
    assert check_case(tmp_path / "case").refusals == ()
