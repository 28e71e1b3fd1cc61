"""The state of one simulation: the "now", nothing else.

Vehicles lie in flat arrays sorted by (row, -position), so that the leader is the previous entry. Each row begins with
a *head*, an entry at position +inf and speed 0 that stands for "no leader"; so every vehicle has an entry before it
and `gap = inf` means no leader without any special case. Empty entries follow the last row.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

EMPTY = -2  # class of an empty entry
HEAD = -1  # class of the entry that opens each row
UNSEEN = -1  # track number of a vehicle that the subject vehicle has not yet detected


class VehicleArrays(eqx.Module):
    """What is known of each vehicle. Arrays are sorted by (row, -position); see the module's text."""

    position_m: Float[Array, " vehicle"]  # front bumper along the route
    speed_mps: Float[Array, " vehicle"]  # speed at the end of the last step
    acceleration_mps2: Float[Array, " vehicle"]  # speed change over the last step, per second
    row: Int[Array, " vehicle"]  # row of the road; the number of rows where the entry is empty
    vehicle_class: Int[Array, " vehicle"]  # index into the tuple of vehicle classes, or HEAD or EMPTY
    destination: Int[Array, " vehicle"]  # index of the exit that the vehicle takes
    identity: Int[Array, " vehicle"]  # (entrance, arrival number) in one integer; keys its random numbers
    # number by order of first detection by the subject vehicle, by each of them if there are several, or UNSEEN
    track: Int[Array, " vehicle *subject"]
    speed_factor: Float[Array, " vehicle"]  # desired speed over the limit
    gain_left_memory: Float[Array, " vehicle"]  # LC2013's speed-gain motive to the left
    gain_right_memory: Float[Array, " vehicle"]  # the same to the right
    keep_right_memory: Float[Array, " vehicle"]  # LC2013's keep-right motive, <= 0
    look_ahead_speed_mps: Float[Array, " vehicle"]  # LC2013's slowly decaying speed
    # acceleration that the vehicle's own lane changing asks for in the coming steps; inf for none
    own_advice_mps2: Float[Array, " vehicle"]
    # acceleration that other vehicles' lane changing asks for; inf for none
    asked_advice_mps2: Float[Array, " vehicle"]
    speed_limit_mps: Float[Array, " vehicle"]  # legal limit where the vehicle was at the last decision
    slow_position_m: Float[Array, " vehicle"]  # where the next lower limit begins
    slow_limit_mps: Float[Array, " vehicle"]  # that limit
    stop_position_m: Float[Array, " vehicle"]  # where the vehicle must stand if it does not leave its lane
    # what each effect remembers of each vehicle; None without effects
    personal: dict[str, dict[str, Array]] | None = None

    @property
    def is_vehicle(self) -> Bool[Array, " vehicle"]:
        """Whether the entry is a vehicle, not a head and not empty."""
        return self.vehicle_class >= 0


def with_changes(vehicles: VehicleArrays, **changes: Any) -> VehicleArrays:
    """Return the vehicles with other values in some of the arrays."""
    fields = {name: getattr(vehicles, name) for name in VehicleArrays.__dataclass_fields__}
    return VehicleArrays(**(fields | changes))


class Manoeuvres(eqx.Module):
    """Lane changes under way, where changes take time; see `lane_change/manoeuvre.py`."""

    direction: Int[Array, " vehicle"]  # of the change; 0 where there is none
    reason: Int[Array, " vehicle"]  # of the change
    age: Int[Array, " vehicle"]  # decisions since it began
    has_switched: Bool[Array, " vehicle"]  # whether the vehicle belongs to the new lane
    shadow_row: Int[Array, " vehicle"]  # the other lane
    # entry of the leader that the change adds, to the vehicle itself or to who is behind; 0 for none
    second_leader: Int[Array, " vehicle"]


class TrafficState(eqx.Module):
    """All that the next step needs."""

    vehicles: VehicleArrays
    head: Int[Array, " row_plus_one"]  # entry at which each row begins, and behind the last row the first empty entry
    step: Int[Array, ""]  # number of the next time step
    num_arrived: Int[Array, " entrance"]  # vehicles that have asked to enter, per entrance
    num_inserted: Int[Array, " entrance"]  # vehicles that have entered, per entrance
    next_arrival: Float[Array, " entrance"]  # cumulated demand [veh] at which the next vehicle of each entrance arrives
    cumulated_demand: Float[Array, " entrance"]  # demand cumulated so far [veh], per entrance
    # whether the subject vehicle, each of them if there are several, has entered
    subject_inserted: Bool[Array, "*subject"]
    subject_left: Bool[Array, "*subject"]  # whether it has reached its destination
    num_tracks: Int[Array, "*subject"]  # vehicles that it has detected so far
    num_collisions: Int[Array, ""]  # vehicle steps with overlapping vehicles
    # steps in which a subject vehicle that repeats its log overlaps another vehicle; None where none does
    num_subject_overlaps: Int[Array, ""] | None
    num_lost: Int[Array, ""]  # vehicles that could not enter because the arrays were full, summed over decisions
    num_lane_changes: Int[Array, " reason"]  # lane changes by reason; see `lane_change.base.Reason`
    manoeuvres: Manoeuvres | None = None  # changes under way; None where they take no time
    # numbers of the arrivals at the front of each queue, -1 behind the last; None where nobody overtakes in a queue
    waiting: Int[Array, "entrance slot"] | None = None


def empty_vehicles(num_rows: int, capacity: int) -> VehicleArrays:
    """Return arrays that hold one head per row and no vehicle."""
    entry = jnp.arange(capacity, dtype=jnp.int32)
    is_head = entry < num_rows

    def filled(value: float) -> Float[Array, " vehicle"]:
        return jnp.full((capacity,), value, jnp.float32)

    def whole(value: int) -> Int[Array, " vehicle"]:
        return jnp.full((capacity,), value, jnp.int32)

    return VehicleArrays(
        position_m=jnp.where(is_head, jnp.inf, -jnp.inf).astype(jnp.float32),
        speed_mps=filled(0.0),
        acceleration_mps2=filled(0.0),
        row=jnp.minimum(entry, num_rows),
        vehicle_class=jnp.where(is_head, HEAD, EMPTY).astype(jnp.int32),
        destination=whole(0),
        identity=whole(0),
        track=whole(UNSEEN),
        speed_factor=filled(1.0),
        gain_left_memory=filled(0.0),
        gain_right_memory=filled(0.0),
        keep_right_memory=filled(0.0),
        look_ahead_speed_mps=filled(0.0),
        own_advice_mps2=filled(jnp.inf),
        asked_advice_mps2=filled(jnp.inf),
        speed_limit_mps=filled(1.0),
        slow_position_m=filled(jnp.inf),
        slow_limit_mps=filled(1.0),
        stop_position_m=filled(jnp.inf),
    )
