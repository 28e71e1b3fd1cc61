"""Those who creep in the target lane behind a vehicle that cannot change keep clear of it, asked by it or not.

Source: `MSLCM_LC2013::slowDownForBlocked`. SUMO has everybody on the edge look at the nearest such vehicle ahead and at
the first of all; here the two behind it do, for whoever is further back follows one of these more closely.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.lane_change.surroundings import Wanted
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.road.neighbours import Neighbour
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.xla.gather import take

Value = Float[Array, " request"]

CREEPING_MARGIN_M = 0.1


def keep_clear_on_edge_mps2(
    part: VehiclesOnRoad, ego: Ego, other: Neighbour, wanted: Wanted, following: Following, step_s: float
) -> Value:
    """Acceleration of who is behind each vehicle in the target lane, on the same edge; inf where none.

    Args:
        part: the vehicles that cannot change.
        ego: what they know of themselves.
        other: who is behind each of them in the target lane.
        wanted: speeds that vehicles want.
        following: car-following models.
        step_s: length of a time step.
    """
    other_jam_m = following.of(other.vehicle_class).field("jam_gap_m")
    gap_m = part.vehicles.position_m - ego.length_m - other.position_m - other_jam_m
    desired_mps = take(wanted.everybodys_mps, other.entry)
    is_beside = take(part.everybodys_edge_start_m, other.entry) == part.edge_start_m
    return jnp.where(is_beside, keep_clear_mps2(ego, other, gap_m, desired_mps, following, step_s), NO_ADVICE)


def keep_clear_mps2(
    ego: Ego,
    other: Neighbour,
    gap_m: Value,
    desired_mps: Value,
    following: Following,
    step_s: float,
) -> Value:
    """Acceleration of those who creep in the target lane behind a vehicle that cannot change; inf for all others.

    Args:
        ego: the vehicles that cannot change.
        other: who is behind each of them in the target lane.
        gap_m: gap to that one less its jam gap.
        desired_mps: speed that it wants.
        following: car-following models.
        step_s: length of a time step.
    """
    models = following.of(other.vehicle_class)
    situation = FollowingSituation(
        speed_mps=other.speed_mps,
        gap_m=gap_m - CREEPING_MARGIN_M + models.field("jam_gap_m"),
        leader_speed_mps=ego.speed_mps,
        leader_acceleration_mps2=ego.acceleration_mps2,
        acceleration_mps2=other.acceleration_mps2,
        desired_speed_mps=desired_mps,
        uniform=jnp.full_like(ego.speed_mps, 0.5),
    )
    creeps = other.exists & (other.speed_mps < models.field("max_deceleration_mps2")) & (gap_m > CREEPING_MARGIN_M)
    advice = (models.follow_speed_mps(situation, step_s) - other.speed_mps) / step_s
    return jnp.where(creeps, advice, NO_ADVICE)
