"""One lane-change decision of all vehicles: look right, look left, negotiate, and settle who changes."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.compaction import first_true
from surrogate.lane_change.base import LEFT, RIGHT, STAY, LaneChangeDecision, Side
from surrogate.lane_change.cooperation import NO_ADVICE, requests
from surrogate.lane_change.gap_acceptance import Ego, Following, blocked
from surrogate.lane_change.lc2013 import Lc2013, Memory
from surrogate.lane_change.mobil import Mobil, OldFollower, mobil_wishes, old_follower_of, route_parameters
from surrogate.lane_change.motives import wish
from surrogate.lane_change.strategy import Strategy, decayed_look_ahead_speed_mps, strategy
from surrogate.lane_change.surroundings import (
    Place,
    desired_speed_mps,
    ego_of,
    entry_beside,
    following_of,
    side_of,
    sight_m,
)
from surrogate.materialise import materialise
from surrogate.neighbours import take
from surrogate.tiles import Chosen, Tile, all_tiles, over_tiles
from surrogate.traffic_state import VehicleArrays
from surrogate.vehicle_class import VehicleClass, select_record

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

URGENT_SHARE = 8  # at most one in so many entries negotiates in one decision; there are fewer in any traffic that moves
FEWEST_URGENT = 24


def decide(
    place: Place,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
    num_tiles: Int[Array, ""] | int | None = None,
) -> LaneChangeDecision:
    """Return what every vehicle does about its lane.

    Args:
        place: the vehicles and where they are.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
        num_tiles: tiles that hold vehicles, see `surrogate.tiles`; all unless given.
    """
    everybody = place.everybody
    num_entries = everybody.row.shape[0]
    num_tiles = all_tiles(num_entries) if num_tiles is None else num_tiles
    desired_mps = materialise(desired_speed_mps(everybody, classes))

    def who_must_change(tile: Tile) -> _Duty:
        part = place.part(tile)
        entries = materialise((entry_beside(part, True), entry_beside(part, False)))
        around = _look_around(part, tile(desired_mps), desired_mps, entries, classes, interval_s, step_s)
        return _Duty(entries, around.route_right.must_change, around.route_left.must_change)

    duty = over_tiles(who_must_change, num_tiles, num_entries)
    asked = _negotiate(place, duty, desired_mps, classes, interval_s, step_s)
    old_follower = None
    if any(isinstance(c.lane_change, Mobil) for c in classes):
        old_follower = old_follower_of(everybody, following_of(everybody.vehicle_class, classes), desired_mps)

    def settle(tile: Tile) -> LaneChangeDecision:
        part = place.part(tile)
        around = materialise(
            _look_around(part, tile(desired_mps), desired_mps, tile(duty.entries), classes, interval_s, step_s)
        )
        return _settle(part, around, tile(asked), tile(old_follower), classes, interval_s, step_s)

    return over_tiles(settle, num_tiles, num_entries)


class _Duty(eqx.Module):
    """Who must change lane for his route, and who is ahead of him on each side.

    Attributes:
        entries: entry ahead in the row on the right, and on the left.
        must_right: whether the route needs a change to the right.
        must_left: whether it needs one to the left.
    """

    entries: tuple[Int[Array, " vehicle"], Int[Array, " vehicle"]]
    must_right: Flag
    must_left: Flag


class _Surroundings(eqx.Module):
    """What vehicles see before they decide.

    Attributes:
        ego: each vehicle and its own lane.
        right: the lane on its right.
        left: the lane on its left.
        after_right: look-ahead speed once the right side has been looked at.
        after_left: look-ahead speed once both have.
        route_right: what the route says of the right side.
        route_left: what it says of the left side.
    """

    ego: Ego
    right: Side
    left: Side
    after_right: Value
    after_left: Value
    route_right: Strategy
    route_left: Strategy


def _look_around(
    part: Place,
    desired_mps: Value,
    everybodys_desired_mps: Value,
    entries: tuple[Int[Array, " vehicle"], Int[Array, " vehicle"]],
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> _Surroundings:
    """Return what vehicles see; who is ahead of them on the right and on the left is known already."""
    vehicles = part.vehicles
    following = following_of(vehicles.vehicle_class, classes)
    model = _lc2013_of(vehicles, classes)
    look_m = sight_m(vehicles, following, step_s)
    ego = ego_of(part, following, desired_mps, everybodys_desired_mps, look_m)
    right = side_of(part, following, everybodys_desired_mps, look_m, entries[0], True)
    left = side_of(part, following, everybodys_desired_mps, look_m, entries[1], False)
    # SUMO lets the look-ahead speed decay once for each side that there is
    before = vehicles.look_ahead_speed_mps
    after_right = jnp.where(right.is_open, decayed_look_ahead_speed_mps(ego, before, interval_s), before)
    after_left = decayed_look_ahead_speed_mps(ego, after_right, interval_s)
    after_left = jnp.where(left.is_open, after_left, after_right)
    return _Surroundings(
        ego=ego,
        right=right,
        left=left,
        after_right=after_right,
        after_left=after_left,
        route_right=strategy(model, ego, right, after_right, following, True),
        route_left=strategy(model, ego, left, after_left, following, False),
    )


def _settle(
    part: Place,
    around: _Surroundings,
    asked: "_Asked",
    old_follower: OldFollower | None,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> LaneChangeDecision:
    """Return what vehicles do about their lanes, now that they know what others ask of them."""
    vehicles = part.vehicles
    following = following_of(vehicles.vehicle_class, classes)
    model = _lc2013_of(vehicles, classes)
    ego, right, left = around.ego, around.right, around.left
    route_right, route_left = around.route_right, around.route_left
    right_gaps = materialise(blocked(ego, right, following, model.assertive, step_s))
    left_gaps = materialise(blocked(ego, left, following, model.assertive, step_s))
    memory = Memory(
        gain_left=vehicles.gain_left_memory,
        gain_right=vehicles.gain_right_memory,
        keep_right=vehicles.keep_right_memory,
    )
    to_right = wish(model, ego, right, route_right, memory, following, asked.help_right, True, interval_s, step_s)
    to_left = wish(model, ego, left, route_left, memory, following, asked.help_left, False, interval_s, step_s)
    to_right, to_left = materialise((to_right, to_left))
    if old_follower is not None:
        to_right, to_left = mobil_wishes(
            (to_right, to_left), ego, (right, left), (route_right, route_left), (right_gaps, left_gaps),
            vehicles.vehicle_class, old_follower, following, classes, step_s,
        )  # fmt: skip
    goes_right = to_right.change & ~right_gaps.at_all
    goes_left = to_left.change & ~left_gaps.at_all & ~goes_right & ~(to_right.urgent & to_left.urgent)
    goes_right, goes_left = materialise((goes_right, goes_left))
    moves = goes_right | goes_left
    direction = jnp.where(goes_right, RIGHT, jnp.where(goes_left, LEFT, STAY)).astype(jnp.int32)
    if interval_s > step_s:  # there and back between two decisions: nothing is left of it but empty memories
        returns = goes_left & to_left.reverts & ~_is_held_by_leader(ego, following, model.assertive, step_s)
        direction = jnp.where(returns, STAY, direction)
    is_harder = to_left.advice_mps2 < _hardest_mps2(following)
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
        look_ahead_speed_mps=jnp.where(moves, 0.0, around.after_left),
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
    place: Place,
    duty: _Duty,
    desired_mps: Value,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> _Asked:
    """Let those who must change ask; they are few, so they are picked first."""
    everybody = place.everybody
    num_entries = everybody.row.shape[0]
    number = max(FEWEST_URGENT, num_entries // URGENT_SHARE)
    entry, is_chosen = first_true(duty.must_right | duty.must_left, number)
    chosen = Chosen(entry)
    part = place.part(chosen)
    following = following_of(part.vehicles.vehicle_class, classes)
    around = _look_around(part, chosen(desired_mps), desired_mps, chosen(duty.entries), classes, interval_s, step_s)
    is_right = chosen(duty.must_right)
    side = jax.tree.map(lambda right, left: jnp.where(is_right, right, left), around.right, around.left)
    ego, side = materialise((around.ego, side))
    gaps = blocked(ego, side, following, _lc2013_of(part.vehicles, classes).assertive, step_s)
    request = requests(ego, side, gaps, following, around.after_right, is_right, interval_s, step_s)

    nothing = jnp.full((num_entries,), NO_ADVICE, jnp.float32)
    counts = is_chosen & (request.own_advice_mps2 >= _hardest_mps2(following))
    own = jnp.where(counts, request.own_advice_mps2, NO_ADVICE)
    asked = nothing
    for exists, receiver, advice in (
        (side.leader_exists, side.leader_entry, request.leader_advice_mps2),
        (side.follower_exists, side.follower_entry, request.follower_advice_mps2),
    ):
        # advice harder than the receiver would brake is ignored, as in SUMO
        of_receiver = following_of(take(everybody.vehicle_class, receiver), classes)
        counts = is_chosen & exists & (advice >= _hardest_mps2(of_receiver))
        asked = asked.at[receiver].min(jnp.where(counts, advice, NO_ADVICE), mode="promise_in_bounds")
    asks = is_chosen & request.asks_follower & side.follower_exists
    nobody = jnp.zeros((num_entries,), bool)
    return _Asked(
        own_advice_mps2=nothing.at[entry].min(own, mode="promise_in_bounds"),
        asked_advice_mps2=asked,
        help_right=nobody.at[side.follower_entry].max(asks & is_right, mode="promise_in_bounds"),
        help_left=nobody.at[side.follower_entry].max(asks & ~is_right, mode="promise_in_bounds"),
    )


def _hardest_mps2(following: Following) -> Value:
    """Return the deceleration, a negative number, down to which vehicles follow an advice."""
    return -following.max_deceleration_mps2 - 1e-3


def _lc2013_of(vehicles: VehicleArrays, classes: tuple[VehicleClass, ...]) -> Lc2013:
    return select_record([_lc2013(c) for c in classes], vehicles.vehicle_class)


def _lc2013(vehicle_class: VehicleClass) -> Lc2013:
    model = vehicle_class.lane_change
    if isinstance(model, Mobil):
        return route_parameters(model)
    if not isinstance(model, Lc2013):
        raise TypeError(f"Expected the lane-change model Lc2013 or Mobil for every class, got {type(model).__name__}.")
    return model
