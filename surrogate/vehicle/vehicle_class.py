"""Vehicle classes: what all vehicles of one vType share, and how to read it for arrays of mixed vehicles."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Shaped

from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.habits import HABIT_OF_FIELD, Habits, with_habits
from surrogate.vehicle.lane_change_model import LaneChangeModel
from surrogate.vehicle.model_entry import Parameter

Value = Float[Array, "..."]
Record = TypeVar("Record", bound=eqx.Module)
DESIRED_SPEED = (
    Parameter("speed_factor_mean", 1.0, 0.6, 1.4, step=0.015),
    Parameter("speed_factor_deviation", 0.1, 0.01, 0.3),
)


class VehicleClass(eqx.Module):
    """One vType. Every number is a leaf, so that hundreds of parameter sets run under one `vmap`."""

    car_following: CarFollowingModel  # model and parameters
    lane_change: LaneChangeModel  # model and parameters
    length_m: Value  # length of the vehicle
    max_speed_mps: Value  # highest speed, whatever the limit
    speed_factor_mean: Value  # mean of desired speed over limit
    speed_factor_deviation: Value  # standard deviation of it between drivers


def select_by_class(values: Sequence[Shaped[Array, "..."]], vehicle_class: Int[Array, "..."]) -> Shaped[Array, "..."]:
    """Return for each entry the value of its class; heads and empty entries get that of class 0.

    A chain of selects, because there are few classes and a gather costs more than two of them.
    """
    chosen = jnp.broadcast_to(values[0], vehicle_class.shape)
    for index in range(1, len(values)):
        chosen = jnp.where(vehicle_class == index, values[index], chosen)
    return chosen


def select_record(records: Sequence[Record], vehicle_class: Int[Array, "..."]) -> Record:
    """Return one record whose leaves hold, for each entry, the leaf of its class."""
    return jax.tree.map(lambda *leaves: select_by_class(leaves, vehicle_class), *records)


class CarFollowingMix(eqx.Module):
    """The car-following models of an array of vehicles that may belong to different classes.

    Each kind of model that occurs is computed once for the whole array; a vehicle takes the result of its own.
    """

    models: tuple[CarFollowingModel, ...]  # model of each class
    vehicle_class: Int[Array, "..."]  # class of each vehicle
    habits: Habits | None = None  # how each driver differs from his class; None where none does

    def field(self, name: str) -> Value:
        """Return a field that all models have, e.g. `jam_gap_m`."""
        value = select_by_class([getattr(model, name) for model in self.models], self.vehicle_class)
        if self.habits is not None and name in HABIT_OF_FIELD:
            value = value * getattr(self.habits, HABIT_OF_FIELD[name])
        return value

    def _each(self, ask: Callable[[CarFollowingModel], Value]) -> Value:
        answer = None
        for kind in dict.fromkeys(type(model) for model in self.models):
            members = [index for index, model in enumerate(self.models) if type(model) is kind]
            own = [model if type(model) is kind else self.models[members[0]] for model in self.models]
            record = select_record(own, self.vehicle_class)
            value = ask(record if self.habits is None else with_habits(record, self.habits))
            if answer is None:
                answer = value
            else:
                is_member = (
                    jnp.isin(self.vehicle_class, jnp.asarray(members))
                    if len(members) > 1
                    else (self.vehicle_class == members[0])
                )
                answer = jnp.where(is_member, value, answer)
        assert answer is not None
        return answer

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """See `CarFollowingModel.acceleration`."""
        return self._each(lambda model: model.acceleration(situation, step_s))

    def stop_acceleration(self, situation: FollowingSituation, distance_m: Value, step_s: float) -> Value:
        """See `CarFollowingModel.stop_acceleration`."""
        return self._each(lambda model: model.stop_acceleration(situation, distance_m, step_s))

    def slow_acceleration(
        self, situation: FollowingSituation, distance_m: Value, target_speed_mps: Value, step_s: float
    ) -> Value:
        """See `CarFollowingModel.slow_acceleration`."""
        return self._each(lambda model: model.slow_acceleration(situation, distance_m, target_speed_mps, step_s))

    def secure_gap_m(
        self, speed_mps: Value, leader_speed_mps: Value, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """See `CarFollowingModel.secure_gap_m`."""
        return self._each(
            lambda model: model.secure_gap_m(speed_mps, leader_speed_mps, leader_deceleration_mps2, step_s)
        )

    def insertion_speed_mps(
        self, situation: FollowingSituation, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """See `CarFollowingModel.insertion_speed_mps`."""
        return self._each(lambda model: model.insertion_speed_mps(situation, leader_deceleration_mps2, step_s))

    def follow_speed_mps(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the speed after one step, >= 0, that the models want."""
        return jnp.maximum(0.0, situation.speed_mps + step_s * self.acceleration(situation, step_s))
