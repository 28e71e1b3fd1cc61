"""Drivers slow down or change lane for somebody who must change, more readily than the scenario says."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from surrogate.effects.base import ActsOn, Dial, Effect
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.mobil import Mobil
from surrogate.vehicle.vehicle_class import VehicleClass


def _behaviour(dial: Dial, vehicle_class: VehicleClass) -> VehicleClass:
    def more(value: Array) -> Array:
        return jnp.where(dial.is_on, jnp.clip(value + dial.strength, 0.0, jnp.maximum(value, 1.0)), value)

    model = vehicle_class.lane_change
    if isinstance(model, Lc2013):
        model = dataclasses.replace(
            model, cooperative=more(model.cooperative), cooperative_speed=more(model.cooperative_speed)
        )
    if isinstance(model, Mobil):
        model = dataclasses.replace(model, politeness=more(model.politeness))
    return dataclasses.replace(vehicle_class, lane_change=model)


def _more(value: float, strength: float) -> float:
    return float(np.clip(value + strength, 0.0, max(value, 1.0)))


COOPERATIVE_YIELDING = Effect(
    name="cooperative_yielding",
    title="drivers make room for who must change lane",
    unit="added willingness, 0 to 1 (SUMO's lcCooperative and lcCooperativeSpeed)",
    weak=0.2,
    medium=0.4,
    strong=0.65,
    acts_on=ActsOn.DECISION,
    source="LC2013's cooperation, Erdmann (2015); lag vehicles slow down and change lane for mergers: 2404.09851",
    is_signed=True,
    vtype_attributes=(("lcCooperative", _more), ("lcCooperativeSpeed", _more)),
    behaviour=_behaviour,
)
