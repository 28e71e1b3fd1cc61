"""ASAM OSI ground truth: one message per step of the simulation.

Source: ASAM OSI 3.7, osi_groundtruth.proto, osi_object.proto and osi_common.proto; places are the centres of boxes, in
the frame that proj_frame_offset lays into the plane of proj_string.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_version_pb2 import DESCRIPTOR as VERSION_FILE
from osi3.osi_version_pb2 import InterfaceVersion, current_interface_version
from osi_utilities import MultiTraceWriter
from osi_utilities.tracefile.writers.multi import prepare_required_file_metadata

from jaxcalib.exporters.axles import WHEEL_M, rear_overhang_m
from jaxcalib.exporters.plane import Plane
from jaxcalib.exporters.recorded_run import RecordedRun
from jaxcalib.field.route_geometry import build_route_geometry
from jaxcalib.importers.sumo_fcd import slices_in
from jaxcalib.importers.trajectories import Slice
from sim_adapters.sumo.trajectories import VehicleKind

TOPIC = "ground_truth"
# What the file and its channel say of themselves: the release of OSI, of the file's format as of its messages.
RELEASES = ("version", "min_osi_version", "max_osi_version")
CHANNEL_RELEASE = "net.asam.osi.trace.channel.osi_version"
CHANNEL_PROTOBUF = "net.asam.osi.trace.channel.protobuf_version"
REFERENCE = "org.eclipse.sumo.vehicle"  # reverse domain name, as external references ask for
NANOSECONDS = 1_000_000_000
CLASSES = {  # SUMO's vehicle classes that OSI has a word for; others are cars
    "bus": MovingObject.VehicleClassification.TYPE_BUS,
    "coach": MovingObject.VehicleClassification.TYPE_BUS,
    "delivery": MovingObject.VehicleClassification.TYPE_DELIVERY_VAN,
    "motorcycle": MovingObject.VehicleClassification.TYPE_MOTORBIKE,
    "trailer": MovingObject.VehicleClassification.TYPE_HEAVY_TRUCK,
    "truck": MovingObject.VehicleClassification.TYPE_HEAVY_TRUCK,
}


def export_ground_truth(recorded: RecordedRun) -> list[str]:
    """Write a recorded run's trace and return a line about it."""
    geometry = build_route_geometry(recorded.problem.scenario.row_map)
    projection = geometry.projection.srs if geometry.has_projection else None
    file, plane = recorded.folder / f"{recorded.name}.mcap", Plane(projection, geometry.net_offset_m)
    number = write_ground_truth(file, slices_in(recorded.fcd)(), recorded.vehicles, recorded.subject, plane)
    return [f"{file}: {number} messages of ASAM OSI ground truth; the host vehicle is '{recorded.subject}'."]


def write_ground_truth(
    file: Path, slices: Iterable[Slice], vehicles: Mapping[str, VehicleKind], host: str, plane: Plane
) -> int:
    """Write a trace and return how many messages it has: those of instants at which the host vehicle is there.

    Args:
        file: where to; ends in .mcap.
        slices: the traffic at each instant, front bumpers in the network's plane.
        vehicles: what each vehicle is, by id.
        host: id of the subject vehicle.
        plane: where the network's plane lies.
    """
    numbers = {name: number for number, name in enumerate(vehicles, start=1)}
    num_messages = 0
    writer, about = MultiTraceWriter(), prepare_required_file_metadata() | dict.fromkeys(RELEASES, _release())
    if not writer.open(file, about):
        raise OSError(f"{file} cannot be written")
    with writer:
        of_channel = {CHANNEL_RELEASE: _release(), CHANNEL_PROTOBUF: about["max_protobuf_version"]}
        writer.add_channel(TOPIC, GroundTruth, of_channel)
        for here in slices:
            if host not in here.vehicle:
                continue  # a host that is no moving object of the message is none
            truth = _message(here.time_s, plane)
            truth.host_vehicle_id.value = numbers[host]
            for row, name in enumerate(here.vehicle.tolist()):
                _add_vehicle(truth, here, row, numbers[name], name, vehicles[name])
            writer.write_message(truth, TOPIC)
            num_messages += 1
    return num_messages


def _message(time_s: float, plane: Plane) -> GroundTruth:
    truth = GroundTruth()
    truth.version.CopyFrom(_version())
    nanoseconds = round(time_s * NANOSECONDS)
    truth.timestamp.seconds, truth.timestamp.nanos = divmod(nanoseconds, NANOSECONDS)
    if plane.projection is not None:
        truth.proj_string = plane.projection
        offset = truth.proj_frame_offset
        offset.position.x, offset.position.y = (-metres for metres in plane.net_offset_m)
        offset.yaw = 0.0
    return truth


def _release() -> str:
    version = _version()
    return f"{version.version_major}.{version.version_minor}.{version.version_patch}"


def _version() -> InterfaceVersion:
    """The version of the interface that the messages were generated for."""
    return VERSION_FILE.GetOptions().Extensions[current_interface_version]  # pyright: ignore[reportArgumentType]


def _add_vehicle(truth: GroundTruth, here: Slice, row: int, number: int, name: str, kind: VehicleKind) -> None:
    thing = truth.moving_object.add(type=MovingObject.TYPE_VEHICLE)
    thing.id.value = number
    thing.vehicle_classification.type = CLASSES.get(
        kind.vehicle_class, MovingObject.VehicleClassification.TYPE_MEDIUM_CAR
    )
    reference = thing.source_reference.add()
    reference.type = REFERENCE
    reference.identifier.append(name)
    base, yaw = thing.base, float(here.heading_rad[row])
    along = np.asarray([np.cos(yaw), np.sin(yaw)])
    centre = np.asarray([here.x_m[row], here.y_m[row]]) - 0.5 * kind.length_m * along
    base.position.x, base.position.y, base.position.z = float(centre[0]), float(centre[1]), 0.5 * kind.height_m
    base.orientation.yaw = float(np.arctan2(along[1], along[0]))  # in (-pi, pi], as the standard prefers
    base.dimension.length, base.dimension.width, base.dimension.height = kind.length_m, kind.width_m, kind.height_m
    axle_m = 0.5 * kind.length_m - rear_overhang_m(kind)
    for axle, place_m in ((thing.vehicle_attributes.bbcenter_to_rear, -axle_m),
                          (thing.vehicle_attributes.bbcenter_to_front, axle_m)):  # fmt: skip
        axle.x, axle.y, axle.z = place_m, 0.0, 0.5 * (WHEEL_M - kind.height_m)
    base.velocity.x, base.velocity.y = (here.speed_mps[row] * along).tolist()
    base.acceleration.x, base.acceleration.y = (np.nan_to_num(here.acceleration_mps2[row]) * along).tolist()
