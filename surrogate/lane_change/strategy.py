"""What the route demands of a vehicle: change now, stay, or either as it likes."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.vehicle.lane_change_model import Side

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

LOOK_FORWARD_S = 10.0
LOOK_AHEAD_MEMORY = 0.9  # per second
TURN_LANE_DISTANCE_M = 200.0


class Strategy(eqx.Module):
    """What the route says of changing to one side."""

    must_change: Flag  # the route needs it, and soon
    must_stay: Flag  # it would lead away from the route with too little room to come back
    to_best: Flag  # it leads towards the lane that the route needs, or both lanes serve the route
    serves_route: Flag  # it leads towards that lane, which is not the present one
    num_lanes_back: Int[Array, " vehicle"]  # lane changes to the best lane from here, with sign
    look_ahead_m: Value  # distance within which the route's needs count


def decayed_look_ahead_speed_mps(ego: Ego, look_ahead_speed_mps: Value, interval_s: float) -> Value:
    """Return the speed that sets the look-ahead distance: it grows at once and decays slowly."""
    keep = 1.0 - (1.0 - LOOK_AHEAD_MEMORY) * interval_s
    return jnp.maximum(ego.speed_mps, keep * look_ahead_speed_mps + (1.0 - keep) * ego.speed_mps)


def strategy(
    model: Lc2013, ego: Ego, side: Side, look_ahead_speed_mps: Value, following: Following, is_right: bool
) -> Strategy:
    """Demands of the route on a change to one side.

    Args:
        model: parameters of each vehicle.
        ego: each vehicle and its own lane.
        side: the lane on this side.
        look_ahead_speed_mps: the slowly decaying speed, already updated.
        following: car-following models.
        is_right: which side this is.

    Source: `MSLCM_LC2013::_wantsChange`, its first part.
    """
    direction = -1 if is_right else 1
    look_ahead_m = look_ahead_speed_mps * LOOK_FORWARD_S * model.strategic
    look_ahead_m = look_ahead_m * (1.0 if is_right else model.look_ahead_left)
    look_ahead_m = look_ahead_m + 2.0 * (ego.length_m + following.jam_gap_m)
    offset = ego.need.best_lane_offset
    either = (offset == 0) & (side.need.best_lane_offset == 0)
    best = jnp.where(either, direction, offset)
    to_best = best * direction > 0
    occupied_m = jnp.where(to_best, side.need.occupied_m, ego.need.occupied_m)
    usable_m = ego.need.remaining_m - occupied_m
    most_occupied_m = jnp.maximum(side.need.occupied_m, ego.need.occupied_m)
    side_left_m = jnp.maximum(0.0, side.need.remaining_m - most_occupied_m)
    must_change = to_best & ~either & is_shorter(usable_m, best, look_ahead_m)
    must_stay = (
        (~to_best & is_shorter(side_left_m, jnp.abs(best) + 2, look_ahead_m))
        | ((best == 0) & (2.0 * side_left_m < look_ahead_m))
        | ((best == 0) & side.leads_elsewhere & (side.need.from_edge_m < TURN_LANE_DISTANCE_M))
    )
    return Strategy(
        must_change=side.is_open & must_change,
        must_stay=~must_change & must_stay,
        to_best=to_best,
        serves_route=to_best & ~either,
        num_lanes_back=best,
        look_ahead_m=look_ahead_m,
    )


def is_shorter(distance_m: Value, num_lanes: Int[Array, " vehicle"], look_ahead_m: Value) -> Flag:
    """Whether a distance per lane to cross is less than the look-ahead.

    Source: `MSLCM_LC2013::currentDistDisallows`.
    """
    return distance_m < look_ahead_m * jnp.abs(num_lanes).astype(distance_m.dtype)
