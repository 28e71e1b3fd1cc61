"""Gaps that drivers accepted when they changed lane, against the gap that their model calls secure.

SUMO's LC2013 lets a vehicle change as soon as both gaps in the target lane exceed the secure gap divided by
`lcAssertive`. So accepted gaps, as shares of the secure gap, begin where 1 / lcAssertive lies (`acceptance_edge.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from jaxcalib.field.field_log import DriveLog
from jaxcalib.initial_values.acceptance_edge import acceptance_edge
from jaxcalib.initial_values.dense_tracks import NOBODY, DenseTracks, dense_tracks
from surrogate.vehicle.car_following_model import CarFollowingModel

FEWEST_CHANGES = 20
LEAST_LOGARITHMIC_ERROR = 0.05  # 14 fields simulated in SUMO from known values: 4 % too high at the median
UNKNOWN_MOMENT_S = 0.2  # the gap that was judged is one of a moment before the vehicle is seen in its new lane
POSITION_ERROR_M = 0.2
LARGEST_ERROR = 0.3  # of a share, beyond which a gap is too small for what is known of it


@dataclass(frozen=True)
class AcceptedGaps:
    """Lane changes of background vehicles, at the moment before; gaps are bumper to bumper, inf where nobody is."""

    speed_mps: np.ndarray  # speed of the vehicle that changes
    leader_gap_m: np.ndarray  # gap to the new leader
    leader_speed_mps: np.ndarray  # his speed
    # gap to the new follower; inf if that is the subject vehicle, whose model is another one
    follower_gap_m: np.ndarray
    follower_speed_mps: np.ndarray  # his speed


def accepted_gaps(drives: Sequence[DriveLog], length_m: float, step_s: float) -> AcceptedGaps:
    """Return the gaps of all lane changes of background vehicles."""
    found = [gap for drive in drives for gap in _gaps_of(dense_tracks(drive, step_s), length_m)]
    return AcceptedGaps(*np.asarray(found, float).reshape(len(found), 5).T)


@dataclass(frozen=True)
class Assertiveness:
    """What accepted gaps say of lcAssertive."""

    value: float  # of lcAssertive; nan where there are too few gaps
    logarithmic_error: float  # standard error of its logarithm; inf where there are too few gaps


def assertiveness(gaps: AcceptedGaps, model: CarFollowingModel, step_s: float) -> Assertiveness:
    """Return the lcAssertive that the gaps show, from the tighter of both gaps of each change.

    Args:
        gaps: accepted gaps.
        model: the drivers' car-following model.
        step_s: length of a simulation step.
    """

    def demanded(follower_mps: np.ndarray, leader_mps: np.ndarray) -> np.ndarray:
        speeds = (jnp.asarray(follower_mps, jnp.float32), jnp.asarray(leader_mps, jnp.float32))
        return np.asarray(
            model.secure_gap_m(*speeds, jnp.asarray(model.max_deceleration_mps2, jnp.float32), step_s), float
        )

    demanded_m = np.stack(
        [demanded(gaps.speed_mps, gaps.leader_speed_mps), demanded(gaps.follower_speed_mps, gaps.speed_mps)]
    )
    gap_m = np.stack([gaps.leader_gap_m, gaps.follower_gap_m])
    moved_m = UNKNOWN_MOMENT_S * (np.stack([gaps.leader_speed_mps, gaps.follower_speed_mps]) - gaps.speed_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (gap_m - float(model.jam_gap_m)) / demanded_m
        error = np.hypot(moved_m, POSITION_ERROR_M) / demanded_m
    share = np.where(np.isfinite(share), share, np.inf)
    tighter = np.argmin(share, axis=0)
    change = np.arange(len(tighter))
    share, error = share[tighter, change], error[tighter, change]
    counts = np.isfinite(share) & (error < LARGEST_ERROR)
    if counts.sum() < FEWEST_CHANGES:
        return Assertiveness(float("nan"), float("inf"))
    edge = acceptance_edge(share[counts], error[counts])
    return Assertiveness(1.0 / edge.share, float(np.hypot(edge.logarithmic_error, LEAST_LOGARITHMIC_ERROR)))


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
