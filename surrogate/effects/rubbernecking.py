"""Some drivers slow down to look at something beside the road, at one place for some time."""

import jax.numpy as jnp

from surrogate.effects.base import ActsOn, Dial, Effect, Moment
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes

SPEED_LOST = 0.35


def _road(dial: Dial, vehicles: VehicleArrays, road: Road, moment: Moment) -> VehicleArrays:
    del road
    is_curious = uniform(moment.seed, vehicles.identity, 0, Purpose.RUBBERNECK) < dial.strength
    looks = is_curious & moment.is_background & dial.covers(vehicles.position_m, moment.time_s)
    limit = jnp.where(looks, (1.0 - SPEED_LOST) * vehicles.speed_limit_mps, vehicles.speed_limit_mps)
    return with_changes(vehicles, speed_limit_mps=limit)


RUBBERNECKING = Effect(
    name="rubbernecking",
    title="some drivers slow down to look, at one place for some time",
    unit="share of drivers who slow by 35 %",
    weak=0.2,
    medium=0.4,
    strong=0.7,
    acts_on=ActsOn.ROAD,
    source="a shoulder accident leaves 0.81 to 0.93 of the capacity: HCM as quoted in FHWA-HOP-13-042, appendix A",
    has_place=True,
    has_time=True,
    road=_road,
)
