"""What an effect is: a name, a unit, a range of strength, and functions at the places where it acts.

A simulator with effects holds all of the registry. Strength, place and time of each are leaves, so that one program
runs any mix of them under `vmap`. At strength 0 every function returns its argument bit for bit: multiply by 1, add 0,
or choose with `where`.
"""

import enum
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from surrogate.road.drive_table import DriveTable, LogFormat
from surrogate.road.neighbours import Neighbour
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.vehicle_class import VehicleClass

Value = Float[Array, "..."]
Memory = dict[str, Array]  # what an effect remembers of each vehicle, or of the frames before


class ActsOn(enum.StrEnum):
    """Where an effect acts."""

    PERCEPTION = "perception"
    DECISION = "decision"
    ACTUATION = "actuation"
    ROAD = "road"
    DEMAND = "demand"
    COMPOSITION = "composition"
    SENSOR = "sensor"


class SearchedAt(enum.StrEnum):
    """At which places and times a diagnosis looks for an effect."""

    EVERYWHERE = "everywhere"
    STRETCHES = "stretches"  # where drivers accelerate otherwise than expected, all the time
    SPELLS = "spells"  # where and while vehicles are slow, for some minutes
    LANE_POINTS = "points of a lane"  # likewise; the choice is the lane, the strength how long it lasts


class Reading(enum.StrEnum):
    """What of an effect's strength a log tells by itself, whatever traffic makes of the effect."""

    DISTANCE_SCALE = "distance scale"
    LATENCY = "latency"


class Dial(eqx.Module):
    """The setting of one effect in one run."""

    strength: Value  # 0 where the effect is absent; its unit is the effect's
    route_from_m: Value  # where along the subject vehicle's route it begins
    route_to_m: Value  # where it ends
    time_from_s: Value  # when it begins, on the scenario's clock
    time_to_s: Value  # when it ends
    choice: Value  # which lane or input, as the effect says
    time_constant_s: Value  # how long its consequences last, as the effect says

    FIELDS: ClassVar[tuple[str, ...]] = (
        "strength", "route_from_m", "route_to_m", "time_from_s", "time_to_s", "choice", "time_constant_s",
    )  # fmt: skip

    @property
    def is_on(self) -> Bool[Array, "..."]:
        """Whether the effect is there at all."""
        return self.strength != 0.0

    def covers(self, position_m: Value, time_s: Value) -> Bool[Array, "..."]:
        """Whether the effect acts at this place and time."""
        here = (position_m >= self.route_from_m) & (position_m < self.route_to_m)
        return here & (time_s >= self.time_from_s) & (time_s < self.time_to_s)


@dataclass(frozen=True)
class EffectSetting:
    """What a caller asks of one effect; what is left out is everywhere, always, and the effect's default."""

    strength: float  # in the effect's unit; 0 is off
    # position along the subject vehicle's route, as in `PerceptionFrame.subject_position_m`
    route_from_m: float | None = None
    route_to_m: float | None = None  # position at which the effect ends
    time_from_s: float | None = None  # time on the scenario's clock
    time_to_s: float | None = None  # time at which it ends
    choice: float | None = None  # see `Effect.choice`
    time_constant_s: float | None = None  # see `Effect.time_constant`


class Moment(eqx.Module):
    """What an effect may look at while vehicles move or decide."""

    vehicles: VehicleArrays  # all vehicles, with what effects remember of them
    classes: tuple[VehicleClass, ...]  # vehicle classes; that of the subject vehicle is the last
    seed: Int[Array, ""]  # seed of the run
    step: Int[Array, ""]  # number of the step
    step_s: float = eqx.field(static=True)  # its length
    second_leader: Neighbour | None = None  # the leader of each vehicle's leader; None where vehicles do not move

    @property
    def time_s(self) -> Float[Array, ""]:
        """Time on the scenario's clock."""
        return self.step.astype(jnp.float32) * self.step_s

    @property
    def is_subject(self) -> Bool[Array, " vehicle"]:
        """Which vehicle is the subject vehicle."""
        return self.vehicles.vehicle_class == len(self.classes) - 1

    @property
    def is_background(self) -> Bool[Array, " vehicle"]:
        """Which entries are vehicles with a human driver."""
        return self.vehicles.is_vehicle & ~self.is_subject

    def memory(self, effect: str) -> Memory:
        """The effect's memory of each vehicle."""
        assert self.vehicles.personal is not None
        return self.vehicles.personal[effect]


class Newcomers(eqx.Module):
    """Drivers who ask to enter."""

    identity: Int[Array, "entrance rank"]  # keys their random numbers
    vehicle_class: Int[Array, "entrance rank"]
    speed_factor: Float[Array, "entrance rank"]  # desired speed over the limit
    is_subject: Bool[Array, "entrance rank"]  # which is the subject vehicle
    # number of the class that the effect has added, if it adds one
    added_class: int = eqx.field(static=True, default=-1)


