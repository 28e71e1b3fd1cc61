"""What a SUMO worker is asked to run, and what it sends back."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sim_adapters.sumo.distant import DistantTypes

if TYPE_CHECKING:  # it loads JAX, which a worker needs only where the subject vehicle has a driver of its own
    from sim_adapters.sumo.driver import SubjectControl

LOG_FILE = "errors.log"  # in the folder of a run


class SumoFailedError(RuntimeError):
    """SUMO's reason to end; its own exceptions hold an object of C++, which cannot be sent to another process."""


@dataclass(frozen=True)
class SumoJob:
    """A run to make.

    Attributes:
        config: configuration to run.
        folder: where outputs go; removed by whoever made it.
        seed: SUMO's seed.
        subject_vehicles: ids of the subject vehicles, by departure.
        end_s: when the run ends at the latest.
        radius_m: distance from a subject vehicle up to which vehicles are written.
        frame_interval_s: time between two frames.
        lane_place: row, begin on the route's axis, and whether it is carriageway, of each lane.
        entrance_of_flow: number of the entrance of each flow.
        num_entrances: number of entrances.
        counted_edges: edges at whose end vehicles are counted; with any, the run goes on to its end.
        control: how to drive the subject vehicle, of which there is one then; None where SUMO does.
        distant: which vehicles follow by another vType beyond the sensors' range, of one subject vehicle then; None
            where none does.
    """

    config: Path
    folder: Path
    seed: int
    subject_vehicles: tuple[str, ...]
    end_s: float
    radius_m: float
    frame_interval_s: float
    lane_place: Mapping[str, tuple[int, float, bool]]
    entrance_of_flow: Mapping[str, int]
    num_entrances: int
    counted_edges: tuple[str, ...] = ()
    control: "SubjectControl | None" = None
    distant: DistantTypes | None = None


@dataclass(frozen=True)
class SumoRun:
    """What is left of a run; arrays have one entry per frame and vehicle, in order of time.

    Attributes:
        time_s: time of the frame.
        vehicle: number of the vehicle by first detection; -1 is the first subject vehicle, -2 the next.
        row: row of the road.
        position_m: front bumper on the route's axis.
        speed_mps: speed.
        acceleration_mps2: acceleration.
        lateral_m: offset from the centre of the lane, + left.
        num_arrived: vehicles that asked to enter, per entrance.
        num_inserted: vehicles that entered, per entrance.
        num_collisions: vehicle steps in a collision.
        num_subject_overlaps: steps in which a subject vehicle that is told what to do is in a collision.
        num_teleports: vehicles that SUMO removed.
        num_vehicle_steps: vehicles on the road, summed over steps.
        subject_left: whether the subject vehicle, each of them, reached its destination.
        wall_s: computing time.
        passed_s: when vehicles passed the end of each counted edge.
    """

    time_s: np.ndarray
    vehicle: np.ndarray
    row: np.ndarray
    position_m: np.ndarray
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray
    lateral_m: np.ndarray
    num_arrived: np.ndarray
    num_inserted: np.ndarray
    num_collisions: int
    num_subject_overlaps: int
    num_teleports: int
    num_vehicle_steps: int
    subject_left: tuple[bool, ...]
    wall_s: float
    passed_s: Mapping[str, np.ndarray]
