"""Calls the effects at the places of the simulator where they act, in the order of the registry."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.effects.base import Arrivals, Moment, Newcomers
from surrogate.effects.registry import EFFECTS
from surrogate.effects.settings import Effects
from surrogate.road.perception import PerceptionFrame, in_order
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.habits import Habits
from surrogate.vehicle.lane_change_model import LaneChangeDecision
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass
from surrogate.xla.gather import take
from surrogate.xla.tiles import most_of_batch

Value = Float[Array, " vehicle"]
LANE_CHANGE = "lane_change"  # of the memories: in which direction a vehicle has changed at the last decision
NUM_CLASSES_OF_EFFECTS = sum(effect.new_class is not None for effect in EFFECTS)
SensorMemory = dict[str, Any]


def _through(effects: Effects, hook: str, value: Any, *context: Any) -> Any:
    """A value after all effects that act there; each is given what the one before has made of it."""
    for effect in EFFECTS:
        function = getattr(effect, hook)
        if function is not None:
            value = function(effects.dial(effect.name), value, *context)
    return value


def true_inputs(effects: Effects, inputs_vehph: Float[Array, " input"]) -> Float[Array, " input"]:
    """The inflows that there really are."""
    return _through(effects, "inputs", inputs_vehph)


def classes_with_effects(classes: tuple[VehicleClass, ...], effects: Effects) -> tuple[VehicleClass, ...]:
    """The classes as they really are: those of human drivers, those that effects add, the subject vehicle's."""
    *humans, subject = classes
    added = [effect.new_class(effects.dial(effect.name), humans[0]) for effect in EFFECTS if effect.new_class]
    everybody = [*humans, *added]
    for effect in EFFECTS:
        if effect.behaviour is not None:
            everybody = [effect.behaviour(effects.dial(effect.name), vehicle_class) for vehicle_class in everybody]
    return (*everybody, subject)


def true_arrival(effects: Effects, gap: Float[Array, " entrance"], arrivals: Arrivals) -> Float[Array, " entrance"]:
    """The demand [veh] until the next vehicle arrives."""
    return _through(effects, "arrival", gap, arrivals)


def true_newcomers(
    effects: Effects, newcomers: Newcomers, classes: tuple[VehicleClass, ...], seed: Int[Array, ""]
) -> Newcomers:
    """The drivers who really ask to enter."""
    added = len(classes) - 1 - NUM_CLASSES_OF_EFFECTS
    for effect in EFFECTS:
        if effect.newcomer is not None:
            newcomers = dataclasses.replace(newcomers, added_class=added)
            newcomers = effect.newcomer(effects.dial(effect.name), newcomers, seed)
        added += effect.new_class is not None
    return newcomers


def with_memories(effects: Effects, vehicles: VehicleArrays, seed: Int[Array, ""]) -> VehicleArrays:
    """Vehicles that have just come, with what effects know of them."""
    personal = {
        effect.name: effect.begin(effects.dial(effect.name), vehicles, seed)
        for effect in EFFECTS
        if effect.begin is not None
    }
    personal[LANE_CHANGE] = {"direction": jnp.zeros_like(vehicles.row)}
    return with_changes(vehicles, personal=personal)


def road_demands(effects: Effects, vehicles: VehicleArrays, road: Road, moment: Moment) -> VehicleArrays:
    """The vehicles with the limits and stops that there really are; asked when lanes are decided about."""
    return _through(effects, "road", vehicles, road, moment)


def perceive_situation(effects: Effects, situation: FollowingSituation, moment: Moment) -> FollowingSituation:
    """The situation as drivers see it."""
    return _through(effects, "perceive", situation, moment)


def habits_of(effects: Effects, moment: Moment) -> Habits:
    """Differences of drivers from their classes now."""
    return _through(effects, "adapt", Habits.usual(moment.vehicles.speed_mps), moment)


def order_acceleration(
    effects: Effects, acceleration: Value, desired_mps: Value, model: CarFollowingMix, moment: Moment
) -> Value:
    """The acceleration that drivers order."""
    return _through(effects, "command", acceleration, desired_mps, model, moment)


