"""One question, two engines: what does the subject vehicle observe under these parameter values?"""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from surrogate.effects.base import EffectSetting


class Status(enum.Enum):
    """How a run ended; its value is what a user should know."""

    OK = "ok"
    COLLIDED = "vehicles overlapped for a longer time"
    NONFINITE = "speeds or positions became infinite or not a number"
    OVERFULL = "more vehicles than the surrogate's arrays hold; raise the capacity"
    SUBJECT_MISSING = "the subject vehicle never entered; the entrance was full"
    UNSEEN = "the subject vehicle never drove where it is observed"
    FAILED = "the simulator failed"

    @property
    def is_ok(self) -> bool:
        """Whether the run may win, breed and enter a mean."""
        return self is Status.OK


@dataclass(frozen=True)
class ParameterLayout:
    """Which number of a parameter vector means what."""

    input_ids: tuple[str, ...]  # inputs in the order of the vector's first part, values in veh/h
    input_flows: tuple[tuple[str, ...], ...]  # flow ids of each input
    vtypes: tuple[str, ...]  # vTypes whose attributes the second part sets
    attributes: tuple[str, ...]  # SUMO attributes in the order in which the second part has them, once for each group
    # factor on each attribute's value for each vType, [vtype, attribute], where vTypes of a group differ by factors
    factors: tuple[tuple[float, ...], ...] = ()
    most: tuple[float, ...] = ()  # that each attribute can be, however large its factor
    # groups of vTypes with values of their own, in the order of the second part; empty where all are one group
    groups: tuple[tuple[str, ...], ...] = ()

    def factors_of(self, vtype: str) -> tuple[tuple[float, float], ...]:
        """Factor on each attribute's value for a vType, and the most that it may become by it."""
        if not self.factors:
            return ((1.0, math.inf),) * len(self.attributes)
        return tuple(zip(self.factors[self.vtypes.index(vtype)], self.most, strict=True))

    def begin_of(self, vtype: str) -> int:
        """Place in the vector's second part where the values of a vType's group begin."""
        return next(i for i, group in enumerate(self.vtype_groups) if vtype in group) * len(self.attributes)

    def values_of(self, vtype: str, behaviour: Sequence[float]) -> dict[str, float]:
        """A vType's attributes for the second part of a parameter vector."""
        begin = self.begin_of(vtype)
        of_group = behaviour[begin : begin + len(self.attributes)]
        return {
            attribute: value if factor == 1.0 else min(factor * value, most)
            for attribute, value, (factor, most) in zip(self.attributes, of_group, self.factors_of(vtype), strict=True)
        }

    @property
    def vtype_groups(self) -> tuple[tuple[str, ...], ...]:
        """Groups of vTypes with values of their own; the vector has those of the first of each."""
        return self.groups or (self.vtypes,)

    @property
    def driver_parameters(self) -> tuple[tuple[str, str], ...]:
        """VType, the first of its group, and attribute of each number of the vector's second part."""
        return tuple((group[0], attribute) for group in self.vtype_groups for attribute in self.attributes)

    @property
    def num_inputs(self) -> int:
        """Number of inputs."""
        return len(self.input_ids)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all numbers of the vector: ids of inputs, then attributes, with a vType where groups have theirs."""
        is_apart = len(self.vtype_groups) > 1
        own = (f"{attribute}[{vtype}]" if is_apart else attribute for vtype, attribute in self.driver_parameters)
        return (*self.input_ids, *own)

    def names_of(self, attribute: str) -> tuple[str, ...]:
        """Names of an attribute's numbers, one for each group."""
        of_drivers = zip(self.names[self.num_inputs :], self.driver_parameters, strict=True)
        return tuple(name for name, (_, own) in of_drivers if own == attribute)


NO_DRIVE = -1  # a run that stands for no drive in particular


class DriveStart(NamedTuple):
    """When the subject vehicle departs, and in which of the recorded drives."""

    depart_s: float
    drive: int = NO_DRIVE  # its number in the case, where it differs from others that depart then


@dataclass(frozen=True)
class RunRequest:
    """One run to make.

    Attributes:
        values: parameter vector in the order of the layout.
        seed: seed of the run.
        depart_s: when the subject vehicle departs.
        effects: unmodelled effects by name; only a simulator with effects can have any.
        also_depart_s: when further subject vehicles of the same run depart; requests that differ in nothing but which
            of its subject vehicles they ask for are answered by one run.
        drive: number of the recorded drive that the run stands for: its subject vehicle is observed where that log is,
            and repeats it if it is to repeat one. NO_DRIVE is observed on all of the route, and repeats the first.
    """

    values: tuple[float, ...]
    seed: int
    depart_s: float
    effects: Mapping[str, EffectSetting] = field(default_factory=dict)
    also_depart_s: tuple[float, ...] = ()
    drive: int = NO_DRIVE

    @property
    def drive_start(self) -> DriveStart:
        """When the subject vehicle departs, and in which drive."""
        return DriveStart(self.depart_s, self.drive)


@dataclass(frozen=True)
class RunOutcome:
    """What came of a run."""

    request: RunRequest  # what was asked
    status: Status  # whether it may be used
    observed: Any  # final state of the observer, NumPy leaves; None where the run failed
    num_arrived: np.ndarray  # vehicles that asked to enter, per entrance
    num_inserted: np.ndarray  # vehicles that entered, per entrance
    num_collisions: int  # vehicle steps with overlap
    num_teleports: int = 0  # vehicles that the simulator removed
    num_subject_overlaps: int = 0  # steps in which a subject vehicle that repeats its log overlaps another vehicle
    num_vehicle_steps: int = 0  # vehicles on the road, summed over steps; 0 where it is not counted
    subject_left: bool = True  # whether the subject vehicle reached its destination before the run ended
    # computing time of this run alone, where it is known; its share where one run answered several requests
    wall_s: float = float("nan")
    log_tail: str = field(default="", repr=False)  # the simulator's last words if it failed

    @property
    def backlog_share(self) -> float:
        """Share of the demand that had not entered by the end."""
        arrived = float(self.num_arrived.sum())
        return 1.0 - float(self.num_inserted.sum()) / arrived if arrived > 0 else 0.0


class Simulator(Protocol):
    """An engine that makes runs."""

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        ...

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order; failures are outcomes, not exceptions."""
        ...
