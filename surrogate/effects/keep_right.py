"""Drivers go back to the right lane more eagerly than the scenario says."""

import dataclasses

from surrogate.effects.base import ActsOn, Dial, Effect
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.mobil import Mobil
from surrogate.vehicle.vehicle_class import VehicleClass

BIAS_PER_UNIT_MPS2 = 0.06  # MOBIL's bias of 0.3 m/s2 is as strong a discipline as LC2013's eagerness of 5


def _behaviour(dial: Dial, vehicle_class: VehicleClass) -> VehicleClass:
    model = vehicle_class.lane_change
    if isinstance(model, Lc2013):
        model = dataclasses.replace(model, keep_right=model.keep_right + dial.strength)
    if isinstance(model, Mobil):
        bias = model.keep_right_bias_mps2 + BIAS_PER_UNIT_MPS2 * dial.strength
        model = dataclasses.replace(model, keep_right_bias_mps2=bias)
    return dataclasses.replace(vehicle_class, lane_change=model)


def _more(value: float, strength: float) -> float:
    return value + strength


KEEP_RIGHT = Effect(
    name="keep_right",
    title="drivers keep to the right",
    unit="added to SUMO's lcKeepRight",
    weak=1.0,
    medium=3.0,
    strong=5.0,
    acts_on=ActsOn.DECISION,
    source="LC2013's keep-right motive, Erdmann (2015); asymmetric MOBIL, Kesting, Treiber & Helbing (2007)",
    vtype_attributes=(("lcKeepRight", _more),),
    behaviour=_behaviour,
)
