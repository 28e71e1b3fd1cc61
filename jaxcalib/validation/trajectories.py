"""The subject vehicle's trajectory: when it passes each place of the route, and how fast it is there."""

import numpy as np
from jaxtyping import Float

from surrogate.road.perception import PerceptionFrame

CELL_M = 50.0
NOT_PASSED = -1.0
FEWEST_CELLS = 4  # that two trajectories must share


def route_grid(length_m: float) -> Float[np.ndarray, " place"]:
    """Return the places along a route at which trajectories are compared."""
    return np.arange(0.0, length_m + 0.5 * CELL_M, CELL_M)


def passing_times_s(frames: PerceptionFrame, grid_m: Float[np.ndarray, " place"]) -> Float[np.ndarray, " place"]:
    """Return when the subject vehicle passes each place of its route, on the scenario's clock; nan where it does not.

    Frames are stacked along a leading time axis.
    """
    valid = np.asarray(frames.valid)
    time_s = np.asarray(frames.time_s, float)[valid]
    position_m = np.maximum.accumulate(np.asarray(frames.subject_position_m, float)[valid]) if valid.any() else time_s
    if len(time_s) < 2:
        return np.full(len(grid_m), np.nan)
    moves = np.concatenate([[True], np.diff(position_m) > 0.0])
    return np.interp(grid_m, position_m[moves], time_s[moves], left=np.nan, right=np.nan)


def speed_rmse_mps(one: Float[np.ndarray, " place"], other: Float[np.ndarray, " place"]) -> float:
    """Return the root mean square difference of speed, from passing times, over the cells that both have driven.

    It is nan for too few.
    """
    speeds = [CELL_M / np.diff(times) for times in (one, other)]
    both = np.isfinite(speeds[0]) & np.isfinite(speeds[1])
    if both.sum() < FEWEST_CELLS:
        return float("nan")
    return float(np.sqrt(np.mean((speeds[0][both] - speeds[1][both]) ** 2)))


def passing_rmse_s(one: Float[np.ndarray, " place"], other: Float[np.ndarray, " place"]) -> float:
    """Return the root mean square difference of passing times since the first place that both have passed."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < FEWEST_CELLS + 1:
        return float("nan")
    since = [times[both] - times[both][0] for times in (one, other)]
    return float(np.sqrt(np.mean((since[0] - since[1]) ** 2)))


def travel_times_s(one: Float[np.ndarray, " place"], other: Float[np.ndarray, " place"]) -> tuple[float, float]:
    """Return how long each takes for the stretch that both have driven; nan for too short a stretch."""
    both = np.isfinite(one) & np.isfinite(other)
    if both.sum() < FEWEST_CELLS + 1:
        return float("nan"), float("nan")
    return float(np.ptp(one[both])), float(np.ptp(other[both]))
