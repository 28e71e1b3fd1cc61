"""Who would be left behind: the follower of each vehicle in its own row."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.gap_acceptance import Following
from surrogate.road.neighbours import shift_up
from surrogate.road.traffic_state import HEAD, VehicleArrays

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class OldFollower(eqx.Module):
    """Who follows each vehicle in its own lane."""

    exists: Flag  # whether there is one
    gap_m: Value  # its gap to the vehicle less its own jam gap; inf where there is none
    speed_mps: Value
    acceleration_mps2: Value  # its last acceleration
    max_speed_mps: Value  # speed that it wants
    vehicle_class: Int[Array, " vehicle"]


def old_follower_of(vehicles: VehicleArrays, following: Following, desired_mps: Value) -> OldFollower:
    """Who follows each vehicle in its own row: the entry after it, for each row begins with a head."""
    vehicle_class = shift_up(vehicles.vehicle_class, HEAD)
    exists = vehicle_class >= 0
    rear_m = vehicles.position_m - following.length_m(vehicles.vehicle_class)
    jam_gap_m = following.of(vehicle_class).field("jam_gap_m")
    gap_m = rear_m - shift_up(vehicles.position_m, 0.0) - jam_gap_m
    return OldFollower(
        exists=exists,
        gap_m=jnp.where(exists, gap_m, jnp.inf),
        speed_mps=shift_up(vehicles.speed_mps, 0.0),
        acceleration_mps2=shift_up(vehicles.acceleration_mps2, 0.0),
        max_speed_mps=jnp.where(exists, shift_up(desired_mps, 0.0), jnp.inf),
        vehicle_class=vehicle_class,
    )
