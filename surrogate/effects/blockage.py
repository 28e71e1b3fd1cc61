"""One vehicle stops in its lane for a while."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.vehicle.lane_change_model import STAY, LaneChangeDecision
from surrogate.vehicle.vehicle_class import select_by_class

NAME = "blockage"
# the vehicle that is to stop is chosen earlier: it must still come to a standstill
CALLED_BEFORE_S = 10.0
SPARE_M = 5.0


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    nothing = jnp.zeros_like(vehicles.position_m, bool)
    return {"stops": nothing, "in_lane": nothing}


def _blocked_row(dial: Dial, road: Road) -> Int[Array, ""]:
    """Return the row of the chosen lane, counted from the left, at the place; -1 where there is none."""
    is_lane = road.is_carriageway[:, road.segment_at(dial.route_from_m)]
    from_left = jnp.cumsum(is_lane[::-1])[::-1]
    is_chosen = is_lane & (from_left == dial.choice.astype(from_left.dtype))
    return jnp.where(jnp.any(is_chosen), jnp.argmax(is_chosen), -1)


def _lasts(dial: Dial, moment: Moment) -> Bool[Array, ""]:
    end_s = dial.time_from_s + dial.strength
    return dial.is_on & (moment.time_s >= dial.time_from_s - CALLED_BEFORE_S) & (moment.time_s < end_s)


def _road(dial: Dial, vehicles: VehicleArrays, road: Road, moment: Moment) -> VehicleArrays:
    """Let the chosen vehicle stop, and note who is in its lane."""
    stops = moment.memory(NAME)["stops"] & _lasts(dial, moment)
    in_lane = vehicles.row == _blocked_row(dial, road)
    personal = dict(vehicles.personal or {}) | {NAME: {"stops": stops, "in_lane": in_lane}}
    stop_m = jnp.where(stops, jnp.minimum(dial.route_from_m, vehicles.stop_position_m), vehicles.stop_position_m)
    return with_changes(vehicles, stop_position_m=stop_m, personal=personal)


def _decide(dial: Dial, decision: LaneChangeDecision, moment: Moment) -> LaneChangeDecision:
    stays = moment.memory(NAME)["stops"] & _lasts(dial, moment)
    return dataclasses.replace(decision, direction=jnp.where(stays, STAY, decision.direction).astype(jnp.int32))


def _settle(dial: Dial, moment: Moment, direction: Int[Array, " vehicle"]) -> Memory:
    """Choose the first vehicle in the lane that can still stop at the place, if none has been chosen."""
    memory, vehicles = moment.memory(NAME), moment.vehicles
    braking = select_by_class([c.car_following.max_deceleration_mps2 for c in moment.classes], vehicles.vehicle_class)
    needs_m = vehicles.speed_mps**2 / (2.0 * braking) + SPARE_M
    can = moment.is_background & memory["in_lane"] & (direction == STAY)
    can &= vehicles.position_m + needs_m <= dial.route_from_m
    furthest_m = jnp.max(jnp.where(can, vehicles.position_m, -jnp.inf))
    is_first = can & (vehicles.position_m == furthest_m)
    is_open = _lasts(dial, moment) & ~jnp.any(memory["stops"])
    return memory | {"stops": jnp.where(is_open, is_first, memory["stops"])}


BLOCKAGE = Effect(
    name=NAME,
    title="a vehicle stands in one lane for a while",
    unit="s from its beginning (time_from_s) to its end",
    weak=40.0,
    medium=90.0,
    strong=160.0,
    acts_on=ActsOn.ROAD,
    source="one of three lanes blocked leaves 0.49 of the capacity: HCM as quoted in FHWA-HOP-13-042, appendix A",
    has_place=True,
    has_time=True,
    lasts_as_strength=True,
    choice="lane, counted from the left, 1 = leftmost",
    default_choice=1.0,
    begin=_begin,
    road=_road,
    decide=_decide,
    settle=_settle,
)
