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
from osi_utilities import ChannelSpecification, open_channel_writer

from jaxcalib.exporters.plane import Plane
from jaxcalib.exporters.recorded_run import RecordedRun
from jaxcalib.field.route_geometry import build_route_geometry
from jaxcalib.importers.sumo_fcd import slices_in
from jaxcalib.importers.trajectories import Slice
from sim_adapters.sumo.trajectories import VehicleKind

TOPIC = "ground_truth"
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
    """Write a trace and return how many messages it has.

    Args:
        file: where to; ends in .mcap or .osi.
        slices: the traffic at each instant, front bumpers in the network's plane.
        vehicles: what each vehicle is, by id.
        host: id of the subject vehicle.
        plane: where the network's plane lies.
    """
    numbers = {name: number for number, name in enumerate(vehicles, start=1)}
    num_messages = 0
    with open_channel_writer(ChannelSpecification(file, topic=TOPIC)) as writer:
        for here in slices:
            truth = _message(here.time_s, plane)
            truth.host_vehicle_id.value = numbers[host]
            for row, name in enumerate(here.vehicle.tolist()):
                _add_vehicle(truth, here, row, numbers[name], name, vehicles[name])
            writer.write_message(truth)
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
    base.orientation.yaw = yaw
    base.dimension.length, base.dimension.width, base.dimension.height = kind.length_m, kind.width_m, kind.height_m
    base.velocity.x, base.velocity.y = (here.speed_mps[row] * along).tolist()
    base.acceleration.x, base.acceleration.y = (np.nan_to_num(here.acceleration_mps2[row]) * along).tolist()
