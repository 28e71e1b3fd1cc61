"""The subject vehicle acts at intervals and holds its acceleration in between."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Moment
from surrogate.effects.reaction_delay import RHYTHMS_S, hold_order, last_order_mps2
from surrogate.road.drive_table import DriveTable, LogFormat
from surrogate.vehicle.vehicle_class import CarFollowingMix

Value = Float[Array, " vehicle"]


def _command(dial: Dial, acceleration: Value, desired_mps: Value, model: CarFollowingMix, moment: Moment) -> Value:
    del model
    interval_s = jnp.where(moment.is_subject, dial.strength, 0.0)
    return hold_order(acceleration, last_order_mps2(moment), interval_s, desired_mps, moment)


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    del log
    steps = max(1, round(strength / table.interval_s))
    number = np.arange(len(table.time_s))
    first = np.maximum(number - (number + int(random.integers(0, steps))) % steps, 0)
    return dataclasses.replace(table, subject_acceleration_mps2=table.subject_acceleration_mps2[first])


SUBJECT_ACTUATION_LAG = Effect(
    name="subject_actuation_lag",
    title="the subject vehicle's drive train answers late",
    unit="s between two actions of the subject vehicle",
    weak=0.3,
    medium=0.6,
    strong=1.0,
    acts_on=ActsOn.ACTUATION,
    source=(
        "SUMO's actionStepLength; lags of 0.2 to 1 s by judgement; whole responses of adaptive cruise control take 1.7 "
        "to 2.5 s: Makridis et al. (2020)"
    ),
    rhythms_s=RHYTHMS_S,
    alter=_alter,
    command=_command,
)
