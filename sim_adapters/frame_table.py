"""Builds perception frames from long tables: one row per instant and object, as logs and SUMO outputs have them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from surrogate.road.perception import NO_TRACK, PerceptionFrame

PLACES_STEP = 32  # places for objects grow in steps, so that few array shapes occur


@dataclass(frozen=True)
class SubjectTable:
    """The subject vehicle, one row per instant, in time order."""

    time_s: np.ndarray  # time on the scenario's clock
    position_m: np.ndarray  # front bumper along the route
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray
    row: np.ndarray  # row of the road
    lateral_m: np.ndarray  # offset from the centre of its lane, + left; nan where unknown
    num_lanes: np.ndarray  # lanes of the carriageway there


@dataclass(frozen=True)
class ObjectTable:
    """Detected vehicles, one row per instant and vehicle, in any order."""

    instant: np.ndarray  # index of the instant in the subject table
    track: np.ndarray  # number of the vehicle, counting from 0 by first detection
    row: np.ndarray  # row of the road
    offset_m: np.ndarray  # front bumper less that of the subject vehicle, along the road
    speed_mps: np.ndarray
    lateral_m: np.ndarray  # offset from the centre of its lane, + left; nan where unknown


def stack_frames(
    subject: SubjectTable, objects: ObjectTable, ahead_m: float, behind_m: float, least_places: int = 96
) -> PerceptionFrame:
    """Return the frames of one drive, stacked along a leading time axis.

    Args:
        subject: the subject vehicle.
        objects: the detected vehicles.
        ahead_m: range of the sensors ahead; objects beyond it are left out.
        behind_m: range behind.
        least_places: places for objects per frame, at least.

    Returns:
        A `PerceptionFrame` whose leaves are NumPy arrays with a leading time axis; objects sorted by (row, -position),
        the subject vehicle among them.
    """
    num_instants = len(subject.time_s)
    keep = (objects.offset_m <= ahead_m) & (objects.offset_m >= -behind_m)
    instant = np.concatenate([objects.instant[keep], np.arange(num_instants)])
    track = np.concatenate([objects.track[keep], np.full(num_instants, NO_TRACK)])
    row = np.concatenate([objects.row[keep], subject.row])
    offset = np.concatenate([objects.offset_m[keep], np.zeros(num_instants)])
    speed = np.concatenate([objects.speed_mps[keep], subject.speed_mps])
    lateral = np.concatenate([objects.lateral_m[keep], subject.lateral_m])
    is_subject = np.concatenate([np.zeros(int(keep.sum()), bool), np.ones(num_instants, bool)])

    order = np.lexsort((-offset, row, instant))
    instant = instant[order]
    count = np.bincount(instant, minlength=num_instants)
    place = np.arange(len(instant)) - np.repeat(np.cumsum(count) - count, count)
    most = int(count.max()) if num_instants else 0
    num_places = max(least_places, PLACES_STEP * -(-most // PLACES_STEP))

    # Both return Any: frames are annotated as JAX arrays, which lets NumPy's stand in for them.
    def each(values: np.ndarray | float, dtype: type = np.float32) -> Any:
        return np.full(num_instants, values, dtype)

    def spread(values: np.ndarray, fill: float, dtype: type) -> Any:
        table = np.full((num_instants, num_places), fill, dtype)
        table[instant, place] = values[order]
        return table

    return PerceptionFrame(
        time_s=each(subject.time_s),
        valid=each(True, bool),
        subject_position_m=each(subject.position_m),
        subject_speed_mps=each(subject.speed_mps),
        subject_acceleration_mps2=each(subject.acceleration_mps2),
        num_lanes=each(subject.num_lanes),
        object_valid=spread(np.ones(len(order), bool), False, bool),
        object_is_subject=spread(is_subject, False, bool),
        object_track=spread(track, NO_TRACK, np.int32),
        object_row=spread(row, 0, np.int32),
        object_offset_m=spread(offset, 0.0, np.float32),
        object_speed_mps=spread(speed, 0.0, np.float32),
        object_lateral_m=spread(lateral, 0.0, np.float32),
        ahead_m=each(ahead_m),
        behind_m=each(behind_m),
    )
