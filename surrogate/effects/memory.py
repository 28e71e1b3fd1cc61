"""Drivers who have been slow for long keep larger gaps: the IDM with memory."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.habits import Habits

NAME = "memory"
Value = Float[Array, " vehicle"]


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"level": jnp.ones_like(vehicles.speed_mps)}


def _adapt(dial: Dial, habits: Habits, moment: Moment) -> Habits:
    """Multiply the time gap by beta + level (1 - beta), with beta = 1 + strength."""
    bad = jnp.where(moment.is_background, 1.0 - moment.memory(NAME)["level"], 0.0)
    return dataclasses.replace(habits, time_gap=habits.time_gap * (1.0 + dial.strength * bad))


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    """Let the level of service follow the speed, relative to the desired one."""
    del order_mps2
    level = moment.memory(NAME)["level"]
    vehicles = moment.vehicles
    now = vehicles.speed_mps / jnp.maximum(vehicles.speed_factor * vehicles.speed_limit_mps, 1.0)
    level = level + (moment.step_s / jnp.maximum(dial.time_constant_s, moment.step_s)) * (now - level)
    return {"level": jnp.minimum(level, 1.0)}


MEMORY = Effect(
    name=NAME,
    title="larger gaps after slow traffic has lasted",
    unit="largest factor on the time gap, 1 = none",
    weak=0.2,
    medium=0.5,
    strong=0.8,
    acts_on=ActsOn.DECISION,
    source="IDM with memory, Treiber & Helbing (2003), cond-mat/0304337; SUMO's IDMM (adaptFactor = 1 + strength)",
    time_constant="s in which the impression of the traffic changes (SUMO's adaptTime)",
    default_time_constant_s=60.0,
    reported_at_zero=1.0,
    begin=_begin,
    adapt=_adapt,
    remember=_remember,
)
