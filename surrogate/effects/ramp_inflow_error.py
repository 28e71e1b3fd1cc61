"""One entrance's inflow is not what the scenario says."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect


def _inputs(dial: Dial, inputs_vehph: Float[Array, " input"]) -> Float[Array, " input"]:
    is_chosen = jnp.arange(inputs_vehph.shape[0]) == dial.choice.astype(jnp.int32)
    return inputs_vehph * jnp.where(is_chosen, jnp.maximum(1.0 + dial.strength, 0.0), 1.0)


RAMP_INFLOW_ERROR = Effect(
    name="ramp_inflow_error",
    title="a ramp's true inflow differs",
    unit="fraction by which it exceeds the given inflow, negative where it is less",
    weak=0.15,
    medium=0.3,
    strong=0.6,
    acts_on=ActsOn.DEMAND,
    source="errors of detectors and of counts of another day; range by judgement",
    is_signed=True,
    is_calibrated=True,
    choice="number of the input in the case, counted from 0",
    default_choice=1.0,
    inputs=_inputs,
)
