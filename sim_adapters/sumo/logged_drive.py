"""Lets SUMO's subject vehicle repeat a logged drive: SUMO is told, before every step, where it is after it."""

from collections.abc import Mapping
from typing import Any

from sim_adapters.world.logged_drive import LoggedDrive

NO_SPEED_CHECKS = 32  # SUMO's speed mode: the speed that it is told, whatever SUMO thinks of it
NO_LANE_CHECKS = 0  # SUMO's lane-change mode: no changes of its own, and those that it is told at once
LARGEST_MISS_M = 0.05  # farther from its log, the vehicle is put where it belongs instead of driven there


class SumoReplay:
    """Drives a logged drive.

    The speed is what brings the vehicle to its logged place at the end of the step, so positions are exact and speeds
    are the log's as far as its positions and speeds agree. At its entry it is put where the log begins.
    """

    def __init__(
        self,
        libsumo: Any,
        log: LoggedDrive,
        vehicle: str,
        step_s: float,
        lane_place: Mapping[str, tuple[int, float, bool]],
    ) -> None:
        """Prepare to drive.

        Args:
            libsumo: the simulation of this process.
            log: the drive.
            vehicle: id of the vehicle.
            step_s: length of a step.
            lane_place: row, begin on the route's axis, and whether it is carriageway, of each lane.
        """
        self._sumo, self._log, self._vehicle, self._step_s = libsumo, log, vehicle, step_s
        self._lane_place = lane_place
        self._lanes: list[tuple[int, float, float, str]] = []
        # then a change that SUMO is told would come late: the log shows it half way
        self._changes_take_time = float(libsumo.simulation.getOption("lanechange.duration")) > step_s

    def enters(self, step: int) -> bool:
        """Put the vehicle where its log begins, whoever is there, if it has departed but SUMO finds no room for it."""
        sample = step - self._log.first_step
        if not 0 <= sample < len(self._log.position_m) or self._vehicle not in self._sumo.vehicle.getLoadedIDList():
            return False
        self._begin()
        return self._put(int(self._log.row[sample]), self._before_m(sample))

    def before_step(self, step: int) -> bool:
        """Tell SUMO where the vehicle is after the coming step; return False where its log is over."""
        vehicles, sample = self._sumo.vehicle, step - self._log.first_step
        if sample >= len(self._log.position_m):
            return False
        self._begin()
        sample = max(sample, 0)  # it may enter before the log begins; then it waits there
        row, position_m = int(self._log.row[sample]), float(self._log.position_m[sample])
        before_m = self._before_m(sample)
        lane = vehicles.getLaneID(self._vehicle)
        place = self._lane_place.get(lane)
        if place is None:
            return False
        here_m = place[1] + vehicles.getLanePosition(self._vehicle)
        is_elsewhere = abs(here_m - before_m) > LARGEST_MISS_M or (self._changes_take_time and row != place[0])
        if is_elsewhere and self._put(row, before_m):
            here_m = before_m
        elif row != place[0]:
            direction = 1 if row > place[0] else -1
            self._change(direction, row)
        vehicles.setSpeed(self._vehicle, max(position_m - here_m, 0.0) / self._step_s)
        return True

    def _before_m(self, sample: int) -> float:
        """Return where the vehicle is one step before a sample."""
        if sample:
            return float(self._log.position_m[sample - 1])
        return float(self._log.position_m[0]) - float(self._log.speed_mps[0]) * self._step_s

    def _begin(self) -> None:
        if self._lanes:
            return
        vehicles = self._sumo.vehicle
        vehicles.setSpeedMode(self._vehicle, NO_SPEED_CHECKS)
        vehicles.setLaneChangeMode(self._vehicle, NO_LANE_CHECKS)
        self._lanes = [
            (row, start_m, start_m + self._sumo.lane.getLength(lane), lane)
            for lane, (row, start_m, is_carriageway) in self._lane_place.items()
            if is_carriageway and not lane.startswith(":")
        ]

    def _put(self, row: int, position_m: float) -> bool:
        """Put the vehicle somewhere; return whether there is a lane."""
        for at_row, begin_m, end_m, lane in self._lanes:
            if at_row == row and begin_m <= position_m < end_m:
                self._sumo.vehicle.moveTo(self._vehicle, lane, position_m - begin_m)
                return True
        return False

    def _change(self, direction: int, row: int) -> None:
        """Change to a row, which may lie beyond more than one lane of the edge."""
        vehicles = self._sumo.vehicle
        edge, index = vehicles.getRoadID(self._vehicle), vehicles.getLaneIndex(self._vehicle)
        target = index + direction
        while (place := self._lane_place.get(f"{edge}_{target}")) is not None and place[0] != row:
            target += direction
        if place is not None:
            vehicles.changeLane(self._vehicle, target, self._step_s)
