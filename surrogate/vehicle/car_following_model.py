"""What every car-following model answers.

A model is a record of its parameters; each field is one number per vehicle (or one for all). To add a model: write one
file with a subclass, give it the five common fields and the four methods, and a `ModelEntry` that says what its
parameters may be; enter that in `surrogate.car_following.registry`, and every law test runs for it.
"""

import abc
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Value = Float[Array, "..."]
HALVINGS = 12


class FollowingSituation(eqx.Module):
    """What a driver reacts to."""

    speed_mps: Value  # own speed >= 0
    gap_m: Value  # leader's rear bumper minus own front bumper; inf means no leader
    leader_speed_mps: Value  # the leader's speed; any finite number where there is no leader
    leader_acceleration_mps2: Value  # the leader's acceleration in the last step
    acceleration_mps2: Value  # own acceleration in the last step
    desired_speed_mps: Value  # speed > 0 wanted on this lane
    uniform: Value  # random number in (0, 1) for models that need one


class CarFollowingModel(eqx.Module):
    """A car-following model with its parameters. Decelerations are positive numbers.

    Attributes:
        jam_gap_m: gap kept at standstill.
        time_gap_s: desired time gap, which lane changing also takes for the reaction time (SUMO's tau).
        max_acceleration_mps2: upper bound of the acceleration.
        max_deceleration_mps2: deceleration that the driver is ready to use (SUMO's decel).
        emergency_deceleration_mps2: physical bound of the deceleration.
        draws_once_per_driver: whether the random number of a situation stays the driver's own; else each step has one.
        habit_fields: the numbers in which drivers of one class may differ, each with its field of `Habits`.
    """

    draws_once_per_driver: ClassVar[bool] = False
    habit_fields: ClassVar[Mapping[str, str]] = MappingProxyType(
        {"time_gap_s": "time_gap", "max_acceleration_mps2": "acceleration", "max_deceleration_mps2": "deceleration"}
    )
    jam_gap_m: eqx.AbstractVar[Value]
    time_gap_s: eqx.AbstractVar[Value]
    max_acceleration_mps2: eqx.AbstractVar[Value]
    max_deceleration_mps2: eqx.AbstractVar[Value]
    emergency_deceleration_mps2: eqx.AbstractVar[Value]

    @abc.abstractmethod
    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the wanted acceleration [m/s^2], not yet limited to what the vehicle can do."""

    @abc.abstractmethod
    def stop_acceleration(self, situation: FollowingSituation, distance_m: Value, step_s: float) -> Value:
        """Return the acceleration that lets the vehicle stand after `distance_m`; inf means no such place."""

    @abc.abstractmethod
    def slow_acceleration(
        self, situation: FollowingSituation, distance_m: Value, target_speed_mps: Value, step_s: float
    ) -> Value:
        """Return the acceleration that brings the vehicle to a lower speed by `distance_m`; inf where it may go on."""

    @abc.abstractmethod
    def secure_gap_m(
        self, speed_mps: Value, leader_speed_mps: Value, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the gap, beyond the jam gap, that a driver demands before somebody changes lane in front of him."""

    def insertion_speed_mps(
        self, situation: FollowingSituation, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the highest speed, no more than that of the situation, with which a vehicle may be put on the road.

        The gap of the situation is the one that the vehicle would have. Its secure gap is to fit into it; where it does
        not at any speed, the vehicle is put there standing.

        Source: `MSCFModel::insertionFollowSpeed`, the safe speed behind the leader.
        Deviation: found by halving, to a four-thousandth of the speed.
        """
        free_m = situation.gap_m - self.jam_gap_m
        leader_mps = situation.leader_speed_mps

        def fits(speed: Value) -> Bool[Array, "..."]:
            return self.secure_gap_m(speed, leader_mps, leader_deceleration_mps2, step_s) <= free_m

        wanted = situation.speed_mps
        low, step = jnp.zeros_like(wanted), 0.5 * wanted
        for _ in range(HALVINGS):
            low = jnp.where(fits(low + step), low + step, low)
            step = 0.5 * step
        return jnp.where(fits(wanted), wanted, low)


def follow_speed_mps(model: CarFollowingModel, situation: FollowingSituation, step_s: float) -> Value:
    """Return the speed after one step, >= 0, that the model wants; acceleration limits are not applied."""
    return jnp.maximum(0.0, situation.speed_mps + step_s * model.acceleration(situation, step_s))
