"""Drivers who come out of a queue accelerate less than others: the capacity drop."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.habits import Habits

NAME = "slow_start"
BEGINS_BELOW_MPS = 8.0
ENDS_ABOVE_MPS = 14.0
Value = Float[Array, " vehicle"]


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"recovers": jnp.zeros_like(vehicles.speed_mps)}


def _adapt(dial: Dial, habits: Habits, moment: Moment) -> Habits:
    recovers = jnp.where(moment.is_background, moment.memory(NAME)["recovers"], 0.0)
    return dataclasses.replace(habits, acceleration=habits.acceleration * (1.0 - dial.strength * recovers))


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    """Remember who has been slow and is not fast again."""
    del dial, order_mps2
    v = moment.vehicles.speed_mps
    recovers = jnp.where(v >= ENDS_ABOVE_MPS, 0.0, moment.memory(NAME)["recovers"])
    return {"recovers": jnp.where(v < BEGINS_BELOW_MPS, 1.0, recovers)}


SLOW_START = Effect(
    name=NAME,
    title="sluggish acceleration out of queues",
    unit="share of the acceleration lost while recovering from below 8 m/s up to 14 m/s",
    weak=0.2,
    medium=0.35,
    strong=0.5,
    acts_on=ActsOn.DECISION,
    source=(
        "discharge 2 to 11 % below capacity: Zhang & Levinson (2004); about 10 %: Cassidy & Bertini (1999); "
        "model by judgement"
    ),
    begin=_begin,
    adapt=_adapt,
    remember=_remember,
)
