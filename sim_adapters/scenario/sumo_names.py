"""SUMO's vType attributes and where the surrogate keeps them.

Attributes are the names by which users know the parameters, so they are jaxcalib's parameter names as well; all of
them are in SI, so no factor is needed. Defaults are those of SUMO 1.28 for the vehicle class "passenger".
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from surrogate.car_following.idm import Idm
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.wiedemann99 import Wiedemann99Sumo
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.vehicle.car_following_model import CarFollowingModel
from surrogate.vehicle.vehicle_class import VehicleClass

CLASS_DEFAULTS: dict[str, dict[str, float]] = {
    "passenger": {"length": 5.0, "minGap": 2.5, "accel": 2.6, "decel": 4.5, "emergencyDecel": 9.0, "maxSpeed": 55.55},
    "delivery": {"length": 6.5, "minGap": 2.5, "accel": 2.6, "decel": 4.5, "emergencyDecel": 9.0, "maxSpeed": 55.55},
    "truck": {"length": 7.1, "minGap": 2.5, "accel": 1.3, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 36.11},
    "trailer": {"length": 16.5, "minGap": 2.5, "accel": 1.1, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 36.11},
    "bus": {"length": 12.0, "minGap": 2.5, "accel": 1.2, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 23.61},
    "coach": {"length": 14.0, "minGap": 2.5, "accel": 2.0, "decel": 4.0, "emergencyDecel": 7.0, "maxSpeed": 27.78},
}  # source: SUMO documentation, "Vehicle Type Parameter Defaults"

COMMON_DEFAULTS: dict[str, float] = {
    "speedFactor": 1.0,
    "speedDev": 0.1,
    "lcStrategic": 1.0,
    "lcCooperative": 1.0,
    "lcSpeedGain": 1.0,
    "lcSpeedGainRight": 0.1,
    "lcSpeedGainRemainTime": 20.0,
    "lcKeepRight": 1.0,
    "lcAssertive": 1.0,
    "lcLookaheadLeft": 2.0,
}

MODEL_DEFAULTS: dict[str, dict[str, float]] = {
    "IDM": {"tau": 1.0, "delta": 4.0},
    "Krauss": {"tau": 1.0, "sigma": 0.5},
    "W99": {
        "cc1": 1.3, "cc2": 8.0, "cc3": -12.0, "cc4": -0.25, "cc5": 0.35,
        "cc6": 6.0, "cc7": 0.25, "cc8": 2.0, "cc9": 1.5,
    },
}  # fmt: skip

Place = Callable[[Any], Any]  # of a VehicleClass, whose models have fields of their own

_COMMON: dict[str, Place] = {
    "length": lambda c: c.length_m,
    "maxSpeed": lambda c: c.max_speed_mps,
    "speedFactor": lambda c: c.speed_factor_mean,
    "speedDev": lambda c: c.speed_factor_deviation,
    "decel": lambda c: c.car_following.max_deceleration_mps2,
    "emergencyDecel": lambda c: c.car_following.emergency_deceleration_mps2,
    "lcStrategic": lambda c: c.lane_change.strategic,
    "lcCooperative": lambda c: c.lane_change.cooperative,
    "lcCooperativeSpeed": lambda c: c.lane_change.cooperative_speed,
    "lcSpeedGain": lambda c: c.lane_change.speed_gain,
    "lcSpeedGainRight": lambda c: c.lane_change.speed_gain_right,
    "lcSpeedGainRemainTime": lambda c: c.lane_change.speed_gain_remain_time_s,
    "lcKeepRight": lambda c: c.lane_change.keep_right,
    "lcAssertive": lambda c: c.lane_change.assertive,
    "lcLookaheadLeft": lambda c: c.lane_change.look_ahead_left,
}
_IDM: dict[str, Place] = {
    "minGap": lambda c: c.car_following.jam_gap_m,
    "tau": lambda c: c.car_following.time_gap_s,
    "accel": lambda c: c.car_following.max_acceleration_mps2,
}
_MODEL: dict[str, dict[str, Place]] = {
    "IDM": _IDM | {"delta": lambda c: c.car_following.acceleration_exponent},
    "Krauss": _IDM | {"sigma": lambda c: c.car_following.imperfection},
    "W99": {
        "minGap": lambda c: c.car_following.cc0_standstill_gap_m,
        "cc1": lambda c: c.car_following.cc1_time_gap_s,
        "cc2": lambda c: c.car_following.cc2_following_variation_m,
        "cc3": lambda c: c.car_following.cc3_following_threshold_s,
        "cc4": lambda c: c.car_following.cc4_negative_speed_threshold_mps,
        "cc5": lambda c: c.car_following.cc5_positive_speed_threshold_mps,
        "cc6": lambda c: c.car_following.cc6_oscillation_speed_dependency,
        "cc7": lambda c: c.car_following.cc7_oscillation_acceleration_mps2,
        "cc8": lambda c: c.car_following.cc8_standstill_acceleration_mps2,
        "cc9": lambda c: c.car_following.cc9_acceleration_at_80kmh_mps2,
    },
}
MODELS = tuple(_MODEL)
# Of SUMO's models that the surrogate lacks; what a vehicle wants (a time gap, an acceleration) is the same there.
NEAREST_MODEL = {
    "IDMM": "IDM", "EIDM": "IDM", "ACC": "IDM", "CACC": "IDM", "Wiedemann": "W99", "KraussOrig1": "Krauss",
    "KraussPS": "Krauss", "KraussX": "Krauss", "SmartSK": "Krauss", "Daniel1": "Krauss", "PWagner2009": "Krauss",
    "BKerner": "Krauss", "Rail": "Krauss",
}  # fmt: skip


@dataclass(frozen=True)
class UnknownAttributeError(ValueError):
    """An attribute that the surrogate does not know for this model."""

    attribute: str
    known: tuple[str, ...]

    def __str__(self) -> str:
        """List the known ones."""
        return f"unknown attribute '{self.attribute}'; known are {', '.join(self.known)}"


def known_attributes(model: str) -> tuple[str, ...]:
    """Return the attributes that the surrogate knows for a car-following model."""
    return tuple(_MODEL[model]) + tuple(_COMMON)


def following_attributes(model: str) -> tuple[str, ...]:
    """Return the attributes that decide how a vehicle follows its leader."""
    return tuple(_MODEL[model]) + (() if model == "W99" else ("decel",))  # SUMO's W99 takes decel for lane changes only


def nearest_model(name: str) -> str:
    """The car-following model of the surrogate that is nearest to one of SUMO's."""
    return name if name in MODELS else NEAREST_MODEL.get(name, "Krauss")


