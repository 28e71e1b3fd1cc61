"""Calibrated traffic for other simulators: what is written comes back, and both formats tell the same drive."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from jaxcalib.cli.app import app
from jaxcalib.errors import CaseError
from jaxcalib.exporters.export import export
from jaxcalib.exporters.plane import Plane
from jaxcalib.field.route_geometry import build_route_geometry
from jaxcalib.importers.importer import ImportOptions
from jaxcalib.importers.sumo_fcd import slices_in
from jaxcalib.importers.trajectories import Slice
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.sumo.trajectories import VehicleKind, record_trajectories
from tests.copies import copy_corridor
from tests.jaxcalib.exporters.traffic import run_of_the_scenario
from tests.places import CORRIDOR

pytest.importorskip("osi_utilities", reason="the extra 'osi' is not installed")
pytest.importorskip("osi3", reason="the extra 'osi' is not installed")

from osi3.osi_object_pb2 import MovingObject
from osi_utilities import ChannelSpecification, MultiTraceReader, open_channel

from jaxcalib.exporters.osi_ground_truth import write_ground_truth
from jaxcalib.importers import osi, sumo_fcd

KINDS = {"ego": VehicleKind(4.8, 1.8, 1.5, "passenger"), "lorry.7": VehicleKind(14.0, 2.5, 3.6, "truck")}
UTM = "+proj=utm +zone=32 +ellps=WGS84 +units=m +no_defs"
STEP_S, YAW_RAD = 0.1, 0.4
PER_VEHICLE = ("vehicle", "x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "lane", "length_m")


def slices() -> list[Slice]:
    """A lorry that joins the subject vehicle after a while, both along one line."""
    made = []
    for number in range(120):
        time_s = 300.0 + STEP_S * number
        names = ["ego", "lorry.7"] if number >= 20 else ["ego"]
        along = np.asarray([20.0 * STEP_S * number, 40.0 + 18.0 * STEP_S * number])[: len(names)]
        nothing = np.full(len(names), np.nan)
        made.append(
            Slice(
                time_s, np.asarray(names), 1000.0 + np.cos(YAW_RAD) * along, 500.0 + np.sin(YAW_RAD) * along,
                np.full(len(names), YAW_RAD), np.asarray([20.0, 18.0])[: len(names)], np.zeros(len(names)), nothing,
                nothing,
            )
        )  # fmt: skip
    return made


def test_messages_say_what_each_vehicle_is_and_where_its_middle_lies(tmp_path: Path):
    file = tmp_path / "two.mcap"
    plane = Plane(UTM, (-500_000.0, -5_000_000.0))
    assert write_ground_truth(file, slices(), KINDS, "ego", plane) == 120
    with open_channel(ChannelSpecification(file)) as messages:
        read: list[Any] = list(messages)
    first, last = read[0], read[-1]
    assert (first.timestamp.seconds, first.timestamp.nanos) == (300, 0)
    assert (read[1].timestamp.seconds, read[1].timestamp.nanos) == (300, 100_000_000)
    assert len(first.moving_object) == 1
    ego, lorry = last.moving_object
    assert last.host_vehicle_id.value == ego.id.value != lorry.id.value
    assert lorry.vehicle_classification.type == MovingObject.VehicleClassification.TYPE_HEAVY_TRUCK
    assert lorry.source_reference[0].identifier == ["lorry.7"]
    along_m = 40.0 + 18.0 * STEP_S * 119 - 7.0
    centre = (1000.0 + np.cos(YAW_RAD) * along_m, 500.0 + np.sin(YAW_RAD) * along_m)
    assert (lorry.base.position.x, lorry.base.position.y) == pytest.approx(centre, abs=1e-6)
    assert (lorry.base.dimension.length, lorry.base.velocity.x) == pytest.approx((14.0, 18.0 * np.cos(YAW_RAD)))
    rear, front = lorry.vehicle_attributes.bbcenter_to_rear, lorry.vehicle_attributes.bbcenter_to_front
    assert (rear.x, rear.y, rear.z) == pytest.approx((-4.2, 0.0, 0.325 - 1.8))  # 0.6 of 14 m between the axles
    assert (front.x, front.z) == pytest.approx((4.2, 0.325 - 1.8))
    assert last.proj_string == UTM
    assert last.proj_frame_offset.position.x == 500_000.0
    assert (last.version.version_major, last.version.version_minor) >= (3, 5)


def test_instants_without_the_host_are_left_out_and_the_file_names_its_release(tmp_path: Path):
    """A host that is no moving object of its message breaks a rule of OSI's own checker."""
    made = slices()
    alone = [replace(one, **{name: getattr(one, name)[1:] for name in PER_VEHICLE}) for one in made[-5:]]
    file = tmp_path / "some.mcap"
    assert write_ground_truth(file, [*alone[:2], *made[20:30], *alone[2:]], KINDS, "ego", Plane(None, (0.0, 0.0))) == 10
    with open_channel(ChannelSpecification(file)) as messages:
        read: list[Any] = list(messages)
    assert all(one.host_vehicle_id.value in {thing.id.value for thing in one.moving_object} for one in read)
    with MultiTraceReader() as reader:
        assert reader.open(file)
        about = {name: text for one in reader.get_file_metadata() for name, text in one["data"].items()}
        channel = reader.get_channel_metadata("ground_truth")
    version = read[0].version
    release = f"{version.version_major}.{version.version_minor}.{version.version_patch}"
    assert about["version"] == about["min_osi_version"] == about["max_osi_version"] == release
    assert channel is not None
    assert channel["net.asam.osi.trace.channel.osi_version"] == release


