"""Lets SUMO's vehicles follow by another vType beyond the subject vehicle's sensors, as the surrogate's loop does.

It runs in the worker process that holds the simulation, and loads no JAX.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class DistantTypes:
    """Which vTypes change, and when."""

    distant_vtypes: Mapping[str, str]  # vType as which each of these vTypes follows beyond the sensors' range
    ahead_m: float  # range of the sensors ahead
    behind_m: float  # range behind
    steps_per_decision: int  # steps between two looks
    first_step: int  # step of the first look, on the scenario's clock


class TypeSwitch:
    """Changes vehicles' types before a step, at the instants of the surrogate's decisions."""

    def __init__(
        self,
        libsumo: Any,
        types: DistantTypes,
        vehicle: str,
        radius_m: float,
        lane_place: Mapping[str, tuple[int, float, bool]],
    ) -> None:
        """Prepare; nobody need be there yet.

        Args:
            libsumo: the simulation of this process.
            types: which vTypes change.
            vehicle: id of the subject vehicle.
            radius_m: distance up to which SUMO is asked for vehicles; more than the sensors' range.
            lane_place: row, begin on the route's axis, and whether it is carriageway, of each lane.
        """
        self._vehicles, self._constants, self._types = libsumo.vehicle, libsumo.constants, types
        self._subject, self._radius_m, self._lane_place = vehicle, radius_m, lane_place
        self._near: set[str] = set()
        self._newcomers: list[str] = []
        self._is_there = False

    def departed(self, names: tuple[str, ...] | list[str]) -> None:
        """Take note of vehicles that have entered in the last step."""
        self._newcomers += names
        if not self._is_there and self._subject in names:
            self._is_there = True
            constants = self._constants
            self._names = (constants.VAR_LANE_ID, constants.VAR_LANEPOSITION)
            kind = constants.CMD_GET_VEHICLE_VARIABLE
            self._vehicles.subscribeContext(self._subject, kind, self._radius_m, self._names)

    def before_step(self, step: int) -> None:
        """Change the types of those who have come near or fallen behind since the last look."""
        if (step - self._types.first_step) % self._types.steps_per_decision:
            return
        near = self._who_is_near()
        there = set(self._vehicles.getIDList())
        for name in (self._near | set(self._newcomers)) - near:
            if name in there:
                self._change(name, self._types.distant_vtypes)
        back = {distant: one for one, distant in self._types.distant_vtypes.items()}
        for name in near - self._near:
            self._change(name, back)
        self._near, self._newcomers = near, []

    def _change(self, name: str, to: Mapping[str, str]) -> None:
        if name == self._subject:
            return
        vtype = to.get(self._vehicles.getTypeID(name))
        if vtype is not None:
            self._vehicles.setType(name, vtype)

    def _who_is_near(self) -> set[str]:
        if not self._is_there:
            return set()
        place_m = {}
        for name, values in self._vehicles.getContextSubscriptionResults(self._subject).items():
            lane, position_m = (values[key] for key in self._names)
            place = self._lane_place.get(lane)
            if place is not None:
                place_m[name] = place[1] + position_m
        here_m = place_m.pop(self._subject, None)
        if here_m is None:
            return self._near  # between two lanes that we know
        ahead_m, behind_m = self._types.ahead_m, self._types.behind_m
        return {name for name, there_m in place_m.items() if -behind_m <= there_m - here_m <= ahead_m}
