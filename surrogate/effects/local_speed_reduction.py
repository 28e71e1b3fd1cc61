"""Everybody wants to drive slower on one stretch: a curve, a narrow lane, a camera."""

import jax.numpy as jnp

from surrogate.effects.base import ActsOn, Dial, Effect, Moment
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes

ANNOUNCED_M = 200.0  # how far ahead drivers see that they must slow down


def _road(dial: Dial, vehicles: VehicleArrays, road: Road, moment: Moment) -> VehicleArrays:
    """Lower the limit on the stretch, and announce it to those who come, as for a legal limit."""
    del road
    position = vehicles.position_m
    share = 1.0 - dial.strength
    is_there = dial.covers(position, moment.time_s)
    lower = vehicles.speed_limit_mps * share
    announced_m = dial.route_from_m - position
    comes = (
        dial.is_on & (announced_m > 0.0) & (announced_m < ANNOUNCED_M) & (dial.route_from_m < vehicles.slow_position_m)
    )
    comes &= lower < vehicles.speed_limit_mps
    return with_changes(
        vehicles,
        speed_limit_mps=jnp.where(is_there, lower, vehicles.speed_limit_mps),
        slow_position_m=jnp.where(comes, dial.route_from_m, vehicles.slow_position_m),
        slow_limit_mps=jnp.where(comes, lower, vehicles.slow_limit_mps),
    )


LOCAL_SPEED_REDUCTION = Effect(
    name="local_speed_reduction",
    title="everybody slower on one stretch",
    unit="share of the desired speed lost there",
    weak=0.08,
    medium=0.15,
    strong=0.25,
    acts_on=ActsOn.ROAD,
    source="v = min(v0, sqrt(a_lat / curvature)) with a_lat of 2 to 3 m/s2, reduced to its share; range by judgement",
    has_place=True,
    road=_road,
)