def test_a_subject_vehicle_with_a_driver_of_its_own_is_not_written_as_sumos(
    tmp_path: Path, problem: CalibrationProblem
):
    case = copy_corridor(tmp_path / "case", "d01", "d03")
    text = (case / "case.toml").read_text()
    assert "[subject]\n" in text
    (case / "case.toml").write_text(text.replace("[subject]\n", '[subject]\nmodel = "planner"\n'))
    run_of_the_scenario(tmp_path / "run", problem)
    with pytest.raises(CaseError, match=r'subject\.model: expected model = "vtype", got "planner".*--free-subject'):
        export(case, tmp_path / "run", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("projection", [None, UTM])
def test_a_trace_comes_back_as_the_drive_that_it_was(tmp_path: Path, projection: str | None):
    file = tmp_path / "two.mcap"
    write_ground_truth(file, slices(), KINDS, "ego", Plane(projection, (-500_000.0, -5_000_000.0)))
    found = osi.read_recording(file, ImportOptions(begin_s=300.0, range_m=60.0))
    (drive,) = found.drives
    assert drive.subject["speed_kmh"].to_numpy() == pytest.approx(72.0)
    assert drive.objects["speed_kmh"].to_numpy() == pytest.approx(64.8)
    ahead_m = 40.0 - 2.0 * (drive.objects["time_s"].to_numpy(float) - 300.0)
    assert len(ahead_m) > 20
    seen = drive.subject["time_s"].isin(drive.objects["time_s"]).to_numpy()
    if projection is None:  # places are in the network's plane
        apart = drive.objects[["x_m", "y_m"]].to_numpy(float) - drive.subject[["x_m", "y_m"]].to_numpy(float)[seen]
        assert np.hypot(*apart.T) == pytest.approx(ahead_m, abs=1e-3)
    else:
        first = drive.subject.iloc[0]
        way_m = 20.0 * (float(first["time_s"]) - 300.0)
        x_m, y_m = 501_000.0 + np.cos(YAW_RAD) * way_m, 5_000_500.0 + np.sin(YAW_RAD) * way_m
        expected = np.radians(pyproj.Proj(UTM)(x_m, y_m, inverse=True))
        assert [first["longitude_rad"], first["latitude_rad"]] == pytest.approx(expected, abs=1e-8)


def test_a_drive_that_is_not_there_is_refused_before_anything_is_written(
    tmp_path: Path, two_drives: Path, problem: CalibrationProblem
):
    run = run_of_the_scenario(tmp_path / "run", problem)
    with pytest.raises(CaseError, match="--drive: expected one of d01"):
        export(two_drives, run, tmp_path / "out", drive="d99")
    assert not (tmp_path / "out").exists()


def test_a_run_is_kept_from_the_departure_on_with_what_each_vehicle_is(tmp_path: Path, problem: CalibrationProblem):
    file = tmp_path / "ten_seconds.xml.gz"
    kinds = record_trajectories(
        problem.scenario, problem.layout, problem.template.base_values().tolist(), 300.0, "ego", 310.0, 3, file, 300.0
    )
    read = list(slices_in(file)())
    assert [one.time_s for one in (read[0], read[-1])] == pytest.approx([300.0, 309.9], abs=0.2)
    assert "ego" in read[-1].vehicle
    assert set(np.concatenate([one.vehicle for one in read])) <= set(kinds)
    assert kinds["ego"].length_m == 4.8
    assert np.isfinite(read[-1].acceleration_mps2).all()


@pytest.mark.nightly("two runs of SUMO over the whole corridor take a minute; every commit makes one of ten seconds")
def test_both_formats_tell_the_same_drive(tmp_path: Path, problem: CalibrationProblem):
    """SUMO's own floating car data, and the trace that was made of it, imported as if somebody else had made them."""
    run = run_of_the_scenario(tmp_path / "run", problem)
    command = ["export", str(CORRIDOR), str(run), "--out", str(tmp_path / "out"), "--drive", "d01", "--seed", "5"]
    for to in ("osi", "fcd"):
        assert app([*command, "--to", to], result_action="return_value") == 0
    trace, fcd = tmp_path / "out/corridor_d01_5.mcap", tmp_path / "out/corridor_d01_5.fcd.xml.gz"
    options = ImportOptions(config=CORRIDOR / "scenario/scenario.sumocfg", range_m=120.0)
    (one,) = osi.read_recording(trace, options).drives
    (other,) = sumo_fcd.read_recording(fcd, replace(options, subjects=("ego",))).drives
    assert len(one.subject) == len(other.subject) > 500
    for name in ("speed_kmh", "acceleration_mps2"):
        np.testing.assert_allclose(one.subject[name], other.subject[name], atol=1e-3)
    assert len(one.objects) == len(other.objects) > 5000
    geometry = build_route_geometry(problem.scenario.row_map)
    longitude, latitude = (np.degrees(one.objects[f"{name}_rad"].to_numpy(float)) for name in ("longitude", "latitude"))
    places = np.stack(geometry.projection(longitude, latitude), axis=1) + geometry.net_offset_m
    since_s = [drive.objects["time_s"] - drive.subject["time_s"].iloc[0] for drive in (one, other)]
    x_m, y_m = (other.objects[name].to_numpy(float) for name in ("x_m", "y_m"))
    np.testing.assert_allclose(np.sort(since_s[0]), np.sort(since_s[1]), atol=1e-3)
    np.testing.assert_allclose(np.sort(places[:, 0]), np.sort(x_m), atol=5e-3)
    np.testing.assert_allclose(np.sort(places[:, 1]), np.sort(y_m), atol=5e-3)
    speeds = [np.sort(drive.objects["speed_kmh"].to_numpy(float)) for drive in (one, other)]
    np.testing.assert_allclose(*speeds, atol=1e-2)
