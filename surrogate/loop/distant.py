"""Vehicles beyond the subject vehicle's sensors may follow their leaders otherwise than those near it.

Near vehicles meet the subject vehicle and are known from its logs; for the distant ones a coarser model may do. A
vehicle changes over at a decision and keeps its place and its speed.

Source: the paper, sections 3 and 4.3.2 (surrounding and more distant vehicles). As with SUMO's `vehicle.setType`, the
car-following model and the highest speed change, the speed factor moves by the difference of both means, and lane
changing stays what it was.
"""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.vehicle.vehicle_class import VehicleClass, select_by_class


class DistantDrivers(eqx.Module):
    """Which classes follow otherwise beyond the sensors' range; choices of the trace."""

    near: tuple[int, ...] = eqx.field(static=True)  # classes within range
    distant: tuple[int, ...] = eqx.field(static=True)  # the class that each of them is beyond it
    ahead_m: float = eqx.field(static=True)  # range of the sensors ahead
    behind_m: float = eqx.field(static=True)  # range behind


def distant_class(near: VehicleClass, own: VehicleClass) -> VehicleClass:
    """Return the class of distant vehicles.

    Args:
        near: the class that they are near the subject vehicle.
        own: whose car-following, highest speed and mean speed factor they have.
    """
    return dataclasses.replace(
        near,
        car_following=own.car_following,
        max_speed_mps=own.max_speed_mps,
        speed_factor_mean=own.speed_factor_mean,
    )


def with_distant_drivers(
    vehicles: VehicleArrays,
    drivers: DistantDrivers,
    classes: Sequence[VehicleClass],
    is_subject: Bool[Array, " vehicle"],
) -> VehicleArrays:
    """Return the vehicles, each with the class of its distance; all are distant while the subject vehicle is not there.

    Args:
        vehicles: the vehicles.
        drivers: which classes change.
        classes: all classes.
        is_subject: which vehicle is the subject vehicle.
    """
    ahead_m = vehicles.position_m - jnp.sum(jnp.where(is_subject, vehicles.position_m, 0.0))
    is_near = jnp.any(is_subject) & (ahead_m <= drivers.ahead_m) & (ahead_m >= -drivers.behind_m)
    before = vehicles.vehicle_class
    after = before
    for near, distant in zip(drivers.near, drivers.distant, strict=True):
        after = jnp.where((before == near) & ~is_near, distant, after)
        after = jnp.where((before == distant) & is_near, near, after)
    means = [c.speed_factor_mean for c in classes]
    moved = select_by_class(means, after) - select_by_class(means, before)
    return with_changes(vehicles, vehicle_class=after, speed_factor=vehicles.speed_factor + moved)
