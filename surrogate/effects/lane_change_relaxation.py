"""After a lane change, changer and new follower accept a short gap and restore the usual one slowly."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.road.neighbours import shift_down
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.habits import Habits
from surrogate.vehicle.lane_change_model import STAY

NAME = "lane_change_relaxation"
Value = Float[Array, " vehicle"]


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"patience": jnp.zeros_like(vehicles.speed_mps)}


def _adapt(dial: Dial, habits: Habits, moment: Moment) -> Habits:
    patience = jnp.where(moment.is_background, moment.memory(NAME)["patience"], 0.0)
    return dataclasses.replace(habits, time_gap=habits.time_gap * (1.0 - dial.strength * patience))


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    del order_mps2
    keep = jnp.exp(-moment.step_s / jnp.maximum(dial.time_constant_s, moment.step_s))
    return {"patience": keep * moment.memory(NAME)["patience"]}


def _settle(dial: Dial, moment: Moment, direction: Int[Array, " vehicle"]) -> Memory:
    """Begin anew for who has just changed and for who is right behind him."""
    del dial
    changed = (direction != STAY) & moment.vehicles.is_vehicle
    is_cut_in_on = shift_down(changed.astype(jnp.int32), 0) > 0
    return {"patience": jnp.where(changed | is_cut_in_on, 1.0, moment.memory(NAME)["patience"])}


LANE_CHANGE_RELAXATION = Effect(
    name=NAME,
    title="short gaps accepted after a lane change",
    unit="share of the time gap given up right after a lane change",
    weak=0.2,
    medium=0.4,
    strong=0.55,
    acts_on=ActsOn.DECISION,
    source=(
        "relaxation of Laval & Leclercq (2008); exponential as in OpenTrafficSim's LMRS (tau 25 s) and in Keane & Gao "
        "(2019), 1904.08395"
    ),
    time_constant="s in which the usual time gap comes back to 1/e of what is missing",
    default_time_constant_s=15.0,
    begin=_begin,
    adapt=_adapt,
    remember=_remember,
    settle=_settle,
)
