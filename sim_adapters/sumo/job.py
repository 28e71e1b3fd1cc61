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
    """A run to make."""

    config: Path  # configuration to run; the files that it names lie beside it, but for the network
    net_file: Path  # the network
    folder: Path  # where outputs go; removed by whoever made it
    seed: int  # SUMO's seed
    subject_vehicles: tuple[str, ...]  # ids of the subject vehicles, by departure
    end_s: float  # when the run ends at the latest
    radius_m: float  # distance from a subject vehicle up to which vehicles are written
    frame_interval_s: float  # time between two frames
    # row, begin on the route's axis, and whether it is carriageway, of each lane
    lane_place: Mapping[str, tuple[int, float, bool]]
    entrance_of_flow: Mapping[str, int]  # number of the entrance of each flow
    num_entrances: int  # number of entrances
    counted_edges: tuple[str, ...] = ()  # edges at whose end vehicles are counted; with any, the run goes on to its end
    # how to drive the subject vehicle, of which there is one then; None where SUMO does
    control: "SubjectControl | None" = None
    # which vehicles follow by another vType beyond the sensors' range, of one subject vehicle then; None where
    # none does
    distant: DistantTypes | None = None


@dataclass(frozen=True)
class SumoRun:
    """What is left of a run; arrays have one entry per frame and vehicle, in order of time."""

    time_s: np.ndarray  # time of the frame
    vehicle: np.ndarray  # number of the vehicle by first detection; -1 is the first subject vehicle, -2 the next
    row: np.ndarray  # row of the road
    position_m: np.ndarray  # front bumper on the route's axis
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray
    lateral_m: np.ndarray  # offset from the centre of the lane, + left
    num_arrived: np.ndarray  # vehicles that asked to enter, per entrance
    num_inserted: np.ndarray  # vehicles that entered, per entrance
    num_collisions: int  # vehicle steps in a collision
    num_subject_overlaps: int  # steps in which a subject vehicle that is told what to do is in a collision
    num_teleports: int  # vehicles that SUMO removed
    num_vehicle_steps: int  # vehicles on the road, summed over steps
    subject_left: tuple[bool, ...]  # whether the subject vehicle, each of them, reached its destination
    wall_s: float  # computing time
    cpu_s: float  # processor time of the process that made the run
    passed_s: Mapping[str, np.ndarray]  # when vehicles passed the end of each counted edge
