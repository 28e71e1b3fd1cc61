"""Moves vehicles by one time step: what the drivers want, what the vehicles can do, where they are then."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import actuate, habits_of, order_acceleration, perceive_situation, remember_step
from surrogate.effects.base import Moment
from surrogate.effects.settings import Effects
from surrogate.keyed_random import Purpose, uniform
from surrogate.lane_change.surroundings import desired_speed_mps
from surrogate.road.neighbours import Neighbour
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.vehicle.vehicle_limits import limited_acceleration, next_speed_mps
from surrogate.xla.materialise import materialise

Value = Float[Array, " vehicle"]
BEFORE_ALL_STEPS = -1  # keys the random number that a driver keeps


def move(
    vehicles: VehicleArrays,
    leader: Neighbour,
    classes: tuple[VehicleClass, ...],
    cooperative_speed: Value,
    seed: Int[Array, ""],
    step: Int[Array, ""],
    step_s: float,
    effects: Effects | None = None,
    second: Neighbour | None = None,
    leader_beside: Neighbour | None = None,
) -> tuple[VehicleArrays, Bool[Array, " vehicle"]]:
    """Return the vehicles one step later, and which overlap their leader.

    Args:
        vehicles: the vehicles.
        leader: leader of each in its own row.
        classes: vehicle classes.
        cooperative_speed: weight, 0 to 1, with which each vehicle heeds what others' lane changing asks of it.
        seed: seed of the run.
        step: number of this step.
        step_s: its length.
        effects: what the baseline lacks; None for the baseline.
        second: leader of each leader; effects ask for it.
        leader_beside: another leader that each vehicle follows as well, while lane changes take time; None if they do
            not.

    Source: SUMO's semi-implicit Euler update, `MSCFModel::finalizeSpeed` and `MSLCM_LC2013::_patchSpeed`: the speed
    changes first, within [v - emergency deceleration, v + max acceleration] and up to the desired speed, then the
    position by the new speed. An advice counts if it is neither harder than
    braking nor faster than the model allows; a vehicle's own counts in full, another's with `cooperative_speed`.
    """
    lengths = [c.length_m for c in classes]
    gap_m = leader.position_m - select_by_class(lengths, leader.vehicle_class) - vehicles.position_m
    is_vehicle = vehicles.is_vehicle
    v = vehicles.speed_mps
    desired_mps = desired_speed_mps(vehicles, classes)
    situation = FollowingSituation(
        speed_mps=v,
        gap_m=jnp.where(leader.exists, gap_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        acceleration_mps2=vehicles.acceleration_mps2,
        desired_speed_mps=desired_mps,
        uniform=_random(vehicles, classes, seed, step),
    )
    moment, habits = Moment(vehicles, classes, seed, step, step_s, second), None
    if effects is not None:
        situation, habits = materialise((perceive_situation(effects, situation, moment), habits_of(effects, moment)))
    model = CarFollowingMix(tuple(c.car_following for c in classes), vehicles.vehicle_class, habits)
    acceleration = model.acceleration(situation, step_s)
    if leader_beside is not None:
        other = behind(leader_beside, situation, vehicles, lengths)
        acceleration = jnp.minimum(acceleration, model.acceleration(other, step_s))
    stop_m = vehicles.stop_position_m - vehicles.position_m
    acceleration = jnp.minimum(acceleration, model.stop_acceleration(situation, stop_m, step_s))
    slow_m = vehicles.slow_position_m - vehicles.position_m
    slow_mps = jnp.minimum(desired_mps, vehicles.speed_factor * vehicles.slow_limit_mps)
    acceleration = jnp.minimum(acceleration, model.slow_acceleration(situation, slow_m, slow_mps, step_s))

    acceleration = limited_acceleration(
        acceleration,
        v,
        desired_mps,
        model.field("max_acceleration_mps2"),
        model.field("max_deceleration_mps2"),
        model.field("emergency_deceleration_mps2"),
        step_s,
    )
    standstill = -v / step_s  # advice to go backwards is ignored
    asked, own = vehicles.asked_advice_mps2, vehicles.own_advice_mps2
    is_asked = (asked <= acceleration) & (asked >= standstill)
    heeded = jnp.where(is_asked, acceleration + cooperative_speed * (asked - acceleration), acceleration)
    acceleration = jnp.minimum(heeded, jnp.where((own <= acceleration) & (own >= standstill), own, acceleration))
    acceleration = order = materialise(acceleration)
    if effects is not None:
        order = order_acceleration(effects, acceleration, desired_mps, model, moment)
        acceleration = materialise(actuate(effects, order, moment))
    new_v = jnp.where(is_vehicle, next_speed_mps(v, acceleration, step_s), 0.0)
    collided = is_vehicle & leader.exists & (gap_m < 0.0)
    moved = jnp.where(is_vehicle, vehicles.position_m + step_s * new_v, vehicles.position_m)
    vehicles = with_changes(
        vehicles, position_m=moved, speed_mps=new_v, acceleration_mps2=jnp.where(is_vehicle, (new_v - v) / step_s, 0.0)
    )
    if effects is not None:
        vehicles = remember_step(effects, Moment(vehicles, classes, seed, step, step_s), order)
    return vehicles, collided


def behind(
    leader: Neighbour, situation: FollowingSituation, vehicles: VehicleArrays, lengths: list[Array]
) -> FollowingSituation:
    """Return the same situation behind another leader."""
    rear_m = leader.position_m - select_by_class(lengths, leader.vehicle_class)
    return dataclasses.replace(
        situation,
        gap_m=jnp.where(leader.exists, rear_m - vehicles.position_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
    )


def _random(
    vehicles: VehicleArrays, classes: tuple[VehicleClass, ...], seed: Int[Array, ""], step: Int[Array, ""]
) -> Value:
    """Return each driver's random number: the one of this step, or the one that he keeps if his model wants that."""
    of_step = uniform(seed, vehicles.identity, step, Purpose.CAR_FOLLOWING)
    is_kept = [c.car_following.draws_once_per_driver for c in classes]
    if not any(is_kept):
        return of_step
    kept = uniform(seed, vehicles.identity, BEFORE_ALL_STEPS, Purpose.CAR_FOLLOWING)
    return jnp.where(select_by_class([jnp.asarray(k) for k in is_kept], vehicles.vehicle_class), kept, of_step)
