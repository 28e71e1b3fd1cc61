"""ASAM OSI traces: three vehicles on a bend, written with the library that others write theirs with."""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyproj
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.importers.importer import Imported, ImportOptions

pytest.importorskip("osi_utilities", reason="the extra 'osi' is not installed")
pytest.importorskip("osi3", reason="the extra 'osi' is not installed")

from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import SensorData
from osi3.osi_sensorview_pb2 import SensorView
from osi_utilities import ChannelSpecification, MultiTraceWriter, SingleTraceWriter, open_channel_writer

from jaxcalib.check.scenario_check import check_case
from jaxcalib.importers.import_case import import_case
from jaxcalib.importers.osi import read_recording

STEP_S, LASTS_S, BEGIN_S = 0.1, 12.0, 300.0
EPOCH_S = 1_700_000_000  # clocks of recorders start in 1970
RADIUS_M, MIDDLE_M = 400.0, (1000.0, 2000.0)
PLANE = "+proj=utm +zone=32 +ellps=WGS84 +units=m +no_defs"
OPTIONS = ImportOptions(begin_s=BEGIN_S, range_m=60.0)


@dataclass(frozen=True)
class Car:
    """A vehicle that drives along the bend, counterclockwise, at an even pace."""

    first_m: float  # its centre, along the bend
    speed_mps: float
    length_m: float

    def yaw_rad(self, time_s: Any) -> Any:
        return (self.first_m + self.speed_mps * time_s) / RADIUS_M + np.pi / 2.0

    def centre_m(self, time_s: Any) -> tuple[Any, Any]:
        angle = self.yaw_rad(time_s) - np.pi / 2.0
        return MIDDLE_M[0] + RADIUS_M * np.cos(angle), MIDDLE_M[1] + RADIUS_M * np.sin(angle)

    def front_m(self, time_s: Any) -> tuple[Any, Any]:
        (x_m, y_m), yaw = self.centre_m(time_s), self.yaw_rad(time_s)
        return x_m + np.cos(yaw) * self.length_m / 2.0, y_m + np.sin(yaw) * self.length_m / 2.0


CARS = {"7": Car(0.0, 20.0, 4.5), "8": Car(30.0, 24.0, 12.0), "11": Car(-70.0, 22.0, 5.0)}
TIMES_S = np.arange(round(LASTS_S / STEP_S) + 1) * STEP_S


def ground_truths(host: str | None = None, **fields: Any) -> list[GroundTruth]:
    """A ground truth for each instant."""
    truths = []
    for number in range(len(TIMES_S)):
        truth = GroundTruth(**fields)
        truth.timestamp.seconds, truth.timestamp.nanos = EPOCH_S + number // 10, number % 10 * 100_000_000
        if host is not None:
            truth.host_vehicle_id.value = int(host)
        for name, car in CARS.items():
            add_vehicle(truth, name, car, float(TIMES_S[number]))
        for name, kind in ((1, MovingObject.TYPE_PEDESTRIAN), (2, MovingObject.TYPE_PEDESTRIAN)):
            truth.moving_object.add(type=kind).id.value = name
        truth.stationary_object.add().id.value = 3
        truths.append(truth)
    return truths


def add_vehicle(truth: GroundTruth, name: str, car: Car, time_s: float) -> None:
    thing = truth.moving_object.add(type=MovingObject.TYPE_VEHICLE)
    thing.id.value = int(name)
    base, yaw = thing.base, float(car.yaw_rad(time_s))
    base.position.x, base.position.y = map(float, car.centre_m(time_s))
    base.orientation.yaw = yaw
    base.dimension.length, base.dimension.width, base.dimension.height = car.length_m, 1.8, 1.5
    base.velocity.x, base.velocity.y = car.speed_mps * np.cos(yaw), car.speed_mps * np.sin(yaw)
    inwards_mps2 = car.speed_mps**2 / RADIUS_M
    base.acceleration.x, base.acceleration.y = -inwards_mps2 * np.sin(yaw), inwards_mps2 * np.cos(yaw)


def sensor_views(truths: Iterable[GroundTruth], host: str | None = None) -> list[SensorView]:
    views = [SensorView(timestamp=truth.timestamp, global_ground_truth=truth) for truth in truths]
    for view in views:
        if host is not None:
            view.host_vehicle_id.value = int(host)
    return views


def written(file: Path, messages: Iterable[Any]) -> Path:
    """A trace with one channel."""
    with open_channel_writer(ChannelSpecification(file)) as writer:
        for message in messages:
            assert writer.write_message(message)
    return file


