"""Gaps that drivers accepted when they changed lane, against the gap that their model calls secure.

SUMO's LC2013 lets a vehicle change as soon as both gaps in the target lane exceed the secure gap divided by
`lcAssertive`. So accepted gaps, as shares of the secure gap, end where 1 / lcAssertive lies, but for the few changes in
which a neighbour moved at the same moment.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from jaxcalib.field_log import DriveLog
from jaxcalib.initial_values.dense_tracks import NOBODY, DenseTracks, dense_tracks
from surrogate.car_following.base import CarFollowingModel

FEWEST_CHANGES = 20
MOVED_AT_THE_SAME_TIME = 0.08  # share of changes whose gap says nothing, because a neighbour moved as well
LOGARITHMIC_ERROR = 0.05  # in practice cases without any effect, estimates were 1 to 4 % too high


@dataclass(frozen=True)
class AcceptedGaps:
    """Lane changes of background vehicles, at the moment before; gaps are bumper to bumper, inf where nobody is.

    Attributes:
        speed_mps: speed of the vehicle that changes.
        leader_gap_m: gap to the new leader.
        leader_speed_mps: his speed.
        follower_gap_m: gap to the new follower; inf if that is the subject vehicle, whose model is another one.
        follower_speed_mps: his speed.
    """

    speed_mps: np.ndarray
    leader_gap_m: np.ndarray
    leader_speed_mps: np.ndarray
    follower_gap_m: np.ndarray
    follower_speed_mps: np.ndarray


def accepted_gaps(drives: Sequence[DriveLog], nominal_length_m: float, step_s: float) -> AcceptedGaps:
    """Return the gaps of all lane changes of background vehicles."""
    found = [gap for drive in drives for gap in _gaps_of(dense_tracks(drive, step_s), nominal_length_m)]
    return AcceptedGaps(*np.asarray(found, float).reshape(len(found), 5).T)


def assertiveness(gaps: AcceptedGaps, model: CarFollowingModel, step_s: float) -> float:
    """Return the lcAssertive that the gaps show; nan if there are too few.

    Args:
        gaps: accepted gaps.
        model: the drivers' car-following model.
        step_s: length of a simulation step.
    """

    def demanded(follower_mps: np.ndarray, leader_mps: np.ndarray) -> np.ndarray:
        speeds = (jnp.asarray(follower_mps, jnp.float32), jnp.asarray(leader_mps, jnp.float32))
        return np.asarray(model.secure_gap_m(*speeds, model.max_deceleration_mps2, step_s), float)

    jam_m = float(model.jam_gap_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = (gaps.leader_gap_m - jam_m) / demanded(gaps.speed_mps, gaps.leader_speed_mps)
        behind = (gaps.follower_gap_m - jam_m) / demanded(gaps.follower_speed_mps, gaps.speed_mps)
    share = np.fmin(ahead, behind)
    share = share[np.isfinite(share)]
    if len(share) < FEWEST_CHANGES:
        return float("nan")
    least = float(np.quantile(share, MOVED_AT_THE_SAME_TIME))
    return 1.0 / least if least > 0 else float("nan")


def _gaps_of(tracks: DenseTracks, length_m: float) -> list[tuple[float, ...]]:
    position, speed, row = tracks.position_m, tracks.speed_mps, tracks.row
    changes = (row[1:] != row[:-1]) & (row[1:] != NOBODY) & (row[:-1] != NOBODY)
    changes[:, -1] = False
    found = []
    for time, vehicle in zip(*np.nonzero(changes), strict=True):
        in_target = row[time] == row[time + 1, vehicle]
        place = np.where(in_target, position[time] - position[time, vehicle], np.nan)
        ahead, behind = np.flatnonzero(place >= 0), np.flatnonzero(place < 0)
        lead = lag = (np.inf, 0.0)
        if len(ahead):
            leader = ahead[np.argmin(place[ahead])]
            lead = (place[leader] - length_m, speed[time, leader])
        if len(behind):
            follower = behind[np.argmax(place[behind])]
            is_subject = follower == row.shape[1] - 1
            lag = (np.inf if is_subject else -place[follower] - length_m, speed[time, follower])
        found.append((speed[time, vehicle], *lead, *lag))
    return found
