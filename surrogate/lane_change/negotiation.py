"""Those who must change lane for their route ask their neighbours for room."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.cooperation import NO_ADVICE, requests
from surrogate.lane_change.counter_change import leave_room
from surrogate.lane_change.gap_acceptance import Following
from surrogate.lane_change.keep_clear import keep_clear_on_edge_mps2
from surrogate.lane_change.lanes import Lanes
from surrogate.lane_change.old_follower import OldFollower
from surrogate.lane_change.surroundings import Wanted, following_of
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.lane_change.view import judge_gaps, look_around
from surrogate.vehicle.vehicle_class import VehicleClass
from surrogate.xla.compaction import first_true
from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise, on_processors
from surrogate.xla.tiles import Chosen, Tile, most_of_batch, over_tiles, tiles_for

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

URGENT_SHARE = 8  # at most one in so many entries negotiates in one decision; there are fewer in any traffic that moves
FEWEST_URGENT = 24
URGENT_TILE = 32  # of them at a time: of 8 runs with 1,100 vehicles each on ten kilometres, the most urgent one has 50


class Duty(eqx.Module):
    """Who must change lane for his route."""

    lanes: Lanes  # the lanes of everybody
    must_right: Flag  # whether the route needs a change to the right
    must_left: Flag  # whether it needs one to the left


class Asked(eqx.Module):
    """What the vehicles that must change have asked for."""

    own_advice_mps2: Value  # acceleration that such a vehicle asks of itself; inf where none
    asked_advice_mps2: Value  # lowest acceleration asked of each vehicle by others; inf where none
    help_right: Flag  # vehicles asked to make room by one who must change to the right
    help_left: Flag  # the same to the left


class _Asking(eqx.Module):
    """What each of those who must change asks, of himself and of his neighbours in that lane."""

    own_advice_mps2: Value  # acceleration for himself; inf where none
    leader: Int[Array, " vehicle"]  # entry of the leader
    leader_advice_mps2: Value  # acceleration for him; inf where none
    follower: Int[Array, " vehicle"]  # entry of the follower
    follower_advice_mps2: Value  # acceleration for him; inf where none
    asks_follower: Flag  # whether he is asked to make room
    second: Int[Array, " vehicle"]  # entry of who follows the follower
    second_advice_mps2: Value  # acceleration for him; inf where none
    is_right: Flag  # whether the lane is on the right


def negotiate(
    on_road: VehiclesOnRoad,
    duty: Duty,
    wanted: Wanted,
    old_follower: OldFollower | None,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> Asked:
    """Let those who must change ask; they are few, so they are picked first.

    Args:
        on_road: all vehicles and where they are.
        duty: who must change.
        wanted: speeds that vehicles want.
        old_follower: who follows each in its own row; None if no model asks.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
    """
    everybody = on_road.everybody
    num_entries = everybody.row.shape[0]
    number = max(FEWEST_URGENT, num_entries // URGENT_SHARE)
    must = duty.must_right | duty.must_left
    entry, is_chosen = first_true(must, number)
    # both sides are the lane asked for: what is read of it is read once
    lane = jax.tree.map(partial(jnp.where, duty.must_right), duty.lanes.right, duty.lanes.left)

    def ask(tile: Tile) -> _Asking:
        chosen = Chosen(tile(entry))
        part = on_road.part(chosen)
        following = following_of(part.vehicles.vehicle_class, classes)
        need, beside, is_right = chosen((duty.lanes.need, lane, duty.must_right))
        around = look_around(part, wanted.part(chosen), Lanes(need, beside, beside), classes, interval_s, step_s)
        ego, side = materialise((around.ego, around.right))
        around = dataclasses.replace(around, ego=ego, right=side, left=side)
        judged = judge_gaps(part, around, chosen(old_follower), classes, step_s)
        gaps = jax.tree.map(partial(jnp.where, is_right), *judged.gaps)
        request = requests(ego, side, gaps, following, around.after_right, is_right, interval_s, step_s)
        leader = side.leader_entry
        comes_over = jnp.where(is_right, take(duty.must_left, leader), take(duty.must_right, leader))
        leader_remaining_m = take(duty.lanes.need.remaining_m, leader)
        own_stop, leader_stop = leave_room(ego, side, comes_over, leader_remaining_m, following, step_s)

        def heard(receiver: Int[Array, " chosen"], exists: Flag, advice_mps2: Value) -> Value:
            # advice harder than the receiver would brake is ignored, as in SUMO
            of_receiver = following_of(take(everybody.vehicle_class, receiver), classes)
            return jnp.where(exists & (advice_mps2 >= hardest_mps2(of_receiver)), advice_mps2, NO_ADVICE)

        last = everybody.row.shape[0] - 1
        behind = [on_road.neighbour(jnp.minimum(side.leader_entry + place, last), side.row) for place in (1, 2)]
        clear = [
            heard(
                one.entry, one.exists & gaps.at_all, keep_clear_on_edge_mps2(part, ego, one, wanted, following, step_s)
            )
            for one in behind
        ]
        own = request.own_advice_mps2
        return _Asking(
            own_advice_mps2=jnp.minimum(jnp.where(own >= hardest_mps2(following), own, NO_ADVICE), own_stop),
            leader=leader,
            leader_advice_mps2=jnp.minimum(heard(leader, side.leader_exists, request.leader_advice_mps2), leader_stop),
            follower=side.follower_entry,
            follower_advice_mps2=jnp.minimum(
                heard(side.follower_entry, side.follower_exists, request.follower_advice_mps2), clear[0]
            ),
            asks_follower=request.asks_follower & side.follower_exists,
            second=behind[1].entry,
            second_advice_mps2=clear[1],
            is_right=is_right,
        )

    size = min(URGENT_TILE, number) if on_processors() else number
    num_tiles = tiles_for(most_of_batch(jnp.sum(must)), number, size)
    asking = over_tiles(ask, num_tiles, number, size)
    nobody = jnp.zeros((num_entries,), bool)
    nothing = jnp.full((num_entries,), NO_ADVICE, jnp.float32)

    def told(advice: Value, receiver: Int[Array, " chosen"], advice_mps2: Float[Array, " chosen"]) -> Value:
        return advice.at[receiver].min(jnp.where(is_chosen, advice_mps2, NO_ADVICE), mode="promise_in_bounds")

    asked = told(nothing, asking.leader, asking.leader_advice_mps2)
    asked = told(asked, asking.second, asking.second_advice_mps2)
    asks = is_chosen & asking.asks_follower
    return Asked(
        own_advice_mps2=told(nothing, entry, asking.own_advice_mps2),
        asked_advice_mps2=told(asked, asking.follower, asking.follower_advice_mps2),
        help_right=nobody.at[asking.follower].max(asks & asking.is_right, mode="promise_in_bounds"),
        help_left=nobody.at[asking.follower].max(asks & ~asking.is_right, mode="promise_in_bounds"),
    )


def hardest_mps2(following: Following) -> Value:
    """Return the deceleration, a negative number, down to which vehicles follow an advice."""
    return -following.max_deceleration_mps2 - 1e-3
