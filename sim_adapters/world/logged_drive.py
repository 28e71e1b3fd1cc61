"""Logged drives on the clock of the simulators, for subject vehicles that repeat them."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int
from scipy.interpolate import CubicHermiteSpline

from sim_adapters.interface import NO_DRIVE
from surrogate.subject.logged_drive import LoggedMotion


@dataclass(frozen=True)
class LoggedDrive:
    """What a subject vehicle did, one value for each step from `first_step` on."""

    first_step: int  # step of the simulators' clock at whose beginning the log begins
    position_m: np.ndarray  # front bumper along the route
    speed_mps: np.ndarray
    row: np.ndarray  # row of the road; a lane change takes effect right after the last frame in the old lane


def resample(
    time_s: np.ndarray,
    position_m: np.ndarray,
    speed_mps: np.ndarray,
    row: np.ndarray,
    step_s: float,
) -> LoggedDrive:
    """Return a drive on the clock of the simulators.

    Positions and speeds of the log are met at its instants; between them the position is the cubic that has both, and
    never goes back.

    Args:
        time_s: instants of the log, rising.
        position_m: positions then.
        speed_mps: speeds then.
        row: rows then.
        step_s: step of the simulators.

    Raises:
        ValueError: there are fewer than two instants.
    """
    if len(time_s) < 2:
        raise ValueError("a logged drive needs at least two instants on the route.")
    first = int(np.ceil(time_s[0] / step_s - 1e-6))
    last = int(np.floor(time_s[-1] / step_s + 1e-6))
    steps = np.arange(first, last + 1)
    times = np.clip(steps * step_s, time_s[0], time_s[-1])
    spline = CubicHermiteSpline(time_s, position_m, speed_mps)
    following = np.clip(np.searchsorted(time_s, times - 1e-6), 0, len(time_s) - 1)
    return LoggedDrive(
        first_step=first,
        position_m=np.maximum.accumulate(spline(times)),
        speed_mps=np.interp(times, time_s, speed_mps),
        row=np.asarray(row)[following],
    )


def log_of(drives: Sequence[LoggedDrive], drive: int) -> LoggedDrive:
    """Return what a run repeats that stands for a drive, by its number; the first for NO_DRIVE."""
    return drives[0 if drive == NO_DRIVE else drive]


def logged_motion_of(drives: Sequence[LoggedDrive], drive: Int[Array, ""]) -> LoggedMotion:
    """Return the drives for the surrogate, with the one that this run repeats; as `log_of`, on a traced number.

    Raises:
        ValueError: there are no drives.
    """
    if not drives:
        raise ValueError("The subject model 'replay' expects logged drives in the template; there are none.")
    longest = max(len(one.position_m) for one in drives)

    def table(values: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([np.pad(one, (0, longest - len(one)), mode="edge") for one in values])

    return LoggedMotion(
        position_m=jnp.asarray(table([one.position_m for one in drives]), jnp.float32),
        speed_mps=jnp.asarray(table([one.speed_mps for one in drives]), jnp.float32),
        row=jnp.asarray(table([one.row for one in drives]), jnp.int32),
        first_step=jnp.asarray([one.first_step for one in drives], jnp.int32),
        num_steps=jnp.asarray([len(one.position_m) for one in drives], jnp.int32),
        log=jnp.where(drive == NO_DRIVE, 0, drive),
    )
