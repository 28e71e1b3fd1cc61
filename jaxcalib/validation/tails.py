"""How hard traffic would have to brake at worst: the tail of the deceleration that avoids a crash, extrapolated.

Beyond a threshold the distribution of nearly any quantity is a generalised Pareto one. It is fitted to what lies in
each class of the tally, and says which deceleration is needed once in 1000 km, which few drives show themselves.
Drives are drawn anew for the intervals: frames of one approach are no independent observations.

Source: peaks over threshold, Coles (2001), An Introduction to Statistical Modeling of Extreme Values, eqs. 4.4 and
4.12; for conflicts in traffic, Songchitruksa & Tarko (2006), Accid. Anal. Prev. 38.
Deviation: the likelihood is that of counts in classes, and shapes are kept within +-0.5, where means and variances of
the tail exist and its end is not within the classes.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.stats import genpareto

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.safety import DRAC_BORDER_MPS2
from jaxcalib.validation.observer import ObservedDrives

THRESHOLD_MPS2 = 1.0  # harder than traffic brakes all the time, and common enough to fit a tail to
PER_M = 1e-6  # once in 1000 km
FEWEST_EXCEEDANCES = 20.0
MOST_SHAPE = 0.5
NUM_DRAWS = 100
TOLERANCE = 1e-2  # of shape, logarithm of the scale and log-likelihood: far below their errors
ACTORS = ("subject", "background")


def compare_tails(
    tally_names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives, random: np.random.Generator
) -> dict[str, dict[str, Any]]:
    """Return the deceleration that is needed once in 1000 km, in the field and in rounds of simulated drives.

    Args:
        tally_names: names of the tallies.
        field: the field's drives, [drive].
        rounds: rounds of simulated ones, [round, drive].
        random: of the draws.

    Returns:
        By actor and then `field` or `simulated`: `exceedances` of the threshold, the tail's `shape` and the `level` in
        m/s^2 with its `interval_90`; null where there are too few exceedances.
    """
    number = {name: index for index, name in enumerate(tally_names)}
    table = {}
    for actor in ACTORS:
        bins = [number[f"{actor}_drac_bin[{index}]"] for index in range(len(DRAC_BORDER_MPS2) - 1)]
        places = [*bins, number[f"{actor}_distance_seen_m"]]
        several = {"field": field.tally[:, places], "simulated": rounds.tally[..., places].reshape(-1, len(places))}
        table[actor] = {name: _tail(tallies, random) for name, tallies in several.items()}
    return table


def once_in_1000_km(counts: Float[np.ndarray, " bin"], distance_m: float) -> tuple[float, float]:
    """Return the deceleration that is needed once in 1000 km, in m/s^2, and the tail's shape; nan for too few.

    Args:
        counts: frames in each class of `DRAC_BORDER_MPS2`.
        distance_m: distance over which they were counted.
    """
    borders = np.asarray(DRAC_BORDER_MPS2)
    is_beyond = borders[:-1] >= THRESHOLD_MPS2
    beyond, edges = counts[is_beyond], borders[np.append(is_beyond, True)] - THRESHOLD_MPS2
    total = beyond.sum()
    if total < FEWEST_EXCEEDANCES or not distance_m > 0.0:
        return float("nan"), float("nan")

    def misfit(at: np.ndarray) -> float:
        shape, log_scale = at
        if abs(shape) > MOST_SHAPE:
            return np.inf
        shares = -np.diff(_survival(edges[:-1], shape, np.exp(log_scale)), append=0.0)
        return -float(beyond @ np.log(np.maximum(shares, 1e-300)))

    mean = float(beyond @ (0.5 * (edges[:-1] + np.append(edges[1:-1], edges[-2] + 1.0))) / total)
    fit = minimize(misfit, np.asarray([0.0, np.log(mean)]), method="Nelder-Mead",
                   options={"xatol": TOLERANCE, "fatol": TOLERANCE})  # fmt: skip
    shape, scale = float(fit.x[0]), float(np.exp(fit.x[1]))
    rarer = PER_M / (total / distance_m)  # than an exceedance
    level = THRESHOLD_MPS2 + float(genpareto.isf(min(rarer, 1.0), shape, scale=scale))
    return level, shape


def _survival(excess: Float[np.ndarray, " edge"], shape: float, scale: float) -> Float[np.ndarray, " edge"]:
    """Share of a generalised Pareto distribution that lies above each excess; scipy's takes fifty times as long."""
    if abs(shape) < 1e-6:
        return np.exp(-excess / scale)
    return np.maximum(1.0 + shape * excess / scale, 0.0) ** (-1.0 / shape)


def _tail(tallies: Float[np.ndarray, "drive part"], random: np.random.Generator) -> dict[str, Any]:
    total = tallies.sum(axis=0)
    level, shape = once_in_1000_km(total[:-1], float(total[-1]))
    entry: dict[str, Any] = {
        "exceedances": rounded(_exceedances(total[:-1])),
        "shape": rounded(shape),
        "level_mps2": rounded(level),
        "interval_90": None,
    }
    if not np.isfinite(level) or len(tallies) < 2:
        return entry
    drawn = (tallies[random.integers(len(tallies), size=len(tallies))].sum(axis=0) for _ in range(NUM_DRAWS))
    levels = np.asarray([once_in_1000_km(each[:-1], float(each[-1]))[0] for each in drawn])
    known = levels[np.isfinite(levels)]
    if len(known) > NUM_DRAWS // 2:
        entry["interval_90"] = [rounded(float(np.quantile(known, share))) for share in (0.05, 0.95)]
    return entry


def _exceedances(counts: Float[np.ndarray, " bin"]) -> float:
    return float(counts[np.asarray(DRAC_BORDER_MPS2)[:-1] >= THRESHOLD_MPS2].sum())
