"""Leader-follower pairs in the logs: what each follower met, and how fast it was a moment later."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.field.field_log import DriveLog
from jaxcalib.initial_values.dense_tracks import DenseTracks, dense_tracks

QUIET_AFTER_CHANGE_S = 1.0  # neither follower nor leader changed lane for so long: lane changing adapts speeds as well


@dataclass(frozen=True)
class FollowingSamples:
    """Moments of car-following; one entry each, in SI units."""

    vehicle: np.ndarray  # number of the follower, counted through all drives
    drive: np.ndarray  # index of the drive
    row: np.ndarray  # row of the road
    position_m: np.ndarray  # the follower's place on the route
    speed_mps: np.ndarray
    acceleration_mps2: np.ndarray  # its acceleration in the step before
    gap_m: np.ndarray  # gap to the leader, bumper to bumper
    leader_speed_mps: np.ndarray  # the leader's speed at the beginning of each step, [sample, step]
    leader_acceleration_mps2: np.ndarray  # its acceleration in the step before the first
    later_speed_mps: np.ndarray  # the follower's speed at the end
    step_s: float  # length of a step

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.vehicle)

    def select(self, chosen: np.ndarray) -> "FollowingSamples":
        """Return some of the samples."""
        arrays = {name: values[chosen] for name, values in vars(self).items() if isinstance(values, np.ndarray)}
        return FollowingSamples(**arrays, step_s=self.step_s)

    def thin(self, most: int) -> "FollowingSamples":
        """Return at most about so many samples, evenly chosen."""
        return self.select(np.arange(0, len(self), max(1, len(self) // most)))


def following_samples(drives: Sequence[DriveLog], length_m: float, step_s: float, num_steps: int) -> FollowingSamples:
    """Return all moments at which a background vehicle followed the same leader in the same lane throughout.

    Args:
        drives: logs.
        length_m: length taken for every vehicle.
        step_s: length of a step.
        num_steps: steps between the moment and the later one.
    """
    parts: list[dict[str, np.ndarray]] = []
    num_vehicles = 0
    for index, drive in enumerate(drives):
        tracks = dense_tracks(drive, step_s)
        part = _samples_of(tracks, length_m, step_s, num_steps)
        part["vehicle"] += num_vehicles
        part["drive"] = np.full(len(part["vehicle"]), index)
        num_vehicles += tracks.row.shape[1]
        parts.append(part)
    return FollowingSamples(**{name: np.concatenate([p[name] for p in parts]) for name in parts[0]}, step_s=step_s)


def _samples_of(tracks: DenseTracks, length_m: float, step_s: float, num_steps: int) -> dict[str, np.ndarray]:
    num_times, num_tracks = tracks.row.shape
    quiet = max(1, round(QUIET_AFTER_CHANGE_S / step_s))
    span = quiet + num_steps
    if num_times <= span:
        return _nothing(num_steps)
    column = np.arange(num_tracks)
    times = np.arange(quiet, num_times - num_steps)
    leader = tracks.leader[times]
    is_steady = (leader >= 0) & (column < num_tracks - 1)  # the subject vehicle is no driver to learn from
    own_row = tracks.row[times]
    for shift in range(-quiet, num_steps + 1):
        other = times + shift
        is_steady &= tracks.row[other] == own_row
        leader_row = tracks.row[other[:, None], np.maximum(leader, 0)]
        is_steady &= leader_row == own_row
        if shift >= 0:
            is_steady &= tracks.leader[other] == leader
    place, follower = np.nonzero(is_steady)
    time, ahead = times[place], leader[place, follower]
    speed = tracks.speed_mps
    steps = np.arange(num_steps)
    return {
        "vehicle": follower.copy(),
        "row": tracks.row[time, follower],
        "position_m": tracks.position_m[time, follower],
        "speed_mps": speed[time, follower],
        "acceleration_mps2": (speed[time, follower] - speed[time - 1, follower]) / step_s,
        "gap_m": tracks.position_m[time, ahead] - length_m - tracks.position_m[time, follower],
        "leader_speed_mps": speed[time[:, None] + steps, ahead[:, None]],
        "leader_acceleration_mps2": (speed[time, ahead] - speed[time - 1, ahead]) / step_s,
        "later_speed_mps": speed[time + num_steps, follower],
    }


def _nothing(num_steps: int) -> dict[str, np.ndarray]:
    names = ("row", "position_m", "speed_mps", "acceleration_mps2", "gap_m", "leader_acceleration_mps2")
    empty: dict[str, np.ndarray] = {name: np.zeros(0) for name in (*names, "later_speed_mps")}
    return empty | {"vehicle": np.zeros(0, int), "leader_speed_mps": np.zeros((0, num_steps))}
