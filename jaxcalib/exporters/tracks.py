"""Traffic vehicle by vehicle: where each one drives from when it is first seen until it is last seen."""

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from jaxcalib.importers.trajectories import Slice

TIME_DIGITS = 3  # SUMO's clock counts milliseconds


@dataclass(frozen=True)
class Track:
    """A vehicle's uninterrupted way, two instants at least."""

    vehicle: str
    time_s: np.ndarray  # from the first instant of the subject vehicle
    x_m: np.ndarray  # of the front bumper's middle, in the network's plane
    y_m: np.ndarray
    heading_rad: np.ndarray  # counterclockwise from +x, without jumps of a turn
    speed_mps: np.ndarray


def read_tracks(slices: Iterable[Slice], subject: str, range_m: float | None = None) -> list[Track]:
    """Return the tracks while the subject vehicle is there, its own first, the others by their beginning.

    A vehicle that is away for some instants, as SUMO's teleports leave them, has a track before and one after.

    Args:
        slices: the traffic at each instant.
        subject: id of the subject vehicle.
        range_m: other vehicles are taken from when they first come so near to the subject vehicle until when they last
            are; None for all of every vehicle.

    Raises:
        ValueError: the subject vehicle is in none of the slices.
    """
    kept = list(itertools.dropwhile(lambda one: subject not in one.vehicle, slices))
    if not kept:
        raise ValueError(f"The vehicle '{subject}' is nowhere in the traffic.")
    while subject not in kept[-1].vehicle:
        kept.pop()
    instant = np.repeat(np.arange(len(kept)), [len(one.vehicle) for one in kept])
    time_s = np.asarray([round(one.time_s - kept[0].time_s, TIME_DIGITS) for one in kept])[instant]
    vehicle = np.concatenate([one.vehicle for one in kept])
    x_m, y_m, heading_rad, speed_mps = (
        np.concatenate([getattr(one, name) for one in kept]) for name in ("x_m", "y_m", "heading_rad", "speed_mps")
    )
    is_near = np.concatenate([_is_near(one, subject, range_m) for one in kept])
    tracks = []
    by_vehicle = np.argsort(vehicle, kind="stable")
    for rows in np.split(by_vehicle, np.flatnonzero(vehicle[by_vehicle][1:] != vehicle[by_vehicle][:-1]) + 1):
        for stay in _stays(rows, instant, is_near):
            heading = np.unwrap(heading_rad[stay])
            name = str(vehicle[stay[0]])
            tracks.append(Track(name, time_s[stay], x_m[stay], y_m[stay], heading, speed_mps[stay]))
    return sorted(tracks, key=lambda track: (track.vehicle != subject, float(track.time_s[0]), track.vehicle))


def _is_near(one: Slice, subject: str, range_m: float | None) -> np.ndarray:
    if range_m is None:
        return np.ones(len(one.vehicle), bool)
    at = np.flatnonzero(one.vehicle == subject)
    if not len(at):
        return np.zeros(len(one.vehicle), bool)
    return np.hypot(one.x_m - one.x_m[at[0]], one.y_m - one.y_m[at[0]]) <= range_m


def _stays(rows: np.ndarray, instant: np.ndarray, is_near: np.ndarray) -> Iterator[np.ndarray]:
    """Yield a vehicle's rows, cut to when it is near, in pieces without a missing instant."""
    near = np.flatnonzero(is_near[rows])
    if not len(near):
        return
    rows = rows[near[0] : near[-1] + 1]
    for stay in np.split(rows, np.flatnonzero(np.diff(instant[rows]) > 1) + 1):
        if len(stay) > 1:
            yield stay
