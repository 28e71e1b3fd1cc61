"""A slope that drivers do not make up for: the same pedal gives less acceleration."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Moment

GRAVITY_MPS2 = 9.81
Value = Float[Array, " vehicle"]


def _actuate(dial: Dial, acceleration: Value, moment: Moment) -> Value:
    """Return the acceleration less the slope's part; who stands does not roll back."""
    is_there = moment.is_background & dial.covers(moment.vehicles.position_m, moment.time_s)
    return acceleration - jnp.where(is_there, GRAVITY_MPS2 * dial.strength, 0.0)


GRADE = Effect(
    name="grade",
    title="a slope that drivers do not make up for",
    unit="slope (0.02 = 2 %), uphill positive",
    weak=0.01,
    medium=0.02,
    strong=0.04,
    acts_on=ActsOn.ROAD,
    source=(
        "a - g sin(slope), Treiber & Kesting (2013), Traffic Flow Dynamics; incomplete compensation: Goni-Ros et al. "
        "The subject vehicle's speed control makes up for it"
    ),
    has_place=True,
    is_signed=True,
    actuate=_actuate,
)
