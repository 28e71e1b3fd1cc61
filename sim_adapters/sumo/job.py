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


ROWS_OF_RUN = ("time_s", "vehicle", "row", "position_m", "speed_mps", "acceleration_mps2", "lateral_m")


def oddity_of(answer: object, job: SumoJob) -> str:
    """Return what is odd in a worker's answer, in words; nothing where it can be a run.

    Answers come from other processes, of other machines, too. One that is spoilt on its way must not be taken for
    traffic.

    Args:
        answer: what a worker sent.
        job: what it was asked for.
    """
    if not isinstance(answer, SumoRun):
        return f"a {type(answer).__name__} instead of a run"
    arrays = [getattr(answer, name) for name in ROWS_OF_RUN]
    if not all(isinstance(array, np.ndarray) and array.ndim == 1 for array in arrays):
        return "what should be a list of numbers is none"
    if len({len(array) for array in arrays}) != 1:
        return "lists of different lengths"
    if not np.isfinite(answer.time_s).all() or (np.diff(answer.time_s) < 0.0).any():
        return "times that do not follow each other"
    num_rows = 1 + max((row for row, *_ in job.lane_place.values()), default=0)
    if len(answer.row) and not 0 <= answer.row.min() <= answer.row.max() < num_rows:
        return "rows that the road does not have"
    return ""
