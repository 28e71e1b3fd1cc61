"""One lane-change decision of all vehicles: look right, look left, negotiate, and settle who changes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.compaction import first_true
from surrogate.lane_change.base import LEFT, RIGHT, STAY, LaneChangeDecision, Side
from surrogate.lane_change.cooperation import NO_ADVICE, requests
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following, blocked
from surrogate.lane_change.lc2013 import Lc2013, Memory
from surrogate.lane_change.mobil import Mobil, mobil_wishes, route_parameters
from surrogate.lane_change.motives import wish
from surrogate.lane_change.strategy import decayed_look_ahead_speed_mps, strategy
from surrogate.lane_change.surroundings import Place, desired_speed_mps, ego_of, following_of, side_of, sight_m
from surrogate.materialise import materialise
from surrogate.neighbours import take
from surrogate.vehicle_class import VehicleClass, select_record

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

URGENT_SHARE = 8  # at most one in so many entries negotiates in one decision; there are fewer in any traffic that moves
FEWEST_URGENT = 24


def decide(place: Place, classes: tuple[VehicleClass, ...], interval_s: float, step_s: float) -> LaneChangeDecision:
    """Return what every vehicle does about its lane.

    Args:
        place: the vehicles and where they are.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
    """
    vehicles = place.vehicles
    following = following_of(vehicles.vehicle_class, classes)
    desired_mps = materialise(desired_speed_mps(vehicles, classes))
    model = select_record([_lc2013(c) for c in classes], vehicles.vehicle_class)
    look_m = materialise(sight_m(vehicles, following, step_s))
    ego = ego_of(place, following, desired_mps, look_m)
    right = side_of(place, following, desired_mps, look_m, True)
    left = side_of(place, following, desired_mps, look_m, False)
    ego, right, left = materialise((ego, right, left))
    right_gaps = materialise(blocked(ego, right, following, model.assertive, step_s))
    left_gaps = materialise(blocked(ego, left, following, model.assertive, step_s))

    # SUMO lets the look-ahead speed decay once for each side that there is
    after_right = decayed_look_ahead_speed_mps(ego, vehicles.look_ahead_speed_mps, interval_s)
    after_right = jnp.where(right.is_open, after_right, vehicles.look_ahead_speed_mps)
    after_left = decayed_look_ahead_speed_mps(ego, after_right, interval_s)
    after_left = jnp.where(left.is_open, after_left, after_right)
    route_right = materialise(strategy(model, ego, right, after_right, following, True))
    route_left = materialise(strategy(model, ego, left, after_left, following, False))

    asked = _negotiate(
        route_right.must_change, route_left.must_change, ego, (right, left), (right_gaps, left_gaps),
        vehicles.vehicle_class, after_right, classes, -following.max_deceleration_mps2 - 1e-3, interval_s, step_s,
    )  # fmt: skip
    memory = Memory(
        gain_left=vehicles.gain_left_memory,
        gain_right=vehicles.gain_right_memory,
        keep_right=vehicles.keep_right_memory,
    )
    to_right = wish(model, ego, right, route_right, memory, following, asked.help_right, True, interval_s, step_s)
    to_left = wish(model, ego, left, route_left, memory, following, asked.help_left, False, interval_s, step_s)
    to_right, to_left = materialise((to_right, to_left))
    if any(isinstance(c.lane_change, Mobil) for c in classes):
        to_right, to_left = mobil_wishes(
            (to_right, to_left), ego, (right, left), (route_right, route_left), (right_gaps, left_gaps),
            vehicles, desired_mps, following, classes, step_s,
        )  # fmt: skip
    goes_right = to_right.change & ~right_gaps.at_all
    goes_left = to_left.change & ~left_gaps.at_all & ~goes_right & ~(to_right.urgent & to_left.urgent)
    goes_right, goes_left = materialise((goes_right, goes_left))
    moves = goes_right | goes_left
    direction = jnp.where(goes_right, RIGHT, jnp.where(goes_left, LEFT, STAY)).astype(jnp.int32)
    if interval_s > step_s:  # there and back between two decisions: nothing is left of it but empty memories
        returns = goes_left & to_left.reverts & ~_is_held_by_leader(ego, following, model.assertive, step_s)
        direction = jnp.where(returns, STAY, direction)
    is_harder = to_left.advice_mps2 < -following.max_deceleration_mps2 - 1e-3
    own_advice = jnp.minimum(asked.own_advice_mps2, jnp.where(is_harder, NO_ADVICE, to_left.advice_mps2))
    return LaneChangeDecision(
        direction=direction,
        reason=jnp.where(goes_right, to_right.reason, to_left.reason).astype(jnp.int32),
        entry_ahead=jnp.where(goes_right, right.leader_entry, left.leader_entry),
        target_row=jnp.where(goes_right, right.row, left.row),
        own_advice_mps2=own_advice,
        asked_advice_mps2=asked.asked_advice_mps2,
        gain_left_memory=jnp.where(moves, 0.0, to_left.gain),
        gain_right_memory=jnp.where(moves, 0.0, to_right.gain),
        keep_right_memory=jnp.where(moves, 0.0, to_right.keep_right),
        look_ahead_speed_mps=jnp.where(moves, 0.0, after_left),
    )


def _is_held_by_leader(ego: Ego, following: Following, assertive: Value, step_s: float) -> Flag:
    """Return whether the leader in the own lane is too near to change into that lane behind him."""
    deceleration = following.of(ego.leader_class).field("max_deceleration_mps2")
    secure_m = following.own.secure_gap_m(ego.speed_mps, ego.leader_speed_mps, deceleration, step_s)
    return ego.leader_exists & (ego.leader_gap_m < secure_m / assertive)


class _Asked(eqx.Module):
    """What the vehicles that must change have asked for.

    Attributes:
        own_advice_mps2: acceleration that such a vehicle asks of itself; inf where none.
        asked_advice_mps2: lowest acceleration asked of each vehicle by others; inf where none.
        help_right: vehicles asked to make room by one who must change to the right.
        help_left: the same to the left.
    """

    own_advice_mps2: Value
    asked_advice_mps2: Value
    help_right: Flag
    help_left: Flag


def _negotiate(
    must_right: Flag,
    must_left: Flag,
    ego: Ego,
    sides: tuple[Side, Side],
    gaps: tuple[Blocked, Blocked],
    vehicle_class: Int[Array, " vehicle"],
    look_ahead_speed_mps: Value,
    classes: tuple[VehicleClass, ...],
    hardest_mps2: Value,
    interval_s: float,
    step_s: float,
) -> _Asked:
    """Let those who must change ask; they are few, so they are gathered first."""
    num_entries = must_right.shape[0]
    chosen, is_chosen = first_true(must_right | must_left, max(FEWEST_URGENT, num_entries // URGENT_SHARE))
    is_right = take(must_right, chosen)

    def pick(leaf: Array) -> Array:
        return take(leaf, chosen)

    def pick_side(right: Array, left: Array) -> Array:
        return jnp.where(is_right, take(right, chosen), take(left, chosen))

    side = jax.tree.map(pick_side, *sides)
    request = requests(
        jax.tree.map(pick, ego),
        side,
        jax.tree.map(pick_side, *gaps),
        following_of(pick(vehicle_class), classes),
        pick(look_ahead_speed_mps),
        is_right,
        interval_s,
        step_s,
    )
    nothing = jnp.full((num_entries,), NO_ADVICE, jnp.float32)
    own = jnp.where(is_chosen & (request.own_advice_mps2 >= pick(hardest_mps2)), request.own_advice_mps2, NO_ADVICE)
    asked = nothing
    for exists, receiver, advice in (
        (side.leader_exists, side.leader_entry, request.leader_advice_mps2),
        (side.follower_exists, side.follower_entry, request.follower_advice_mps2),
    ):
        # advice harder than the receiver would brake is ignored, as in SUMO
        counts = is_chosen & exists & (advice >= take(hardest_mps2, receiver))
        asked = asked.at[receiver].min(jnp.where(counts, advice, NO_ADVICE), mode="promise_in_bounds")
    asks = is_chosen & request.asks_follower & side.follower_exists
    nobody = jnp.zeros((num_entries,), bool)
    return _Asked(
        own_advice_mps2=nothing.at[chosen].min(own, mode="promise_in_bounds"),
        asked_advice_mps2=asked,
        help_right=nobody.at[side.follower_entry].max(asks & is_right, mode="promise_in_bounds"),
        help_left=nobody.at[side.follower_entry].max(asks & ~is_right, mode="promise_in_bounds"),
    )


def _lc2013(vehicle_class: VehicleClass) -> Lc2013:
    model = vehicle_class.lane_change
    if isinstance(model, Mobil):
        return route_parameters(model)
    if not isinstance(model, Lc2013):
        raise TypeError(f"Expected the lane-change model Lc2013 or Mobil for every class, got {type(model).__name__}.")
    return model
