"""Two who must change past one another before their lanes end: the one behind leaves room for the one ahead.

Source: `MSLCM_LC2013::saveBlockerLength` and the part of `_patchSpeed` that keeps the room ("letting vehicles merge in
at the end of the lane in case of counter-lane change"). Without it both stand at the end beside one another, and so do
all behind them.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from surrogate.car_following.safe_speed import brake_gap_m
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.lane_change_model import Side
from surrogate.vehicle.vehicle_class import CarFollowingMix

Value = Float[Array, " request"]
Flag = Bool[Array, " request"]

CLEARANCE_M = 1.0  # SUMO's MAGIC_offset
NO_ADVICE = jnp.inf


def leave_room(
    ego: Ego, side: Side, leader_comes_over: Flag, leader_remaining_m: Value, following: Following, step_s: float
) -> tuple[Value, Value]:
    """Accelerations that keep room at the end of the lanes: of those who must change, and of their leaders there.

    Args:
        ego: each of these vehicles and its own lane.
        side: the lane that it must change to.
        leader_comes_over: whether the leader there must change into the lane of the vehicle.
        leader_remaining_m: how far the leader's route goes on in that lane.
        following: car-following models.
        step_s: length of a time step.

    Returns:
        Both; inf where there is nothing to keep.
    """
    leaders = following.of(side.leader_class)
    leader_room_m = following.length_m(side.leader_class) + leaders.field("jam_gap_m")
    own_room_m = ego.length_m + following.jam_gap_m
    braking_m = brake_gap_m(ego.speed_mps, following.max_deceleration_mps2, following.time_gap_s, step_s)
    comes = leader_comes_over & side.leader_exists
    has_room = leader_room_m <= ego.need.remaining_m - braking_m
    own_place_m = ego.need.remaining_m - leader_room_m - CLEARANCE_M - following.jam_gap_m
    leader_place_m = leader_remaining_m - own_room_m - CLEARANCE_M - leaders.field("jam_gap_m")
    own = _stop_at(
        own_place_m, following.own, ego.speed_mps, ego.acceleration_mps2, ego.max_speed_mps,
        following.max_deceleration_mps2, step_s,
    )  # fmt: skip
    leader = _stop_at(
        leader_place_m, leaders, side.leader_speed_mps, side.leader_acceleration_mps2, side.leader_max_speed_mps,
        leaders.field("max_deceleration_mps2"), step_s,
    )  # fmt: skip
    return (
        jnp.where(comes & has_room & (own_place_m > 0.0), own, NO_ADVICE),
        jnp.where(comes & ~has_room & (leader_place_m > 0.0), leader, NO_ADVICE),
    )


def _stop_at(
    place_m: Value,
    models: CarFollowingMix,
    speed_mps: Value,
    acceleration_mps2: Value,
    max_speed_mps: Value,
    max_deceleration_mps2: Value,
    step_s: float,
) -> Value:
    """Acceleration towards standing some metres ahead; no harder than a vehicle brakes."""
    place_m = jnp.maximum(place_m, 0.0)
    situation = FollowingSituation(
        speed_mps=speed_mps,
        gap_m=place_m,
        leader_speed_mps=jnp.zeros_like(speed_mps),
        leader_acceleration_mps2=jnp.zeros_like(speed_mps),
        acceleration_mps2=acceleration_mps2,
        desired_speed_mps=max_speed_mps,
        uniform=jnp.full_like(speed_mps, 0.5),
    )
    return jnp.maximum(models.stop_acceleration(situation, place_m, step_s), -max_deceleration_mps2)
