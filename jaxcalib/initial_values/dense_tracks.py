"""A drive as tables over time and track, so that a vehicle and its leader can be followed from moment to moment."""

from dataclasses import dataclass

import numpy as np

from jaxcalib.field.field_log import DriveLog

NOBODY = -1


@dataclass(frozen=True)
class DenseTracks:
    """Everything seen in a drive, [time, track]. The subject vehicle is the last track."""

    position_m: np.ndarray  # front bumper along the route; nan where a vehicle was not seen
    speed_mps: np.ndarray  # speed; nan where it was not seen
    row: np.ndarray  # row of the road; -1 where it was not seen
    leader: np.ndarray  # track of the leader in the own row; -1 where none was seen


def dense_tracks(drive: DriveLog, step_s: float) -> DenseTracks:
    """Return the tables of a drive at multiples of a step."""
    even = drive.on_clock(step_s)
    shape = (len(even.subject.time_s), int(even.objects.track.max(initial=-1)) + 2)
    position, speed, row = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, NOBODY)
    instant, track = even.objects.instant, even.objects.track
    position[instant, track] = even.subject.position_m[instant] + even.objects.offset_m
    speed[instant, track] = even.objects.speed_mps
    row[instant, track] = even.objects.row
    seen = even.valid
    position[seen, -1], speed[seen, -1] = even.subject.position_m[seen], even.subject.speed_mps[seen]
    row[seen, -1] = even.subject.row[seen]
    return DenseTracks(position, speed, row, _leaders(position, row))


def _leaders(position_m: np.ndarray, row: np.ndarray) -> np.ndarray:
    time, track = np.nonzero(row != NOBODY)
    order = np.lexsort((-position_m[time, track], row[time, track], time))
    time, track = time[order], track[order]
    same = (time[1:] == time[:-1]) & (row[time[1:], track[1:]] == row[time[:-1], track[:-1]])
    leader = np.full(row.shape, NOBODY)
    leader[time[1:][same], track[1:][same]] = track[:-1][same]
    return leader
