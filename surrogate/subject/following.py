"""A subject vehicle that follows by a model of its own, while others take it for a vehicle of its vType."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.vehicle_class import VehicleClass

Value = Float[Array, "..."]


def _of_vtype(name: str) -> Any:
    return property(lambda self: getattr(self.vtype, name), doc="That of the vType.")


class SubjectFollowing(CarFollowingModel):  # pyright: ignore[reportGeneralTypeIssues]  # fields are properties here
    """A driver's model within the limits and the appearance of a vType.

    How the vehicle follows, stops and slows down comes from the driver; what it can do, and the gaps that it and
    others count on when somebody changes lane, from its vType. SUMO knows only the vType, so that both simulators let
    others treat the subject vehicle alike.
    """

    habit_fields: ClassVar[Mapping[str, str]] = MappingProxyType({})  # it is no human driver
    driver: CarFollowingModel  # model that drives
    vtype: CarFollowingModel

    jam_gap_m = _of_vtype("jam_gap_m")
    time_gap_s = _of_vtype("time_gap_s")
    max_acceleration_mps2 = _of_vtype("max_acceleration_mps2")
    max_deceleration_mps2 = _of_vtype("max_deceleration_mps2")
    emergency_deceleration_mps2 = _of_vtype("emergency_deceleration_mps2")

    @property
    def draws_once_per_driver(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the driver does."""
        return self.driver.draws_once_per_driver

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """The driver's acceleration."""
        return self.driver.acceleration(situation, step_s)

    def stop_acceleration(self, situation: FollowingSituation, distance_m: Value, step_s: float) -> Value:
        """The driver's acceleration."""
        return self.driver.stop_acceleration(situation, distance_m, step_s)

    def slow_acceleration(
        self, situation: FollowingSituation, distance_m: Value, target_speed_mps: Value, step_s: float
    ) -> Value:
        """The driver's acceleration."""
        return self.driver.slow_acceleration(situation, distance_m, target_speed_mps, step_s)

    def secure_gap_m(
        self, speed_mps: Value, leader_speed_mps: Value, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the gap of the vType."""
        return self.vtype.secure_gap_m(speed_mps, leader_speed_mps, leader_deceleration_mps2, step_s)


def driven_by(vehicle_class: VehicleClass, driver: CarFollowingModel) -> VehicleClass:
    """Return the class with another driver in the same vehicle."""
    following = SubjectFollowing(driver=driver, vtype=vehicle_class.car_following)  # pyright: ignore[reportCallIssue]
    return eqx.tree_at(lambda c: c.car_following, vehicle_class, following)
