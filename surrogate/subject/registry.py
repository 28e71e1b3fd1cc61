"""Every model that may drive the subject vehicle, by name, with its parameters, their ranges and usual values."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from surrogate.car_following.common_parameters import JAM_GAP, MAX_ACCELERATION, TIME_GAP
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.registry import CAR_FOLLOWING_MODELS, car_following_model
from surrogate.subject.following import driven_by
from surrogate.subject.planner import Planner
from surrogate.vehicle.model_entry import Parameter, UnknownModelError, check_range
from surrogate.vehicle.vehicle_class import VehicleClass

VTYPE, PLANNER, REPLAY = "vtype", "planner", "replay"
DESCRIPTIONS = {
    VTYPE: "the models of its vType, as SUMO drives it",
    PLANNER: "a behavioural and motion planner that claims its way",
    REPLAY: "the logged drive, whatever the traffic around it does",
} | {entry.name: f"{entry.description}; lanes as its vType" for entry in CAR_FOLLOWING_MODELS}
SUBJECT_MODELS = tuple(DESCRIPTIONS)

PLANNER_PARAMETERS = (
    Parameter("safety_weight", 1.0, 0.0, 100.0),
    Parameter("efficiency_weight", 1.0, 0.0, 100.0),
    Parameter("comfort_weight", 0.5, 0.0, 100.0),
    JAM_GAP,
    TIME_GAP,
    MAX_ACCELERATION,
    Parameter("comfortable_deceleration_mps2", 2.0, 0.5, 6.0),
    Parameter("yield_deceleration_mps2", 1.5, 0.1, 4.0),
    Parameter("claim_time_gap_s", 0.5, 0.1, 3.0),
    Parameter("reaction_s", 0.3, 0.1, 2.0),
)


@dataclasses.dataclass(frozen=True)
class SubjectModel:
    """Who drives the subject vehicle.

    Attributes:
        name: one of `SUBJECT_MODELS`.
        parameters: own values by name; usual ones where none is given.
    """

    name: str = VTYPE
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def check(self) -> None:
        """Check names and values.

        Raises:
            UnknownModelError: there is no such model or parameter; the message lists the known ones.
            ParameterRangeError: a value is not finite or outside its range.
        """
        if self.name not in SUBJECT_MODELS:
            known = ", ".join(SUBJECT_MODELS)
            raise UnknownModelError(f"there is no subject model '{self.name}'; known are {known}.")
        if self.name == VTYPE and self.parameters:
            raise UnknownModelError(f"{VTYPE} has no parameters; those of the vType stand in the scenario.")
        if self.name == PLANNER:
            _check_planner(self.parameters)
        elif self.name == REPLAY and self.parameters:
            raise UnknownModelError(f"{REPLAY} has no parameters; the log says all.")
        elif self.name not in (VTYPE, REPLAY):
            car_following_model(self.name).build(self.parameters)

    @property
    def is_controlled(self) -> bool:
        """Whether SUMO has to be told at every step what the subject vehicle does."""
        return self.name != VTYPE

    def planner(self, ahead_m: float, behind_m: float) -> Planner | None:
        """Return the planner for sensors of the given range; None where the model is another."""
        if self.name != PLANNER:
            return None
        numbers = {one.name: one.usual for one in PLANNER_PARAMETERS} | dict(self.parameters)
        numbers |= {"ahead_m": ahead_m, "behind_m": behind_m}
        leaves: dict[str, Any] = {name: jnp.asarray(value, jnp.float32) for name, value in numbers.items()}
        return Planner(**leaves)

    def vehicle_class(self, vtype: VehicleClass) -> VehicleClass:
        """Return the subject vehicle's class: its vType with this driver."""
        if self.name in (VTYPE, REPLAY):
            return vtype
        if self.name == PLANNER:
            planner = self.planner(0.0, 0.0)
            assert planner is not None
            return driven_by(vtype, guard(planner, vtype))
        return driven_by(vtype, car_following_model(self.name).build(self.parameters))


def guard(planner: Planner, vtype: VehicleClass) -> Krauss:
    """What keeps a planned acceleration safe between two plans: the safe speed behind a leader who may brake."""
    model = vtype.car_following
    return Krauss(
        jam_gap_m=0.5 * planner.jam_gap_m,
        time_gap_s=planner.reaction_s,
        max_acceleration_mps2=planner.max_acceleration_mps2,
        max_deceleration_mps2=model.max_deceleration_mps2,
        emergency_deceleration_mps2=model.emergency_deceleration_mps2,
        imperfection=jnp.zeros_like(planner.reaction_s),
    )


def _check_planner(parameters: Mapping[str, float]) -> None:
    known = {one.name: one for one in PLANNER_PARAMETERS}
    for name, value in parameters.items():
        if name not in known:
            raise UnknownModelError(f"{PLANNER} has no parameter '{name}'; it has {', '.join(known)}.")
        check_range(PLANNER, known[name], float(value))
