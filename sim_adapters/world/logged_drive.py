"""Logged drives on the clock of the simulators, for subject vehicles that repeat them."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.interpolate import CubicHermiteSpline

from sim_adapters.world.drive_choice import choose, chosen
from surrogate.subject.logged_drive import LoggedMotion


@dataclass(frozen=True)
class LoggedDrive:
    """What a subject vehicle did, one value for each step from `first_step` on."""

    depart_s: float  # departure of the drive, by which runs choose it
    first_step: int  # step of the simulators' clock at whose beginning the log begins
    position_m: np.ndarray  # front bumper along the route
    speed_mps: np.ndarray
    row: np.ndarray  # row of the road; a lane change takes effect right after the last frame in the old lane


def resample(
    depart_s: float,
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
        depart_s: departure of the drive.
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
        depart_s=depart_s,
        first_step=first,
        position_m=np.maximum.accumulate(spline(times)),
        speed_mps=np.interp(times, time_s, speed_mps),
        row=np.asarray(row)[following],
    )


def log_of(drives: Sequence[LoggedDrive], depart_s: float, seed: int) -> LoggedDrive:
    """Return which drive a run repeats, see `choose`; the first if none departs when it does."""
    return drives[choose([drive.depart_s for drive in drives], depart_s, seed) or 0]


def logged_motion_of(drives: Sequence[LoggedDrive], depart_s: Float[Array, ""], seed: Int[Array, ""]) -> LoggedMotion:
    """Return the drives for the surrogate, with the one that this run repeats; as `log_of`, on traced values.

    Raises:
        ValueError: there are no drives.
    """
    if not drives:
        raise ValueError("The subject model 'replay' expects logged drives in the template; there are none.")
    longest = max(len(drive.position_m) for drive in drives)

    def table(values: Sequence[np.ndarray]) -> np.ndarray:
        return np.stack([np.pad(one, (0, longest - len(one)), mode="edge") for one in values])

    departs = jnp.asarray([drive.depart_s for drive in drives], jnp.float32)
    return LoggedMotion(
        position_m=jnp.asarray(table([drive.position_m for drive in drives]), jnp.float32),
        speed_mps=jnp.asarray(table([drive.speed_mps for drive in drives]), jnp.float32),
        row=jnp.asarray(table([drive.row for drive in drives]), jnp.int32),
        first_step=jnp.asarray([drive.first_step for drive in drives], jnp.int32),
        num_steps=jnp.asarray([len(drive.position_m) for drive in drives], jnp.int32),
        log=chosen(departs, depart_s, seed)[0],
    )
