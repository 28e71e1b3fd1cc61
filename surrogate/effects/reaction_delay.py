"""Drivers act at intervals, on what they see then, and hold their acceleration in between.

Why intervals and not a constant delay: it is the delay that SUMO has (`actionStepLength`), so findings can be confirmed
there; it needs one number of memory per vehicle where a delay line needs tens; and on average a driver's information is
half an interval old, which is what the traffic notices.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.drive_table import DriveTable, LogFormat, as_logged
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.vehicle_class import CarFollowingMix

NAME = "reaction_delay"
RHYTHMS_S = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5)
Value = Float[Array, " vehicle"]


def acts_now(interval_s: Value, moment: Moment) -> Bool[Array, " vehicle"]:
    """The drivers who act in this step: everybody where the interval is no longer than a step.

    Each driver's instants lie at a phase of his own.
    """
    steps = interval_s / moment.step_s
    is_interval = steps > 1.0
    steps = jnp.where(is_interval, steps, 1.0)
    phase = uniform(moment.seed, moment.vehicles.identity, 0, Purpose.ACTION_PHASE)
    now = moment.step.astype(jnp.float32)
    return ~is_interval | (jnp.floor(now / steps + phase) > jnp.floor((now - 1.0) / steps + phase))


def hold_order(acceleration: Value, last_order: Value, interval_s: Value, desired_mps: Value, moment: Moment) -> Value:
    """The order of a driver: a new one when he acts, the one before when he does not.

    Source: SUMO's `MSVehicle::executeMove` between action steps, and `MSCFModel::finalizeSpeed`, by which an order
    does not lead beyond the desired speed before the next.
    """
    up = jnp.maximum((desired_mps - moment.vehicles.speed_mps) / jnp.maximum(interval_s, moment.step_s), 0.0)
    fresh = jnp.where(interval_s > moment.step_s, jnp.minimum(acceleration, up), acceleration)
    return jnp.where(acts_now(interval_s, moment), fresh, last_order)


def last_order_mps2(moment: Moment) -> Value:
    """Return the acceleration that each driver, or the subject vehicle, ordered last."""
    return moment.memory(NAME)["order_mps2"]


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"order_mps2": jnp.zeros_like(vehicles.speed_mps)}


def _command(dial: Dial, acceleration: Value, desired_mps: Value, model: CarFollowingMix, moment: Moment) -> Value:
    del model
    interval_s = jnp.where(moment.is_background, dial.strength, 0.0)
    return hold_order(acceleration, last_order_mps2(moment), interval_s, desired_mps, moment)


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    del dial, moment
    return {"order_mps2": order_mps2}


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    """Speeds between the moments at which a driver acts are linear: the acceleration is held."""
    steps = max(1, round(strength / table.interval_s))
    order = table.by_track
    track, instant = table.track[order], table.instant[order]
    begins = (np.diff(track, prepend=-9) != 0) | (np.diff(instant, prepend=-9) != 1)
    begin = np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))
    end = np.append(np.flatnonzero(begins)[1:], len(order))[np.cumsum(begins) - 1] - 1
    phase = random.integers(0, steps, len(order))[begin]
    since = (instant - instant[begin] + phase) % steps
    first = np.maximum(np.arange(len(order)) - since, begin)
    last = np.minimum(first + np.where(first == begin, steps - phase, steps), end)
    speed = table.speed_mps[order]
    share = np.where(last > first, (np.arange(len(order)) - first) / np.maximum(last - first, 1), 0.0)
    linear = speed[first] + share * (speed[last] - speed[first])
    changed = table.speed_mps.copy()
    changed[order] = np.where(track >= 0, linear, speed)
    return as_logged(dataclasses.replace(table, speed_mps=changed), log)


REACTION_DELAY = Effect(
    name=NAME,
    title="drivers act at intervals and react late",
    unit="s between two actions of a driver",
    weak=0.5,
    medium=1.0,
    strong=1.5,
    acts_on=ActsOn.DECISION,
    source=(
        "SUMO, actionStepLength; delays of 0.4 to 1.2 s in Treiber, Kesting & Helbing (2006), cond-mat/0404736, "
        "are half of such an interval on average"
    ),
    rhythms_s=RHYTHMS_S,
    alter=_alter,
    begin=_begin,
    command=_command,
    remember=_remember,
)
