"""Some vehicles are lorries, of which the scenario knows nothing."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array

from surrogate.effects.base import ActsOn, Dial, Effect, Newcomers
from surrogate.keyed_random import Purpose, uniform
from surrogate.vehicle.habits import Habits, with_habits
from surrogate.vehicle.vehicle_class import VehicleClass

LENGTH_M = 13.5
TOP_SPEED_MPS = 85.0 / 3.6
TIME_GAP_FACTOR, ACCELERATION_FACTOR, DECELERATION_FACTOR = 1.2, 0.6, 0.9  # relative to cars


def _new_class(dial: Dial, cars: VehicleClass) -> VehicleClass:
    del dial
    factors = (TIME_GAP_FACTOR, ACCELERATION_FACTOR, DECELERATION_FACTOR)
    return dataclasses.replace(
        cars,
        car_following=with_habits(cars.car_following, Habits(*(jnp.asarray(f, jnp.float32) for f in factors))),
        length_m=jnp.full_like(cars.length_m, LENGTH_M),
        max_speed_mps=jnp.minimum(cars.max_speed_mps, TOP_SPEED_MPS),
    )


def _newcomer(dial: Dial, newcomers: Newcomers, seed: Array) -> Newcomers:
    is_heavy = uniform(seed, newcomers.identity, 0, Purpose.HEAVY) < dial.strength
    own_class = jnp.asarray(newcomers.added_class, jnp.int32)
    chosen = jnp.where(is_heavy & ~newcomers.is_subject, own_class, newcomers.vehicle_class)
    return dataclasses.replace(newcomers, vehicle_class=chosen)


HEAVY_VEHICLES = Effect(
    name="heavy_vehicles",
    title="lorries among the cars",
    unit="share of the vehicles (13.5 m long, 85 km/h)",
    weak=0.05,
    medium=0.12,
    strong=0.25,
    acts_on=ActsOn.COMPOSITION,
    source="lengths of 12 to 18 m, accelerations of 0.5 to 1.0 m/s2, 80 to 90 km/h; factors against cars by judgement",
    newcomer=_newcomer,
    new_class=_new_class,
)