def written_together(file: Path, channels: dict[str, tuple[type, list[Any]]]) -> Path:
    """A trace with several channels."""
    with MultiTraceWriter() as writer:
        assert writer.open(file)
        for topic, (kind, messages) in channels.items():
            writer.add_channel(topic, kind)
            for message in messages:
                assert writer.write_message(message, topic)
    return file


def drives_of(imported: Imported) -> dict[str, Any]:
    return {drive.id: drive for drive in imported.drives}


def times_of(drive: Any) -> np.ndarray:
    """Times of a drive in the trace: one part of it, for whose range others were seen along the road."""
    numbers = np.round((drive.subject["time_s"].to_numpy() - BEGIN_S) / STEP_S).astype(int)
    assert np.array_equal(numbers, np.arange(numbers[0], numbers[-1] + 1))
    assert len(numbers) > 0.5 * len(TIMES_S)
    return TIMES_S[numbers]


def refusal_of(source: Path, options: ImportOptions = OPTIONS) -> str:
    with pytest.raises(CaseError) as caught:
        read_recording(source, options)
    line = str(caught.value)
    assert line.startswith((source.name, "command line"))
    assert "\n" not in line
    return line


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ground truth without a host vehicle."""
    return written(tmp_path_factory.mktemp("osi") / "bend.mcap", ground_truths())


def test_tables_tell_front_bumpers_speeds_and_times(trace: Path):
    imported = read_recording(trace, OPTIONS)
    drives = drives_of(imported)
    assert set(drives) == set(CARS)
    assert all(drive.range_m == OPTIONS.range_m for drive in imported.drives)
    for name, car in CARS.items():
        subject = drives[name].subject
        times_s = times_of(drives[name])
        x_m, y_m = car.front_m(times_s)
        np.testing.assert_allclose(subject["x_m"], x_m, atol=1e-6)
        np.testing.assert_allclose(subject["y_m"], y_m, atol=1e-6)
        np.testing.assert_allclose(subject["speed_kmh"], 3.6 * car.speed_mps)
        np.testing.assert_allclose(subject["yaw_rate_radps"], car.speed_mps / RADIUS_M)
        np.testing.assert_allclose(subject["acceleration_mps2"], 0.0, atol=1e-9)  # all of it points inwards
        assert subject["lane"].isna().all()


def test_subject_vehicle_sees_who_is_near(trace: Path):
    drive = drives_of(read_recording(trace, OPTIONS))["7"]
    times_s = times_of(drive)
    own_m = np.asarray(CARS["7"].front_m(times_s))
    for name, car in CARS.items():
        seen = drive.objects[drive.objects["vehicle_id"] == name]
        front_m = np.asarray(car.front_m(times_s))
        near = (np.hypot(*(front_m - own_m)) <= OPTIONS.range_m) & (name != "7")
        np.testing.assert_allclose(seen["time_s"], BEGIN_S + times_s[near], atol=1e-9)
        np.testing.assert_allclose(seen[["x_m", "y_m"]].to_numpy(), front_m[:, near].T, atol=1e-6)
        np.testing.assert_allclose(seen["speed_kmh"], 3.6 * car.speed_mps)
        np.testing.assert_allclose(seen["length_m"], car.length_m)
    assert set(drive.objects["vehicle_id"]) == {"8", "11"}
    assert 0 < (drive.objects["vehicle_id"] == "8").sum() < len(times_s)  # it drives away


@pytest.mark.parametrize("host", [None, "7"])
def test_sensor_view_tells_the_same_as_its_ground_truth(tmp_path: Path, host: str | None):
    truth = read_recording(written(tmp_path / "bend.mcap", ground_truths(host)), OPTIONS)
    view = read_recording(written(tmp_path / "bend_sv_.osi", sensor_views(ground_truths(), host)), OPTIONS)
    assert [drive.id for drive in view.drives] == [drive.id for drive in truth.drives]
    for one, other in zip(view.drives, truth.drives, strict=True):
        pd.testing.assert_frame_equal(one.subject, other.subject)
        pd.testing.assert_frame_equal(one.objects, other.objects)


def test_host_vehicle_is_the_only_subject_vehicle_unless_others_are_asked_for(tmp_path: Path):
    source = written(tmp_path / "20240101T000000Z_gt_3.7.0_5.29_121_bend.osi", ground_truths("8"))
    imported = read_recording(source, OPTIONS)
    assert [drive.id for drive in imported.drives] == ["8"]
    assert any("vehicle 8 is the trace's host vehicle" in line for line in imported.said)
    asked = read_recording(source, ImportOptions(begin_s=BEGIN_S, subjects=("11", "7")))
    assert {drive.id for drive in asked.drives} == {"11", "7"}


def test_host_vehicle_that_is_not_there_leaves_the_choice(tmp_path: Path):
    imported = read_recording(written(tmp_path / "bend.mcap", ground_truths("99")), OPTIONS)
    assert set(drives_of(imported)) == set(CARS)
    assert any("host vehicle, 99, is not among its vehicles" in line for line in imported.said)


def test_what_is_taken_and_left_out_is_said(trace: Path):
    assert read_recording(trace, OPTIONS).said == (
        "bend.mcap: 121 messages of GroundTruth; 3 of 3 vehicles as subject vehicles.",
        "virtual probes see 60 m ahead and behind; they count where all that was recorded.",
        "places are centres of boxes: half a length is added to reach the front bumpers.",
        "objects that are no vehicles are left out: 2 pedestrian, 1 stationary.",
    )


def test_missing_velocities_and_repeated_messages_are_said(tmp_path: Path):
    truths = ground_truths()
    truths[5].moving_object[0].base.ClearField("velocity")
    imported = read_recording(written(tmp_path / "t_gt.osi", [*truths, truths[-1]]), OPTIONS)
    assert any(line.startswith("messages left out") and line.endswith(": 1.") for line in imported.said)
    assert any(line == "speeds left empty, as there is no velocity: 1." for line in imported.said)
    assert drives_of(imported)["7"].subject["speed_kmh"].isna().sum() == 1


def test_channel_with_most_messages_of_ground_truth_is_taken(tmp_path: Path):
    truths = ground_truths()
    channels = {
        "views": (SensorView, sensor_views(ground_truths(), "7")),
        "few": (GroundTruth, truths[:20]),
        "all": (GroundTruth, truths),
        "detected": (SensorData, [SensorData()]),
    }
    imported = read_recording(written_together(tmp_path / "many.mcap", channels), OPTIONS)
    assert set(drives_of(imported)) == set(CARS)
    line = next(line for line in imported.said if line.startswith("channel all (GroundTruth) is taken"))
    assert "few (GroundTruth, 20)" in line
    assert "views (SensorView, 121)" in line
    assert "detected (SensorData, 1)" in line


@pytest.mark.parametrize("turn_rad", [0.0, 1.5])
def test_projection_of_the_trace_lays_places_on_the_globe(tmp_path: Path, turn_rad: float):
    offset = GroundTruth.ProjFrameOffset(position={"x": 560_000.0, "y": 5_930_000.0}, yaw=turn_rad)
    source = written(tmp_path / "bend.mcap", ground_truths("7", proj_string=PLANE, proj_frame_offset=offset))
    x_m, y_m = CARS["7"].front_m(TIMES_S)
    turned = (x_m + 1j * y_m) * np.exp(1j * turn_rad)
    to_globe = pyproj.Transformer.from_crs(PLANE, "EPSG:4326", always_xy=True)
    expected_deg = to_globe.transform(560_000.0 + turned.real, 5_930_000.0 + turned.imag)
    (drive,) = read_recording(source, OPTIONS).drives
    np.testing.assert_allclose(np.degrees(drive.subject["longitude_rad"]), expected_deg[0], atol=1e-10)
    np.testing.assert_allclose(np.degrees(drive.subject["latitude_rad"]), expected_deg[1], atol=1e-10)
    (own,) = read_recording(source, replace(OPTIONS, crs="EPSG:32633")).drives  # what the user says goes first
    to_globe = pyproj.Transformer.from_crs("EPSG:32633", "EPSG:4326", always_xy=True)
    np.testing.assert_allclose(np.degrees(own.subject["longitude_rad"]), to_globe.transform(x_m, y_m)[0], atol=1e-10)
    seen = ["time_s", "vehicle_id"]
    pd.testing.assert_frame_equal(drive.objects[seen], own.objects[seen])  # directions have turned with the places


@pytest.mark.parametrize("text", ["EPSG:4326", "none"])
def test_projection_that_is_none_is_said(tmp_path: Path, text: str):
    imported = read_recording(written(tmp_path / "bend.mcap", ground_truths("7", proj_string=text)), OPTIONS)
    assert any(f'proj_string, "{text}", is no projection' in line for line in imported.said)
    np.testing.assert_allclose(imported.drives[0].subject["x_m"], CARS["7"].front_m(TIMES_S)[0])


def test_unknown_subject_vehicle_is_refused(trace: Path):
    line = refusal_of(trace, ImportOptions(subjects=("5",)))
    assert 'got "5"' in line
    assert all(name in line for name in CARS)


@pytest.mark.parametrize("name", ["position", "orientation", "dimension"])
def test_vehicle_without_a_place_is_refused(tmp_path: Path, name: str):
    truths = ground_truths()
    truths[4].moving_object[1].base.ClearField(name)
    line = refusal_of(written(tmp_path / "bend.mcap", truths))
    assert line == f"bend.mcap: message 5, moving_object 8: expected numbers in base.{name}; there are none."


def without_vehicles(truths: list[GroundTruth]) -> None:
    for truth in truths:
        del truth.moving_object[:]


SPOILT: dict[str, tuple[Callable[[list[GroundTruth]], object], str]] = {
    "no vehicle": (without_vehicles, "expected moving objects of type vehicle; there are none."),
    "no time": (lambda truths: truths[2].ClearField("timestamp"), "message 3: expected a timestamp; there is none."),
    "time falls": (lambda truths: truths.insert(9, truths[4]), "message 10: expected times that rise, got one 0.4 s"),
    "no message": (lambda truths: truths.clear(), "expected messages of GroundTruth; there are none."),
}


@pytest.mark.parametrize("name", SPOILT)
def test_spoilt_messages_are_refused(tmp_path: Path, name: str):
    spoil, expected = SPOILT[name]
    truths = ground_truths()
    spoil(truths)
    assert expected in refusal_of(written(tmp_path / "bend_gt.osi", truths))


def test_sensor_view_without_ground_truth_is_refused(tmp_path: Path):
    view = SensorView(timestamp={"seconds": 1})
    assert "message 1: expected a global_ground_truth" in refusal_of(written(tmp_path / "x_sv_.osi", [view]))


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_mcap_that_is_cut_off_is_refused(trace: Path, tmp_path: Path, share: float):
    whole = trace.read_bytes()
    source = tmp_path / "cut.mcap"
    source.write_bytes(whole[: int(share * len(whole))])
    assert "expected a whole MCAP file" in refusal_of(source)


def test_mcap_that_is_damaged_inside_is_refused(trace: Path, tmp_path: Path):
    damaged = bytearray(trace.read_bytes())
    middle = len(damaged) // 3
    damaged[middle : middle + 64] = bytes(64)
    source = tmp_path / "damaged.mcap"
    source.write_bytes(damaged)
    assert "expected GroundTruth" in refusal_of(source)


def test_osi_that_is_cut_off_is_refused(tmp_path: Path):
    whole = written(tmp_path / "whole_gt.osi", ground_truths()).read_bytes()
    source = tmp_path / "cut_gt.osi"
    source.write_bytes(whole[: len(whole) // 2])
    assert "expected GroundTruth: Truncated" in refusal_of(source)


def test_mcap_without_ground_truth_names_what_it_has(tmp_path: Path):
    channels = {"detected": (SensorData, [SensorData()]), "truth": (GroundTruth, [])}
    line = refusal_of(written_together(tmp_path / "other.mcap", channels))
    assert "expected messages of GroundTruth or SensorView; it has detected (SensorData, 1)" in line
    assert "no channel" in refusal_of(written_together(tmp_path / "empty.mcap", {}))


def test_osi_tells_its_kind_by_its_name(tmp_path: Path):
    for name, kind in (("drive_sd_.osi", "SensorData"), ("drive.osi", "Unknown")):
        with SingleTraceWriter() as writer:
            assert writer.open(tmp_path / name)
        assert f"(SensorView) in its name, got {kind}." in refusal_of(tmp_path / name)
    (tmp_path / "bend.txt").touch()
    assert "ends in .mcap or .osi" in refusal_of(tmp_path / "bend.txt")


@pytest.mark.parametrize(("plane", "host"), list(itertools.product([None, PLANE], [None, "7"])))
def test_case_of_a_trace_has_nothing_to_refuse(tmp_path: Path, plane: str | None, host: str | None):
    fields = {} if plane is None else {"proj_string": plane, "proj_frame_offset": {"position": {"x": 5e5, "y": 5.9e6}}}
    source = written(tmp_path / "bend.mcap", ground_truths(host, **fields))
    lines = import_case("osi", source, tmp_path / "case", OPTIONS)
    assert lines[-1].startswith("no scenario")
    check = check_case(tmp_path / "case")
    assert not check.refusals
    assert not check.has_scenario
