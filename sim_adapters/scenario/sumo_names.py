"""SUMO's vType attributes, and which field of the surrogate each is.

Attributes are the names by which users know the parameters, so they are jaxcalib's parameter names as well. Defaults
are those of SUMO 1.28; what a parameter may be stands with the model in `surrogate`. To let scenarios use a further
car-following model, enter it in `SUMO_MODELS`.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from surrogate.car_following.idm import IDM
from surrogate.car_following.krauss import KRAUSS
from surrogate.car_following.wiedemann99 import WIEDEMANN_99_SUMO
from surrogate.lane_change.registry import LC2013
from surrogate.vehicle.car_following_model import CarFollowingModel
from surrogate.vehicle.model_entry import ModelEntry, Parameter
from surrogate.vehicle.vehicle_class import DESIRED_SPEED, VehicleClass

CLASS_DEFAULTS: dict[str, dict[str, float]] = {
    "passenger": {"length": 5.0, "minGap": 2.5, "accel": 2.6, "decel": 4.5, "emergencyDecel": 9.0, "maxSpeed": 55.55},
    "delivery": {"length": 6.5, "minGap": 2.5, "accel": 2.6, "decel": 4.5, "emergencyDecel": 9.0, "maxSpeed": 55.55},
    "truck": {"length": 7.1, "minGap": 2.5, "accel": 1.3, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 36.11},
    "trailer": {"length": 16.5, "minGap": 2.5, "accel": 1.1, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 36.11},
    "bus": {"length": 12.0, "minGap": 2.5, "accel": 1.2, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 23.61},
    "coach": {"length": 14.0, "minGap": 2.5, "accel": 2.0, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 27.78},
}  # source: SUMO documentation, "Vehicle Type Parameter Defaults"


@dataclass(frozen=True)
class Attribute:
    """A vType attribute that the surrogate knows."""

    name: str  # SUMO's
    # record of a `VehicleClass` that holds it, "car_following" or "lane_change"; empty for the class itself
    record: str
    field: str  # field of the record
    # SUMO's value where the vType is silent; None where the vehicle class, or another attribute, decides
    default: float | None = None
    factor: float = 1.0  # SI units in one of SUMO's
    own_unit: str = ""  # SUMO's unit where the factor is not 1

    def of(self, vehicle_class: VehicleClass) -> Any:
        """Return the field of a class."""
        return getattr(getattr(vehicle_class, self.record) if self.record else vehicle_class, self.field)


@dataclass(frozen=True)
class SumoModel:
    """A car-following model that scenarios may name."""

    entry: ModelEntry[CarFollowingModel]  # the model in the surrogate
    attributes: tuple[Attribute, ...]  # those of its own that decide how a vehicle follows its leader
    follows_by_decel: bool = True  # whether `decel` does so, too, or is for stops and lane changes only


_COMMON = (
    Attribute("length", "", "length_m"),
    Attribute("maxSpeed", "", "max_speed_mps"),
    Attribute("speedFactor", "", "speed_factor_mean", 1.0),
    Attribute("speedDev", "", "speed_factor_deviation", 0.1),
    Attribute("decel", "car_following", "max_deceleration_mps2"),
    Attribute("emergencyDecel", "car_following", "emergency_deceleration_mps2"),
    Attribute("lcStrategic", "lane_change", "strategic", 1.0),
    Attribute("lcCooperative", "lane_change", "cooperative", 1.0),
    Attribute("lcCooperativeSpeed", "lane_change", "cooperative_speed"),  # that of lcCooperative
    Attribute("lcSpeedGain", "lane_change", "speed_gain", 1.0),
    Attribute("lcSpeedGainRight", "lane_change", "speed_gain_right", 0.1),
    Attribute("lcSpeedGainRemainTime", "lane_change", "speed_gain_remain_time_s", 20.0),
    Attribute("lcKeepRight", "lane_change", "keep_right", 1.0),
    Attribute("lcAssertive", "lane_change", "assertive", 1.0),
    Attribute("lcLookaheadLeft", "lane_change", "look_ahead_left", 2.0),
)


def following(name: str, field: str, default: float | None = None, factor: float = 1.0, unit: str = "") -> Attribute:
    """Return an attribute that is a field of the car-following model; see `Attribute`."""
    return Attribute(name, "car_following", field, default, factor, unit)


_BASIC = (
    following("minGap", "jam_gap_m"),
    following("tau", "time_gap_s", 1.0),
    following("accel", "max_acceleration_mps2"),
)
SUMO_MODELS: dict[str, SumoModel] = {
    "IDM": SumoModel(IDM, (*_BASIC, following("delta", "acceleration_exponent", 4.0))),
    "Krauss": SumoModel(KRAUSS, (*_BASIC, following("sigma", "imperfection", 0.5))),
    "W99": SumoModel(
        WIEDEMANN_99_SUMO,
        (
            following("minGap", "cc0_standstill_gap_m"),
            following("cc1", "cc1_time_gap_s", 1.3),
            following("cc2", "cc2_following_variation_m", 8.0),
            following("cc3", "cc3_following_threshold_s", -12.0),
            following("cc4", "cc4_negative_speed_threshold_mps", -0.25),
            following("cc5", "cc5_positive_speed_threshold_mps", 0.35),
            following("cc6", "cc6_oscillation_speed_dependency", 6.0),
            following("cc7", "cc7_oscillation_acceleration_mps2", 0.25),
            following("cc8", "cc8_standstill_acceleration_mps2", 2.0),
            following("cc9", "cc9_acceleration_at_80kmh_mps2", 1.5),
        ),
        follows_by_decel=False,
    ),
}


# Of SUMO's models that the surrogate lacks; what a driver wants (a time gap, an acceleration) is the same there.
NEAREST_MODEL = {
    "IDMM": "IDM", "EIDM": "IDM", "ACC": "IDM", "CACC": "IDM", "Wiedemann": "W99", "KraussOrig1": "Krauss",
    "KraussPS": "Krauss", "KraussX": "Krauss", "SmartSK": "Krauss", "Daniel1": "Krauss", "PWagner2009": "Krauss",
    "BKerner": "Krauss", "Rail": "Krauss",
}  # fmt: skip
# norm(mean, deviation) or normc(mean, deviation, least, most)
SPEED_DISTRIBUTION = re.compile(r"(normc?)\(([^,)]*)(?:,([^,)]*))?((?:,[^,)]*){0,2})\)")


@dataclass(frozen=True)
class UnknownAttributeError(ValueError):
    """An attribute that the surrogate does not know for this model."""

    attribute: str
    known: tuple[str, ...]

    def __str__(self) -> str:
        """List the known ones."""
        return f"unknown attribute '{self.attribute}'; known are {', '.join(self.known)}"


def attributes_of(model: str) -> dict[str, Attribute]:
    """Return the attributes that the surrogate knows for a car-following model, by name."""
    return {one.name: one for one in (*SUMO_MODELS[model].attributes, *_COMMON)}


def known_attributes(model: str) -> tuple[str, ...]:
    """Return the names of the attributes that the surrogate knows for a car-following model."""
    return tuple(attributes_of(model))


def following_attributes(model: str) -> tuple[str, ...]:
    """Return the attributes that decide how a vehicle follows its leader."""
    one = SUMO_MODELS[model]
    return (*(attribute.name for attribute in one.attributes), *(("decel",) if one.follows_by_decel else ()))


def habit_attributes(model: str) -> tuple[str, ...]:
    """Return what a driver's time gap, acceleration and deceleration are called."""
    fields = SUMO_MODELS[model].entry.model.habit_fields
    attributes = [one for one in attributes_of(model).values() if one.record == "car_following"]
    return tuple(one.name for field in fields for one in attributes if one.field == field)


