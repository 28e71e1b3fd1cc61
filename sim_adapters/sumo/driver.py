"""Drives SUMO's subject vehicle with the surrogate's own code: SUMO says who is where and carries out what it is told.

Only the worker process that holds the simulation uses this, and only where the subject vehicle has a driver of its
own; then, and only then, that process loads JAX.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from sim_adapters.interface import RunRequest
from sim_adapters.sumo.job import SumoJob
from sim_adapters.sumo.logged_drive import NO_SPEED_CHECKS, SumoReplay
from sim_adapters.sumo.surroundings import Surroundings, vehicle_arrays
from sim_adapters.world.logged_drive import LoggedDrive, log_of
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.inflow.inflow import subject_identity
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.kinematics import move
from surrogate.loop.step import look_up_lane
from surrogate.loop.world import Clock
from surrogate.road.neighbours import own_leader
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.subject.planner import Planner, plan
from surrogate.subject.view import look_around
from surrogate.vehicle.lane_change_model import STAY
from surrogate.vehicle.vehicle_class import VehicleClass

ONLY_WHAT_IS_TOLD = 256  # SUMO's lane-change mode: no changes of its own, and none into a vehicle


@dataclass(frozen=True)
class SubjectControl:
    """What a worker needs to drive the subject vehicle; leaves are NumPy arrays, so that it can be sent there."""

    road: Road  # the surrogate's road
    classes: tuple[VehicleClass, ...]  # vehicle classes, the subject vehicle's last
    class_of_vtype: Mapping[str, int]  # index of each other vehicle's vType among the classes
    planner: Planner | None  # its planner; None where it follows by a model and changes lane as SUMO does
    steps_per_decision: int  # steps between two plans
    first_step: int  # step of the first plan, on the scenario's clock
    step_s: float  # length of a step
    seed: int  # seed of the run
    identity: int  # what keys the subject vehicle's random numbers
    log: LoggedDrive | None = None  # the drive that it repeats instead; None where it decides for itself


class Driver(Protocol):
    """Tells SUMO what the subject vehicle does."""

    def enters(self, step: int) -> bool:
        """Put the vehicle, which waits to enter, on the road before the coming step; return False to let SUMO do it."""
        ...

    def before_step(self, step: int) -> bool:
        """Tell SUMO what the vehicle, which is on the road, does in the coming step; return False to end the run."""
        ...


def driver_of(libsumo: Any, control: SubjectControl, job: SumoJob) -> Driver:
    """Return who drives the subject vehicle of a job."""
    if control.log is not None:
        return SumoReplay(libsumo, control.log, job.subject_vehicles[0], control.step_s, job.lane_place)
    return SumoDriver(libsumo, control, job.subject_vehicles[0], job.radius_m, job.lane_place)


def subject_control(
    template: WorldTemplate, request: RunRequest, clock: Clock, first_step: int
) -> SubjectControl | None:
    """Return how to drive the subject vehicle in a run; None where SUMO does.

    Args:
        template: the scenario, with the model of its subject vehicle.
        request: the run.
        clock: the surrogate's, so that both plan at the same instants.
        first_step: step of the surrogate's first decision.
    """
    if not template.subject_model.is_controlled:
        return None
    world = template.world(
        jnp.asarray(request.values, jnp.float32), jnp.asarray(request.seed), jnp.asarray(request.depart_s)
    )
    planner = world.driver if isinstance(world.driver, Planner) else None
    road, classes, planner = jax.tree.map(np.asarray, (world.road, world.classes, planner))
    drives = template.logged_drives
    return SubjectControl(
        road=road,
        classes=classes,
        # without the subject vehicle's own class, whose vType others may have as well
        class_of_vtype={name: index for index, name in enumerate(template.class_names[:-1])},
        planner=planner,
        steps_per_decision=clock.steps_per_decision,
        first_step=first_step,
        step_s=clock.step_s,
        seed=request.seed,
        identity=subject_identity(world.inflow.num_entrances),
        log=log_of(drives, request.drive) if drives else None,
    )


class SumoDriver:
    """Tells SUMO, before every step, how fast the subject vehicle is after it and whether it changes lane."""

    def __init__(
        self,
        libsumo: Any,
        control: SubjectControl,
        vehicle: str,
        radius_m: float,
        lane_place: Mapping[str, tuple[int, float, bool]],
    ) -> None:
        """Prepare to drive; the vehicle need not be there yet.

        Args:
            libsumo: the simulation of this process.
            control: how to drive.
            vehicle: id of the vehicle.
            radius_m: distance up to which other vehicles count.
            lane_place: row, begin on the route's axis, and whether it is carriageway, of each lane.
        """
        self._sumo, self._control, self._vehicle = libsumo, control, vehicle
        self._radius_m, self._lane_place = radius_m, lane_place
        self._held_mps2 = np.float32(np.inf)
        self._is_there = False

    def enters(self, step: int) -> bool:
        """Leave it to SUMO when the vehicle enters."""
        del step
        return False

    def before_step(self, step: int) -> bool:
        """Tell SUMO what the vehicle does in the coming step."""
        vehicles = self._sumo.vehicle
        if not self._is_there:
            self._begin()
        around = self._look_around()
        if around is None:
            return True  # between two lanes that we know
        arrays, head, entry = vehicle_arrays(around, self._control.road.num_rows)
        plans = self._control.planner is not None and (
            (step - self._control.first_step) % self._control.steps_per_decision == 0
        )
        speed_mps, direction, self._held_mps2 = _control(
            arrays, head, entry, self._control.road, self._control.classes, self._control.planner,
            self._held_mps2, plans, np.int32(self._control.seed), np.int32(step), np.int32(self._control.identity),
            interval_s=self._control.steps_per_decision * self._control.step_s,
            step_s=self._control.step_s,
        )  # fmt: skip
        vehicles.setSpeed(self._vehicle, float(speed_mps))
        if int(direction) != STAY:
            lane = vehicles.getLaneIndex(self._vehicle) + int(direction)
            vehicles.changeLane(self._vehicle, lane, self._control.step_s)
        return True

    def _begin(self) -> None:
        constants, vehicles = self._sumo.constants, self._sumo.vehicle
        self._is_there = True
        vehicles.setSpeedMode(self._vehicle, NO_SPEED_CHECKS)
        if self._control.planner is not None:
            vehicles.setLaneChangeMode(self._vehicle, ONLY_WHAT_IS_TOLD)
        self._names = (
            constants.VAR_LANE_ID, constants.VAR_LANEPOSITION, constants.VAR_SPEED,
            constants.VAR_ACCELERATION, constants.VAR_TYPE,
        )  # fmt: skip
        vehicles.subscribeContext(self._vehicle, constants.CMD_GET_VEHICLE_VARIABLE, self._radius_m, self._names)
        self._speed_factor = vehicles.getSpeedFactor(self._vehicle)

    def _look_around(self) -> Surroundings | None:
        """Return who is around; None once the vehicle has left."""
        seen = self._sumo.vehicle.getContextSubscriptionResults(self._vehicle)
        table = []
        subject = -1
        for name, values in seen.items():
            lane, position, speed, acceleration, vtype = (values[key] for key in self._names)
            place = self._lane_place.get(lane)
            if place is None:
                continue
            if name == self._vehicle:
                subject = len(table)
            number = self._control.class_of_vtype.get(vtype, 0)
            if name == self._vehicle:
                number = len(self._control.classes) - 1
            table.append((place[0], place[1] + position, speed, acceleration, number))
        if subject < 0:
            return None
        row, position_m, speed_mps, acceleration_mps2, vehicle_class = np.asarray(table, float).T
        return Surroundings(
            row=row.astype(int),
            position_m=position_m,
            speed_mps=speed_mps,
            acceleration_mps2=acceleration_mps2,
            vehicle_class=vehicle_class.astype(int),
            subject=subject,
            speed_factor=self._speed_factor,
        )


@partial(jax.jit, static_argnames=("interval_s", "step_s"))
def _control(
    vehicles: VehicleArrays,
    head: Int[Array, " row_plus_one"],
    entry: Int[Array, ""],
    road: Road,
    classes: tuple[VehicleClass, ...],
    planner: Planner | None,
    held_mps2: Float[Array, ""],
    plans: Bool[Array, ""],
    seed: Int[Array, ""],
    step: Int[Array, ""],
    identity: Int[Array, ""],
    interval_s: float,
    step_s: float,
) -> tuple[Float[Array, ""], Int[Array, ""], Float[Array, ""]]:
    """Return the subject vehicle's next speed, the lane change it begins, and the acceleration it plans to keep."""
    on_road = VehiclesOnRoad(vehicles, road, head)
    direction = jnp.asarray(STAY, jnp.int32)
    if planner is not None:
        view = look_around(vehicles, head, road, classes, len(classes) - 1, planner.ahead_m, planner.behind_m)

        def again() -> tuple[Array, Array]:
            chosen = plan(planner, view, interval_s)
            return chosen.direction.astype(jnp.int32), chosen.acceleration_mps2

        direction, held_mps2 = jax.lax.cond(plans, again, lambda: (direction, held_mps2))
        own_advice = vehicles.own_advice_mps2.at[entry].set(held_mps2)
        vehicles = with_changes(vehicles, own_advice_mps2=own_advice)
    vehicles = look_up_lane(vehicles, on_road)
    nobody_asks = jnp.ones_like(vehicles.speed_mps)
    vehicles = with_changes(vehicles, identity=vehicles.identity.at[entry].set(identity))
    moved, _ = move(vehicles, own_leader(vehicles), classes, nobody_asks, seed, step, step_s)
    return moved.speed_mps[entry], direction, held_mps2