def actuate(effects: Effects, acceleration: Value, moment: Moment) -> Value:
    """The acceleration that vehicles do."""
    return _through(effects, "actuate", acceleration, moment)


def remember_step(effects: Effects, moment: Moment, order_mps2: Value) -> VehicleArrays:
    """The vehicles after a step with what effects remember of it."""
    personal = dict(moment.vehicles.personal or {})
    for effect in EFFECTS:
        if effect.remember is not None:
            personal[effect.name] = effect.remember(effects.dial(effect.name), moment, order_mps2)
    return with_changes(moment.vehicles, personal=personal)


def decide_lanes(effects: Effects, decision: LaneChangeDecision, moment: Moment) -> LaneChangeDecision:
    """The vehicles' decisions about their lanes."""
    return _through(effects, "decide", decision, moment)


def with_lane_changes(vehicles: VehicleArrays, direction: Int[Array, " vehicle"]) -> VehicleArrays:
    """The vehicles, each with the direction in which it is changing lane now."""
    personal = dict(vehicles.personal or {})
    return with_changes(vehicles, personal=personal | {LANE_CHANGE: {"direction": direction}})


def remember_lane_changes(effects: Effects, moment: Moment) -> VehicleArrays:
    """The vehicles in their new order with what effects remember of the lane changes."""
    personal = dict(moment.vehicles.personal or {})
    direction = personal[LANE_CHANGE]["direction"]
    for effect in EFFECTS:
        if effect.settle is not None:
            personal[effect.name] = effect.settle(effects.dial(effect.name), moment, direction)
    return with_changes(moment.vehicles, personal=personal)


def show_lane_changes(
    effects: Effects, frame: PerceptionFrame, vehicles: VehicleArrays, entry: Int[Array, " object"]
) -> PerceptionFrame:
    """The objects of a frame as the vehicles stand between their lanes; `entry` is that of each object."""
    personal = vehicles.personal or {}
    for effect in EFFECTS:
        if effect.appear is not None:
            memory = {name: take(values, entry) for name, values in personal.get(effect.name, {}).items()}
            frame = effect.appear(effects.dial(effect.name), frame, memory)
    return frame


def start_of_sensing(frame: PerceptionFrame) -> SensorMemory:
    """The sensors' memory before the first frame, which `frame` is like."""
    return {effect.name: effect.watch(frame) for effect in EFFECTS if effect.watch is not None}


def sense_frame(
    effects: Effects, frame: PerceptionFrame, memory: SensorMemory, seed: Int[Array, ""]
) -> tuple[PerceptionFrame, SensorMemory]:
    """A frame as the sensors report it."""
    names = [effect.name for effect in EFFECTS if effect.sense is not None or effect.appear is not None]
    if not names:
        return frame, memory
    is_disturbed = jnp.any(jnp.stack([effects.dial(name).is_on for name in names]))

    def disturbed() -> tuple[PerceptionFrame, SensorMemory]:
        seen, later = frame, dict(memory)
        for effect in EFFECTS:
            if effect.sense is not None:
                seen, after = effect.sense(effects.dial(effect.name), seen, later.get(effect.name, {}), seed)
                if effect.watch is not None:
                    later[effect.name] = after
        return jax.tree.map(lambda new, old: jnp.where(is_disturbed, new, old), in_order(seen), seen), later

    # the same for all runs of a batch, so that one without such effects is spared the work
    is_any_disturbed = most_of_batch(is_disturbed.astype(jnp.int32)) > 0
    return jax.lax.cond(is_any_disturbed, disturbed, lambda: (frame, dict(memory)))


def sense_drive(frames: PerceptionFrame, effects: Effects, seed: Int[Array, ""]) -> PerceptionFrame:
    """The frames of one drive, stacked along a leading time axis, as the sensors report them.

    The same code that the simulator applies to its own frames, for frames of any other source.
    """
    start = start_of_sensing(jax.tree.map(lambda leaf: jnp.asarray(leaf)[0], frames))

    def sense(memory: SensorMemory, frame: PerceptionFrame) -> tuple[SensorMemory, PerceptionFrame]:
        frame, memory = sense_frame(effects, frame, memory, seed)
        return memory, frame

    return jax.lax.scan(sense, start, jax.tree.map(jnp.asarray, frames))[1]
