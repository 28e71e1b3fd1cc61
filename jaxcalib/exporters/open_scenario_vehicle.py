"""A vehicle of SUMO as one of ASAM OpenSCENARIO XML, whose origin lies below the middle of the rear axle.

Source: ASAM OpenSCENARIO XML 1.2, model documentation: Vehicle, Axles, BoundingBox. Where the body lies does not depend
on where the axles are taken to be, for the box's centre is written with the same share.
"""

from typing import Any

import numpy as np
from scenariogeneration import xosc

from jaxcalib.exporters.axles import WHEEL_M, rear_overhang_m, wheelbase_m
from jaxcalib.exporters.tracks import Track
from sim_adapters.sumo.trajectories import VehicleKind

TRACK_SHARE = 0.85  # of the width, between the middles of left and right wheels
STEERING_RAD = 0.6  # largest angle of wheels, of a car's size
# performance must be given: so much that it bounds nobody's trajectory
FASTEST_MPS, STRONGEST_MPS2 = 100.0, 20.0
CATEGORIES: dict[str, Any] = {  # SUMO's vehicle classes that are no cars
    "bus": xosc.VehicleCategory.bus,
    "coach": xosc.VehicleCategory.bus,
    "delivery": xosc.VehicleCategory.van,
    "motorcycle": xosc.VehicleCategory.motorbike,
    "trailer": xosc.VehicleCategory.semitrailer,
    "truck": xosc.VehicleCategory.truck,
}


def vehicle_of(kind: VehicleKind) -> xosc.Vehicle:
    """Return the vehicle; it is named for SUMO's vehicle class."""
    category: Any = CATEGORIES.get(kind.vehicle_class, xosc.VehicleCategory.car)
    centre_m = 0.5 * kind.length_m - rear_overhang_m(kind)
    box = xosc.BoundingBox(
        kind.width_m, kind.length_m, kind.height_m, round(centre_m, 4), 0.0, round(0.5 * kind.height_m, 4)
    )
    track_m = round(TRACK_SHARE * kind.width_m, 4)
    front = xosc.Axle(STEERING_RAD, WHEEL_M, track_m, round(wheelbase_m(kind), 4), 0.5 * WHEEL_M)
    rear = xosc.Axle(0.0, WHEEL_M, track_m, 0.0, 0.5 * WHEEL_M)
    name = kind.vehicle_class or "vehicle"
    return xosc.Vehicle(name, category, box, front, rear, FASTEST_MPS, STRONGEST_MPS2, STRONGEST_MPS2)


def rear_axle_m(track: Track, kind: VehicleKind) -> np.ndarray:
    """Return the middle of the rear axle at each instant of a track, [instant, 2]."""
    behind_m = kind.length_m - rear_overhang_m(kind)
    front = np.stack([track.x_m, track.y_m], axis=1)
    return front - behind_m * np.stack([np.cos(track.heading_rad), np.sin(track.heading_rad)], axis=1)