def attribute_values(
    attributes: Mapping[str, str], model: str, said: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return every known attribute of a vType as a number, SUMO's default where the vType is silent.

    Args:
        attributes: attributes as written in the file.
        model: car-following model, one of `MODELS`.
        said: numbers that SUMO itself gives for the vType; they stand for what the file does not say.

    Raises:
        ValueError: a value is not a number; the message names the attribute.
    """
    defaults = COMMON_DEFAULTS | CLASS_DEFAULTS.get(attributes.get("vClass", "passenger"), CLASS_DEFAULTS["passenger"])
    defaults = defaults | MODEL_DEFAULTS[model]
    if said:
        defaults |= {name: value for name, value in said.items() if name in defaults or name == "sigma"}
        if model not in ("Krauss",) or defaults.get("sigma", 0.0) < 0.0:
            defaults.pop("sigma", None)  # of models without imperfection SUMO says -1
            defaults |= {"sigma": MODEL_DEFAULTS["Krauss"]["sigma"]} if model == "Krauss" else {}
    written = dict(attributes)
    factor = written.get("speedFactor", "").replace(" ", "")
    distribution = re.fullmatch(r"norm(c?)\(([^,)]*)(?:,([^,)]*))?(?:,[^)]*)?\)", factor)
    if distribution:
        written["speedFactor"], written["speedDev"] = distribution.group(2), distribution.group(3) or "0"
    values: dict[str, float] = {}
    for name in known_attributes(model):
        text = written.get(name)
        if text is None:
            if name in defaults:
                values[name] = defaults[name]
            continue
        try:
            values[name] = float(text)
        except ValueError:
            raise ValueError(f"attribute '{name}': expected a number, got '{text}'") from None
    values.setdefault("lcCooperativeSpeed", values["lcCooperative"])
    values["emergencyDecel"] = max(values["emergencyDecel"], values["decel"])
    return values


def vehicle_class(values: Mapping[str, float], model: str) -> VehicleClass:
    """Return the surrogate's vehicle class for numeric attributes."""
    v = {name: jnp.asarray(value, jnp.float32) for name, value in values.items()}
    return VehicleClass(
        car_following=_car_following(v, model),
        lane_change=Lc2013(
            strategic=v["lcStrategic"],
            cooperative=v["lcCooperative"],
            cooperative_speed=v["lcCooperativeSpeed"],
            speed_gain=v["lcSpeedGain"],
            speed_gain_right=v["lcSpeedGainRight"],
            speed_gain_remain_time_s=v["lcSpeedGainRemainTime"],
            keep_right=v["lcKeepRight"],
            assertive=v["lcAssertive"],
            look_ahead_left=v["lcLookaheadLeft"],
        ),
        length_m=v["length"],
        max_speed_mps=v["maxSpeed"],
        speed_factor_mean=v["speedFactor"],
        speed_factor_deviation=v["speedDev"],
    )


def with_attribute(vehicle_class: VehicleClass, model: str, attribute: str, value: Any) -> VehicleClass:
    """Return the class with one attribute changed; works on traced values.

    Raises:
        UnknownAttributeError: the surrogate does not know it.
    """
    place = (_MODEL[model] | _COMMON).get(attribute)
    if place is None:
        raise UnknownAttributeError(attribute, known_attributes(model))
    changed = eqx.tree_at(place, vehicle_class, value)
    if attribute == "decel":  # SUMO never lets the emergency deceleration lie below
        emergency = jnp.maximum(changed.car_following.emergency_deceleration_mps2, value)
        changed = eqx.tree_at(lambda c: c.car_following.emergency_deceleration_mps2, changed, emergency)
    return changed


def _car_following(v: Mapping[str, Any], model: str) -> CarFollowingModel:
    if model == "W99":
        return Wiedemann99Sumo(  # pyright: ignore[reportCallIssue]  # three common fields are properties there
            cc0_standstill_gap_m=v["minGap"],
            cc1_time_gap_s=v["cc1"],
            cc2_following_variation_m=v["cc2"],
            cc3_following_threshold_s=v["cc3"],
            cc4_negative_speed_threshold_mps=v["cc4"],
            cc5_positive_speed_threshold_mps=v["cc5"],
            cc6_oscillation_speed_dependency=v["cc6"],
            cc7_oscillation_acceleration_mps2=v["cc7"],
            cc8_standstill_acceleration_mps2=v["cc8"],
            cc9_acceleration_at_80kmh_mps2=v["cc9"],
            max_deceleration_mps2=v["decel"],
            emergency_deceleration_mps2=v["emergencyDecel"],
        )
    shared = {
        "jam_gap_m": v["minGap"],
        "time_gap_s": v["tau"],
        "max_acceleration_mps2": v["accel"],
        "max_deceleration_mps2": v["decel"],
        "emergency_deceleration_mps2": v["emergencyDecel"],
    }
    if model == "IDM":
        return Idm(**shared, acceleration_exponent=v["delta"])
    return Krauss(**shared, imperfection=v["sigma"])
