"""One lane-change decision of all vehicles: look right, look left, negotiate, and settle who changes."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.free_model import FreeModel, of_members
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.lane_change.lanes import lanes_of
from surrogate.lane_change.lc2013 import Memory
from surrogate.lane_change.motives import wish
from surrogate.lane_change.negotiation import Asked, Duty, hardest_mps2, negotiate
from surrogate.lane_change.old_follower import OldFollower, old_follower_of
from surrogate.lane_change.registry import check_known
from surrogate.lane_change.surroundings import Wanted, desired_speed_mps, following_of
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.lane_change.view import View, judge_gaps, lc2013_of, look_around
from surrogate.vehicle.lane_change_model import LEFT, RIGHT, STAY, LaneChangeDecision
from surrogate.vehicle.vehicle_class import VehicleClass
from surrogate.xla.materialise import materialise
from surrogate.xla.tiles import Tile, all_tiles, over_tiles

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


def decide(
    on_road: VehiclesOnRoad,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
    num_tiles: Int[Array, ""] | int | None = None,
) -> LaneChangeDecision:
    """Lane-change decisions of all vehicles.

    Args:
        on_road: the vehicles and where they are.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
        num_tiles: tiles that hold vehicles, see `surrogate.xla.tiles`; all unless given.
    """
    check_known(classes)
    everybody = on_road.everybody
    num_entries = everybody.row.shape[0]
    num_tiles = all_tiles(num_entries) if num_tiles is None else num_tiles
    desired_mps = materialise(desired_speed_mps(everybody, classes))
    wanted = Wanted.of(desired_mps)

    def who_must_change(tile: Tile) -> Duty:
        part = on_road.part(tile)
        lanes = materialise(lanes_of(part, following_of(part.vehicles.vehicle_class, classes)))
        around = look_around(part, wanted.part(tile), lanes, classes, interval_s, step_s)
        return Duty(lanes, around.route_right.must_change, around.route_left.must_change)

    duty = over_tiles(who_must_change, num_tiles, num_entries)
    old_follower = None
    if any(isinstance(c.lane_change, FreeModel) for c in classes):
        old_follower = old_follower_of(everybody, following_of(everybody.vehicle_class, classes), desired_mps)
    asked = negotiate(on_road, duty, wanted, old_follower, classes, interval_s, step_s)

    def settle(tile: Tile) -> LaneChangeDecision:
        part = on_road.part(tile)
        around = materialise(look_around(part, wanted.part(tile), tile(duty.lanes), classes, interval_s, step_s))
        return _settle(part, around, tile(asked), tile(old_follower), classes, interval_s, step_s)

    return over_tiles(settle, num_tiles, num_entries)


def _settle(
    part: VehiclesOnRoad,
    around: View,
    asked: Asked,
    old_follower: OldFollower | None,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> LaneChangeDecision:
    """Lane-change decisions, now that vehicles know what others ask of them."""
    vehicles = part.vehicles
    following = following_of(vehicles.vehicle_class, classes)
    model = lc2013_of(vehicles, classes)
    ego, right, left = around.ego, around.right, around.left
    route_right, route_left = around.route_right, around.route_left
    judged = judge_gaps(part, around, old_follower, classes, step_s)
    right_gaps, left_gaps = judged.gaps
    memory = Memory(
        gain_left=vehicles.gain_left_memory,
        gain_right=vehicles.gain_right_memory,
        keep_right=vehicles.keep_right_memory,
    )
    to_right = wish(model, ego, right, route_right, memory, following, asked.help_right, True, interval_s, step_s)
    to_left = wish(model, ego, left, route_left, memory, following, asked.help_left, False, interval_s, step_s)
    to_right, to_left = materialise((to_right, to_left))
    asked_advice = asked.asked_advice_mps2
    for other, is_member in judged.others:
        assert judged.outlook is not None
        theirs = other.wishes(judged.outlook, judged.gaps, (asked.help_right, asked.help_left))
        to_right, to_left = of_members(is_member, theirs, (to_right, to_left))
        asked_advice = of_members(is_member, jnp.maximum(asked_advice, -other.most_asked_mps2()), asked_advice)
    goes_right = to_right.change & ~right_gaps.at_all
    goes_left = to_left.change & ~left_gaps.at_all & ~goes_right & ~(to_right.urgent & to_left.urgent)
    goes_right, goes_left = materialise((goes_right, goes_left))
    moves = goes_right | goes_left
    direction = jnp.where(goes_right, RIGHT, jnp.where(goes_left, LEFT, STAY)).astype(jnp.int32)
    if interval_s > step_s:  # there and back between two decisions: nothing is left of it but empty memories
        returns = goes_left & to_left.reverts & ~_is_held_by_leader(ego, following, model.assertive, step_s)
        direction = jnp.where(returns, STAY, direction)
    is_harder = to_left.advice_mps2 < hardest_mps2(following)
    own_advice = jnp.minimum(asked.own_advice_mps2, jnp.where(is_harder, NO_ADVICE, to_left.advice_mps2))
    return LaneChangeDecision(
        direction=direction,
        reason=jnp.where(goes_right, to_right.reason, to_left.reason).astype(jnp.int32),
        entry_ahead=jnp.where(goes_right, right.leader_entry, left.leader_entry),
        target_row=jnp.where(goes_right, right.row, left.row),
        own_advice_mps2=own_advice,
        asked_advice_mps2=asked_advice,
        gain_left_memory=jnp.where(moves, 0.0, to_left.gain),
        gain_right_memory=jnp.where(moves, 0.0, to_right.gain),
        keep_right_memory=jnp.where(moves, 0.0, to_right.keep_right),
        look_ahead_speed_mps=jnp.where(moves, 0.0, around.after_left),
    )


def _is_held_by_leader(ego: Ego, following: Following, assertive: Value, step_s: float) -> Flag:
    """Whether the leader in the own lane is too near to change into that lane behind him."""
    deceleration = following.of(ego.leader_class).field("max_deceleration_mps2")
    secure_m = following.own.secure_gap_m(ego.speed_mps, ego.leader_speed_mps, deceleration, step_s)
    return ego.leader_exists & (ego.leader_gap_m < secure_m / assertive)
