"""What stays the same during a run: the world, and the lengths of its steps."""

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.settings import Effects
from surrogate.inflow.inflow import Inflow, SubjectPlan
from surrogate.lane_change.manoeuvre import (
    ChangeTiming,
    change_timing,
)
from surrogate.loop.distant import DistantDrivers
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays
from surrogate.subject.logged_drive import LoggedMotion
from surrogate.subject.planner import Planner
from surrogate.vehicle.vehicle_class import VehicleClass


class Clock(eqx.Module):
    """Lengths of steps; choices of the trace."""

    step_s: float = eqx.field(static=True)  # car-following step
    steps_per_decision: int = eqx.field(static=True)  # steps between two decisions about lanes, arrivals and perception
    lane_change_duration_s: float = eqx.field(static=True, default=0.0)  # time that a lane change takes; 0 for none

    @property
    def change_timing(self) -> ChangeTiming | None:
        """When things happen in a lane change; None if it takes no time."""
        return change_timing(self.lane_change_duration_s, self.step_s, self.interval_s)

    @property
    def interval_s(self) -> float:
        """Time between two decisions."""
        return self.step_s * self.steps_per_decision


class World(eqx.Module):
    """Everything that stays the same during a run."""

    road: Road  # geometry
    inflow: Inflow  # where and as what vehicles enter
    classes: tuple[VehicleClass, ...]  # vehicle classes; that of the subject vehicle is the last
    demand_vehps: Float[Array, " entrance"]  # demand of each entrance
    subject: SubjectPlan  # when and where the subject vehicle enters
    seed: Int[Array, ""]  # seed of the run
    # what the baseline lacks; None for the baseline, whose program then knows nothing of effects
    effects: Effects | None = None
    driver: Planner | LoggedMotion | None = None  # who drives the subject vehicle, if not the models of its class
    # which vehicles follow otherwise beyond the sensors' range; None where none does
    distant: DistantDrivers | None = None
    # where along its way the subject vehicle, or each of several, is observed; None where it is all the way
    recorded_m: Float[Array, "*subject part 2"] | None = None

    @property
    def subject_class(self) -> int:
        """Class of the subject vehicle."""
        return len(self.classes) - 1

    def is_subject(self, vehicles: VehicleArrays) -> Bool[Array, " vehicle"]:
        """Which vehicle is the subject vehicle, or which are, if there are several."""
        return vehicles.vehicle_class == self.subject_class
