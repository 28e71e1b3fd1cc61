"""One lane-change decision of all vehicles: look right, look left, negotiate, and settle who changes."""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.lane_change.base import LEFT, RIGHT, STAY, LaneChangeDecision, Side
from surrogate.lane_change.cooperation import NO_ADVICE, requests
from surrogate.lane_change.gap_acceptance import Blocked, blocked
from surrogate.lane_change.lc2013 import Lc2013, Memory, Wish, wish
from surrogate.lane_change.surroundings import Place, desired_speed_mps, ego_of, following_of, side_of, sight_m
from surrogate.vehicle_class import VehicleClass, select_record

Value = Float[Array, " vehicle"]


def decide(place: Place, classes: tuple[VehicleClass, ...], interval_s: float, step_s: float) -> LaneChangeDecision:
    """Return what every vehicle does about its lane.

    Args:
        place: the vehicles and where they are.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
    """
    vehicles = place.vehicles
    following = following_of(vehicles, classes)
    desired_mps = desired_speed_mps(vehicles, classes)
    model = select_record([_lc2013(c) for c in classes], vehicles.vehicle_class)
    look_m = sight_m(vehicles, following, step_s)
    ego = ego_of(place, following, desired_mps, look_m)
    sides = {
        direction: side_of(place, following, desired_mps, look_m, direction == RIGHT) for direction in (RIGHT, LEFT)
    }
    gaps = {direction: blocked(ego, side, following, model.assertive, step_s) for direction, side in sides.items()}
    memory = Memory(
        gain_left=vehicles.gain_left_memory,
        gain_right=vehicles.gain_right_memory,
        keep_right=vehicles.keep_right_memory,
        look_ahead_speed_mps=vehicles.look_ahead_speed_mps,
    )

    # first round: who must change for his route, and what he asks of his neighbours
    asks = {}
    nobody = jnp.zeros_like(vehicles.is_vehicle)
    for direction, side in sides.items():
        is_right = direction == RIGHT
        must = wish(model, ego, side, memory, following, nobody, is_right, interval_s, step_s).is_strategic
        request = requests(ego, side, gaps[direction], following, memory.look_ahead_speed_mps, is_right, step_s)
        asks[direction] = (must & vehicles.is_vehicle, request)
    own_advice = asked_advice = jnp.full_like(vehicles.speed_mps, NO_ADVICE)
    asked = {}
    hardest = -following.max_deceleration_mps2 - 1e-3
    for direction, (must, request) in asks.items():
        side = sides[direction]
        to_leader = jnp.where(must & side.leader_exists, request.leader_advice_mps2, NO_ADVICE)
        to_follower = jnp.where(must & side.follower_exists, request.follower_advice_mps2, NO_ADVICE)
        asked_advice = jnp.minimum(asked_advice, _deliver(to_leader, side.leader_entry, hardest))
        asked_advice = jnp.minimum(asked_advice, _deliver(to_follower, side.follower_entry, hardest))
        own = jnp.where(must & (request.own_advice_mps2 >= hardest), request.own_advice_mps2, NO_ADVICE)
        own_advice = jnp.minimum(own_advice, own)
        tells = must & request.asks_follower & side.follower_exists
        asked[direction] = _mark(tells, side.follower_entry)

    # second round: what everybody wants, right before left
    right = wish(model, ego, sides[RIGHT], memory, following, asked[RIGHT], True, interval_s, step_s)
    left = wish(model, ego, sides[LEFT], right.memory, following, asked[LEFT], False, interval_s, step_s)
    for side_wish in (right, left):
        advice = side_wish.advice_mps2
        own_advice = jnp.where(advice >= hardest, jnp.minimum(own_advice, advice), own_advice)
    goes_right = right.change & ~gaps[RIGHT].at_all & vehicles.is_vehicle
    goes_left = left.change & ~gaps[LEFT].at_all & ~goes_right & vehicles.is_vehicle
    goes_left = goes_left & ~(right.urgent & left.urgent)
    return _settle(goes_right, goes_left, right, left, sides, (own_advice, asked_advice))


def _settle(
    goes_right: Array,
    goes_left: Array,
    right: Wish,
    left: Wish,
    sides: dict[int, Side],
    advice: tuple[Value, Value],
) -> LaneChangeDecision:
    direction = jnp.where(goes_right, RIGHT, jnp.where(goes_left, LEFT, STAY)).astype(jnp.int32)
    moves = direction != STAY
    zero = jnp.zeros_like(advice[0])
    return LaneChangeDecision(
        direction=direction,
        reason=jnp.where(goes_right, right.reason, left.reason).astype(jnp.int32),
        entry_ahead=jnp.where(goes_right, sides[RIGHT].leader_entry, sides[LEFT].leader_entry),
        target_row=jnp.where(goes_right, sides[RIGHT].row, sides[LEFT].row),
        own_advice_mps2=advice[0],
        asked_advice_mps2=advice[1],
        gain_left_memory=jnp.where(moves, zero, left.memory.gain_left),
        gain_right_memory=jnp.where(moves, zero, left.memory.gain_right),
        keep_right_memory=jnp.where(moves, zero, left.memory.keep_right),
        look_ahead_speed_mps=jnp.where(moves, zero, left.memory.look_ahead_speed_mps),
    )


def _deliver(advice_mps2: Value, receiver: Int[Array, " vehicle"], hardest_mps2: Value) -> Value:
    """Return for each vehicle the lowest advice sent to it; one harder than it would brake is ignored, as in SUMO."""
    bound = hardest_mps2.at[receiver].get(mode="promise_in_bounds")
    advice_mps2 = jnp.where(advice_mps2 >= bound, advice_mps2, NO_ADVICE)
    nothing = jnp.full_like(advice_mps2, NO_ADVICE)
    return nothing.at[receiver].min(advice_mps2, mode="promise_in_bounds")


def _mark(tells: Array, receiver: Int[Array, " vehicle"]) -> Array:
    """Return which vehicles are told something."""
    return jnp.zeros_like(tells).at[receiver].max(tells, mode="promise_in_bounds")


def _lc2013(vehicle_class: VehicleClass) -> Lc2013:
    model = vehicle_class.lane_change
    if not isinstance(model, Lc2013):
        raise TypeError(f"Expected the lane-change model Lc2013 for every class, got {type(model).__name__}.")
    return model


__all__ = ["Blocked", "decide"]
