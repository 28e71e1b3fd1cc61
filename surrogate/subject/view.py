"""What a planner knows at one instant: the subject vehicle, and in each of three lanes its neighbours and its route.

The view is made of the vehicle arrays and the road, whichever simulator filled the arrays; so a planner decides from
the same numbers in the surrogate and in SUMO.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.road.neighbours import entry_ahead, neighbour_at
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.vehicle_class import VehicleClass, select_by_class
from surrogate.xla.gather import take

RIGHT_LANE, OWN_LANE, LEFT_LANE = 0, 1, 2

Lane = Float[Array, " lane"]


class LaneView(eqx.Module):
    """The lane on the right, the own lane and the lane on the left."""

    is_open: Bool[Array, " lane"]  # whether the lane exists here
    row: Int[Array, " lane"]  # its row; any valid row where there is none
    entry_ahead: Int[Array, " lane"]  # entry of the leader in the vehicle arrays, or of the row's head
    leader_gap_m: Lane  # leader's rear bumper minus own front bumper; inf where none is in sight
    leader_speed_mps: Lane
    leader_acceleration_mps2: Lane  # its last acceleration
    follower_gap_m: Lane  # own rear bumper minus the follower's front bumper; inf where none is in sight
    follower_speed_mps: Lane
    desired_speed_mps: Lane  # speed that the subject vehicle wants there
    stop_m: Lane  # distance to where it would have to stand if it stayed there; inf where the route goes on
    num_changes: Lane  # lane changes from there to the lane that the route needs


class SubjectView(eqx.Module):
    """The subject vehicle and the lanes around it."""

    exists: Bool[Array, ""]  # whether it is on the road; everything else is meaningless where it is not
    entry: Int[Array, ""]  # its entry in the vehicle arrays
    speed_mps: Float[Array, ""]
    acceleration_mps2: Float[Array, ""]  # its acceleration in the last step
    length_m: Float[Array, ""]
    lanes: LaneView  # the three lanes


def look_around(
    vehicles: VehicleArrays,
    head: Int[Array, " row_plus_one"],
    road: Road,
    classes: tuple[VehicleClass, ...],
    subject_class: int,
    ahead_m: Float[Array, ""],
    behind_m: Float[Array, ""],
) -> SubjectView:
    """View of the subject vehicle's planner.

    Args:
        vehicles: all vehicles, or those around the subject vehicle.
        head: entry at which each row begins.
        road: geometry.
        classes: vehicle classes.
        subject_class: class of the subject vehicle.
        ahead_m: how far ahead it sees, front bumper to front bumper.
        behind_m: how far behind.
    """
    is_subject = vehicles.vehicle_class == subject_class
    entry = jnp.argmax(is_subject).astype(jnp.int32)
    exists = jnp.any(is_subject)
    here_m = jnp.where(exists, take(vehicles.position_m, entry), 0.0)
    own_row = jnp.minimum(take(vehicles.row, entry), road.num_rows - 1)
    segment = road.segment_at(here_m)

    def at(table: Array, row: Array) -> Array:
        return take(table.reshape(-1), row * road.num_segments + segment)

    beside = jnp.stack([at(road.right_row, own_row), own_row, at(road.left_row, own_row)])
    is_open = beside >= 0
    row = jnp.maximum(beside, 0)
    ahead = entry_ahead(jnp.broadcast_to(here_m, row.shape), row, vehicles.position_m, head)
    leader = neighbour_at(ahead, row, vehicles)
    is_own = jnp.arange(3) == OWN_LANE
    behind = jnp.minimum(ahead + jnp.where(is_own, 2, 1), vehicles.row.shape[0] - 1)
    follower = neighbour_at(behind, row, vehicles)
    lengths = [c.length_m for c in classes]
    own = classes[subject_class]
    sees_leader = leader.exists & (leader.position_m - here_m <= ahead_m)
    sees_follower = follower.exists & (here_m - follower.position_m <= behind_m)
    leader_gap_m = leader.position_m - select_by_class(lengths, leader.vehicle_class) - here_m
    route = take(vehicles.destination, entry) * road.num_rows  # route tables are one (row, segment) table after another
    factor = take(vehicles.speed_factor, entry)
    return SubjectView(
        exists=exists,
        entry=entry,
        speed_mps=take(vehicles.speed_mps, entry),
        acceleration_mps2=take(vehicles.acceleration_mps2, entry),
        length_m=own.length_m,
        lanes=LaneView(
            is_open=is_open,
            row=row,
            entry_ahead=ahead,
            leader_gap_m=jnp.where(sees_leader, leader_gap_m, jnp.inf),
            leader_speed_mps=jnp.where(sees_leader, leader.speed_mps, 0.0),
            leader_acceleration_mps2=jnp.where(sees_leader, leader.acceleration_mps2, 0.0),
            follower_gap_m=jnp.where(sees_follower, here_m - own.length_m - follower.position_m, jnp.inf),
            follower_speed_mps=jnp.where(sees_follower, follower.speed_mps, 0.0),
            desired_speed_mps=jnp.minimum(factor * at(road.speed_limit_mps, row), own.max_speed_mps),
            stop_m=at(road.stop_position_m, route + row) - here_m,
            num_changes=jnp.abs(at(road.best_lane_offset, route + row)).astype(jnp.float32),
        ),
    )
