"""Drivers differ: time gap, acceleration, deceleration and desired speed are spread between them."""

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import ndtri
from jaxtyping import Array, Float, Int

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment, Newcomers
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.habits import Habits

NAME = "driver_heterogeneity"
SPEED_SHARE = 0.35  # spread of desired speeds, relative to that of the other numbers
SPEED_FACTOR_BOUNDS = (0.2, 2.0)  # SUMO's for normc
TRAITS = ("time_gap", "acceleration", "deceleration", "speed")


def _factor(spread: Array, seed: Array, identity: Int[Array, "..."], trait: str) -> Float[Array, "..."]:
    """Return a lognormal factor of mean 1 whose coefficient of variation is `spread`."""
    variance = jnp.log1p(spread**2)
    normal = ndtri(uniform(seed, identity, TRAITS.index(trait), Purpose.TRAIT))
    return jnp.where(spread > 0.0, jnp.exp(jnp.sqrt(variance) * normal - 0.5 * variance), 1.0)


def _newcomer(dial: Dial, newcomers: Newcomers, seed: Array) -> Newcomers:
    factor = _factor(SPEED_SHARE * dial.strength, seed, newcomers.identity, "speed")
    speed = jnp.clip(newcomers.speed_factor * factor, *SPEED_FACTOR_BOUNDS)
    speed = jnp.where(newcomers.is_subject | ~dial.is_on, newcomers.speed_factor, speed)
    return eqx.tree_at(lambda n: n.speed_factor, newcomers, speed)


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    return {trait: _factor(dial.strength, seed, vehicles.identity, trait) for trait in TRAITS if trait != "speed"}


def _adapt(dial: Dial, habits: Habits, moment: Moment) -> Habits:
    del dial
    own = moment.memory(NAME)

    def of_humans(trait: str) -> Array:
        return jnp.where(moment.is_background, own[trait], 1.0)

    return Habits(
        time_gap=habits.time_gap * of_humans("time_gap"),
        acceleration=habits.acceleration * of_humans("acceleration"),
        deceleration=habits.deceleration * of_humans("deceleration"),
    )


DRIVER_HETEROGENEITY = Effect(
    name=NAME,
    title="drivers differ from one another",
    unit="coefficient of variation of time gap, acceleration and deceleration (desired speed: 0.35 of it)",
    weak=0.1,
    medium=0.2,
    strong=0.35,
    acts_on=ActsOn.COMPOSITION,
    source=(
        "lognormal spread; differences between drivers exceed those between models: Brockfeld, Kuehne & Wagner (2004), "
        "TRR 1876. Deviation: lane changing asks the class's gaps"
    ),
    newcomer=_newcomer,
    begin=_begin,
    adapt=_adapt,
)
