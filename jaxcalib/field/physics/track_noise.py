"""White noise of what sensors report along tracks, told from what vehicles do.

Fourth differences of a track hardly show smooth motion. White noise of the values, of their rate and of the rate of
that leave three different autocovariances in them; how much of each is there is what the observed ones are made of.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls

from jaxcalib.field.physics.motion import DriveMotion

ORDER = 4  # of the differences
USUAL = 5.0  # robust standard deviations; beyond them a track was exchanged, or a vehicle hit something
FEWEST_DIFFERENCES = 500
SHARES = (0.5, 1.0, 0.0)  # of the later of two speeds in the way between them: integrators differ
LEAST_SHARE = 0.5  # of the noise of speeds, that distances must contradict
KERNELS = ((1.0, -4.0, 6.0, -4.0, 1.0), (1.0, -3.0, 3.0, -1.0), (1.0, -2.0, 1.0))  # of values, rates, rates of rates


def runs_of(motion: DriveMotion) -> tuple[Int[np.ndarray, " row"], Int[np.ndarray, " row"]]:
    """Return rows of the objects' table in the order of tracks and time, and the number of each unbroken run."""
    rows = np.lexsort((motion.object_time_s, motion.vehicle))
    rows = rows[np.isfinite(motion.relative_x_m[rows]) & np.isfinite(motion.object_speed_mps[rows])]
    step_s = np.diff(motion.object_time_s[rows])
    breaks = (np.diff(motion.vehicle[rows]) != 0) | (np.abs(step_s - motion.sampling_s) > 0.5 * motion.sampling_s)
    return rows, np.concatenate([[0], np.cumsum(breaks)]) if len(rows) else np.zeros(0, int)


def white_noise(motions: Sequence[DriveMotion]) -> tuple[float, float]:
    """Return standard deviations of white noise of distances, in m, and of speeds, in m/s; 0 where tracks are few.

    What speeds do not say of a distance is the sensor's. Drivers may change speed from step to step, too, so noise of
    speeds is one of the sensor where distances do not go with it.
    """
    speeds: list[np.ndarray] = []
    left: dict[float, list[np.ndarray]] = {share: [] for share in SHARES}
    for motion in motions:
        rows, run = runs_of(motion)
        speed_mps, at_s = motion.object_speed_mps[rows], motion.object_time_s[rows]
        relative_mps = speed_mps - np.interp(at_s, motion.time_s, motion.speed_mps)
        speeds.append(_differences(speed_mps, run))
        for share, series in left.items():
            mean_mps = share * relative_mps[1:] + (1.0 - share) * relative_mps[:-1]
            driven_m = np.concatenate([[0.0], np.cumsum(motion.sampling_s * mean_mps)])[: len(rows)]
            series.append(_differences(motion.relative_x_m[rows] - driven_m, run))
    of_speed = _parts(speeds)[0]
    of_distance, of_rate = min(_parts(series)[:2] for series in left.values())
    median_s = float(np.median([motion.sampling_s for motion in motions])) if motions else 1.0
    is_of_sensor = max(of_distance, of_rate / median_s) > LEAST_SHARE * of_speed
    return of_distance, of_speed if is_of_sensor else 0.0


def _differences(values: Float[np.ndarray, " row"], run: Int[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    """Fourth differences of values in their order, with nan where a run begins."""
    if len(values) <= ORDER:
        return np.zeros(0)
    return np.where(run[ORDER:] == run[:-ORDER], np.diff(values, ORDER), np.nan)


def _parts(series: Sequence[Float[np.ndarray, " row"]]) -> tuple[float, float, float]:
    """Standard deviations of white noise of the values, of their rate times the step, and of the rate of that."""
    every = np.concatenate([one[np.isfinite(one)] for one in series] or [np.zeros(0)])
    if len(every) < FEWEST_DIFFERENCES:
        return 0.0, 0.0, 0.0
    most = USUAL * 1.4826 * float(np.median(np.abs(every))) + 1e-12
    product, number = np.zeros(ORDER + 1), np.zeros(ORDER + 1)
    for one in series:
        usual = np.where(np.abs(one) <= most, one, np.nan)
        for lag in range(ORDER + 1):
            both = usual[lag:] * usual[: len(usual) - lag]
            product[lag] += np.nansum(both)
            number[lag] += np.isfinite(both).sum()
    parts = np.zeros((ORDER + 1, 3))
    for column, kernel in enumerate(KERNELS):
        parts[: len(kernel), column] = np.correlate(kernel, kernel, "full")[len(kernel) - 1 :]
    variance, _ = nnls(parts, product / np.maximum(number, 1.0))
    of_values, of_rate, of_second = np.sqrt(variance).tolist()
    return of_values, of_rate, of_second