class Arrivals(eqx.Module):
    """Arrivals at the entrances."""

    arrival: Int[Array, " entrance"]  # number of the next vehicle of each entrance
    num_lanes: Int[Array, " entrance"]  # lanes of each entrance
    demand_vehps: Float[Array, " entrance"]  # demand of each entrance
    is_mainline: Bool[Array, " entrance"]  # whether the subject vehicle enters there
    seed: Int[Array, ""]  # seed of the run


Hook = Callable[..., Any] | None
Alter = Callable[[DriveTable, float, LogFormat, np.random.Generator], DriveTable]


@dataclass(frozen=True)
class Effect:
    """One effect: its description, and its functions, each None where it does not act there.

    The first argument of every function is the effect's `Dial`.
    """

    name: str  # as results name it
    title: str  # one line for people
    unit: str  # unit of the strength
    weak: float  # strength that is hard to see
    medium: float  # strength as it is commonly found
    strong: float  # strength at the upper end of what is found
    acts_on: ActsOn  # where it acts
    source: str  # where model and range come from
    has_place: bool = False  # whether `route_from_m` and `route_to_m` matter
    has_time: bool = False  # whether `time_from_s` and `time_to_s` matter
    is_signed: bool = False  # whether negative strengths mean something
    choice: str = ""  # what `choice` is; empty where it does not matter
    default_choice: float = 0.0  # its value unless given
    time_constant: str = ""  # what `time_constant_s` is; empty where it does not matter
    default_time_constant_s: float = 1.0  # its value unless given
    # what people call strength 0, where they count from elsewhere: a factor counts from 1
    reported_at_zero: float = 0.0
    is_calibrated: bool = False  # whether a calibration has it among its parameters, whose values then tell it
    speeds_up: bool = False  # whether vehicles are faster, not slower, at a place where a positive strength acts
    # whether the strength is how long it lasts, at one point of a lane, which is the choice
    lasts_as_strength: bool = False
    reading: Reading | None = None  # what of the strength a log tells by itself
    # of an effect that is not a sensor's, strengths each of which leaves a rhythm of its own in a recorded drive;
    # `alter` then leaves positions as they are, and only the vehicles' motion shows it
    rhythms_s: tuple[float, ...] = ()
    is_whole_steps: bool = False  # whether a recorded drive shows multiples of its time step only
    # how SUMO expresses it, where other attributes of the background's vTypes are all: pairs of an attribute and
    # (its value, strength) -> value. What needs more is in `sim_adapters/scenario/sumo_effects.py`.
    vtype_attributes: tuple[tuple[str, Callable[[float, float], float]], ...] = ()
    # (DriveTable, strength, LogFormat, random) -> DriveTable: the effect put into a recorded drive; a sensor's
    # effect without it is put in by `sense`
    alter: Alter | None = None
    inputs: Hook = None  # (dial, inputs [veh/h]) -> inputs
    arrival: Hook = None  # (dial, demand to the next arrival [veh], Arrivals) -> demand to the next arrival
    newcomer: Hook = None  # (dial, Newcomers, seed) -> Newcomers
    behaviour: Hook = None  # (dial, VehicleClass of human drivers) -> VehicleClass
    # (dial, VehicleClass) -> a class of vehicles that the effect adds, made from that of most vehicles
    new_class: Hook = None
    begin: Hook = None  # (dial, VehicleArrays, seed) -> memory of vehicles that enter
    # (dial, VehicleArrays, Road, Moment) -> VehicleArrays, whose limits and stops are those of the road
    road: Hook = None
    perceive: Hook = None  # (dial, FollowingSituation, Moment) -> FollowingSituation
    adapt: Hook = None  # (dial, Habits, Moment) -> Habits
    # (dial, acceleration, desired speed, CarFollowingMix, Moment) -> acceleration that the driver orders
    command: Hook = None
    actuate: Hook = None  # (dial, acceleration, Moment) -> acceleration that the vehicle does
    remember: Hook = None  # (dial, Moment after the step, acceleration ordered) -> memory
    decide: Hook = None  # (dial, LaneChangeDecision, Moment) -> LaneChangeDecision
    settle: Hook = None  # (dial, Moment after the decision, direction in which each vehicle has just changed) -> memory
    appear: Hook = None  # (dial, PerceptionFrame, memory of the vehicle at each object) -> PerceptionFrame
    watch: Hook = None  # (PerceptionFrame) -> memory before the first frame
    sense: Hook = None  # (dial, PerceptionFrame, memory, seed) -> PerceptionFrame, memory

    @property
    def is_sensor_s(self) -> bool:
        """Whether it acts on what sensors report, and leaves traffic as it is."""
        return self.acts_on is ActsOn.SENSOR

    @property
    def slows(self) -> float:
        """1 where a positive strength makes vehicles slower, -1 where it makes them faster."""
        return -1.0 if self.speeds_up else 1.0

    @property
    def searched_at(self) -> SearchedAt:
        """At which places and times a diagnosis looks for it."""
        if not (self.has_place or self.has_time):
            return SearchedAt.EVERYWHERE
        if self.lasts_as_strength:
            return SearchedAt.LANE_POINTS
        return SearchedAt.SPELLS if self.has_time else SearchedAt.STRETCHES