def parameter_of(model: str, attribute: Attribute) -> Parameter | None:
    """Return the row that says what an attribute may be; None for what is no parameter of behaviour."""
    if attribute.record == "car_following":
        return SUMO_MODELS[model].entry.row(attribute.field)
    if attribute.record == "lane_change":
        return LC2013.row(attribute.field)
    return next((row for row in DESIRED_SPEED if row.name == attribute.field), None)


def nearest_model(name: str) -> str:
    """The car-following model of `SUMO_MODELS` that is nearest to one of SUMO's."""
    return name if name in SUMO_MODELS else NEAREST_MODEL.get(name, "Krauss")


def attribute_values(
    attributes: Mapping[str, str], model: str, said: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return every known attribute of a vType as a number, SUMO's default where the vType is silent.

    Args:
        attributes: attributes as written in the file.
        model: car-following model, one of `SUMO_MODELS`.
        said: numbers that SUMO itself gives for the vType; they stand where the file is silent, or says no number.

    Raises:
        ValueError: a value is not a number; the message names the attribute.
    """
    known = attributes_of(model)
    by_class = CLASS_DEFAULTS.get(attributes.get("vClass", "passenger"), CLASS_DEFAULTS["passenger"])
    if said:  # of models without imperfection SUMO says -1
        by_class = by_class | {name: value for name, value in said.items() if value >= 0.0}
    written = dict(attributes)
    distribution = SPEED_DISTRIBUTION.fullmatch(written.get("speedFactor", "").replace(" ", ""))
    if distribution:
        written["speedFactor"] = distribution.group(2)
        written.setdefault("speedDev", distribution.group(3) or "0")  # an attribute of its own counts
    values: dict[str, float] = {}
    for name, attribute in known.items():
        text = written.get(name)
        if text is None:
            default = by_class.get(name, attribute.default)
            if default is not None:
                values[name] = default
            continue
        number = _number(text)
        if number is None and not math.isfinite((said or {}).get(name, math.nan)):
            raise ValueError(f"attribute '{name}': expected a number, got '{text}'")
        values[name] = by_class[name] if number is None else number  # the first: what SUMO makes of it
    values.setdefault("lcCooperativeSpeed", values["lcCooperative"])
    values["emergencyDecel"] = max(values["emergencyDecel"], values["decel"])
    return values


def _number(text: str) -> float | None:
    """Return the finite number that a text says; None if it says none."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def vehicle_class(values: Mapping[str, float], model: str) -> VehicleClass:
    """Return the surrogate's vehicle class for numeric attributes."""
    fields: dict[str, dict[str, Any]] = {"": {}, "car_following": {}, "lane_change": {}}
    for name, one in attributes_of(model).items():
        fields[one.record][one.field] = jnp.asarray(one.factor * values[name], jnp.float32)
    return VehicleClass(
        car_following=SUMO_MODELS[model].entry.assemble(fields["car_following"]),
        lane_change=LC2013.assemble(fields["lane_change"]),
        **fields[""],
    )


def with_attribute(vehicle_class: VehicleClass, model: str, attribute: str, value: Any) -> VehicleClass:
    """Return the class with one attribute changed; works on traced values.

    Raises:
        UnknownAttributeError: the surrogate does not know it.
    """
    known = attributes_of(model)
    if attribute not in known:
        raise UnknownAttributeError(attribute, tuple(known))
    one = known[attribute]
    changed = eqx.tree_at(one.of, vehicle_class, value if one.factor == 1.0 else one.factor * value)
    if attribute == "decel":  # SUMO never lets the emergency deceleration lie below
        emergency = jnp.maximum(changed.car_following.emergency_deceleration_mps2, value)
        changed = eqx.tree_at(lambda c: c.car_following.emergency_deceleration_mps2, changed, emergency)
    return changed
