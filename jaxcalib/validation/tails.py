"""How hard traffic would have to brake at worst: the tail of the deceleration that avoids a crash, extrapolated.

Beyond a high threshold the distribution of nearly any quantity is a generalised Pareto one. The threshold is the first
border of a class beyond which at most a tenth of the field's approaches lie, each told by its hardest moment. The tail
is fitted to what lies in each class, and says which deceleration an approach needs once in 1000 km, which few drives
show themselves. Approaches of one drive are no independent observations: the likelihood is divided by how much more
exceedances scatter between drives than independent ones would, and intervals take the quantile that an estimate of that
from so many drives asks for.

Source: peaks over threshold and the profile likelihood of a return level, Coles (2001), An Introduction to Statistical
Modeling of Extreme Values, eqs. 4.4, 4.12 and sec. 4.3.3; for conflicts in traffic, Songchitruksa & Tarko (2006),
Accid. Anal. Prev. 38; the quasi-likelihood, McCullagh & Nelder (1989), Generalized Linear Models, sec. 4.5.
Deviation: the likelihood is that of counts in classes, on a grid, and shapes are kept within +-0.5, where means and
variances of the tail exist.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import f as fisher

from jaxcalib.calibration.result.result import rounded
from jaxcalib.measures.safety import DRAC_BORDER_MPS2
from jaxcalib.validation.observer import ObservedDrives

MOST_BEYOND = 0.1  # share of the approaches that lie beyond the threshold: the tail begins at a high quantile
PER_M = 1e-6  # once in 1000 km
FEWEST_EXCEEDANCES = 20.0
SHAPES = np.append(np.linspace(-0.5, -0.01, 50), np.linspace(0.01, 0.5, 50))  # 0 is a limit, and near either
LEVELS_MPS2 = np.geomspace(0.02, 60.0, 500)  # above the threshold
CONFIDENCE = 0.9
FEWEST_DRIVES = 3  # fewer do not tell how exceedances scatter
ACTORS = ("subject", "background")


@dataclass(frozen=True)
class Tail:
    """The tail of needed decelerations."""

    level_mps2: float  # deceleration that is needed once in 1000 km; nan where too little was seen
    interval_90_mps2: tuple[float, float]  # its 90 % interval
    shape: float  # of the generalised Pareto distribution


UNKNOWN = Tail(float("nan"), (float("nan"), float("nan")), float("nan"))


def compare_tails(
    tally_names: tuple[str, ...], field: ObservedDrives, rounds: ObservedDrives
) -> dict[str, dict[str, Any]]:
    """Return the deceleration that is needed once in 1000 km, in the field and in simulated drives.

    Args:
        tally_names: names of the tallies.
        field: the field's drives, [drive].
        rounds: rounds of simulated ones, [round, drive].

    Returns:
        By actor and then `field` or `simulated`: `threshold_mps2`, its `exceedances`, the tail's `shape` and the
        `level_mps2` with its `interval_90`; null where there are too few exceedances or drives.
    """
    number = {name: index for index, name in enumerate(tally_names)}
    table = {}
    for actor in ACTORS:
        bins = [number[f"{actor}_approach_bin[{index}]"] for index in range(len(DRAC_BORDER_MPS2) - 1)]
        distance = number[f"{actor}_distance_seen_m"]
        threshold = threshold_of(field.tally[:, bins].sum(axis=0))
        table[actor] = {}
        for name, tallies in (("field", field.tally), ("simulated", rounds.tally.reshape(-1, len(tally_names)))):
            found = tail_of(tallies[:, bins], float(tallies[:, distance].sum()), threshold)
            is_known = np.isfinite(found.level_mps2)
            table[actor][name] = {
                "threshold_mps2": threshold,
                "exceedances": rounded(float(_beyond(tallies[:, bins], threshold).sum())),
                "shape": rounded(found.shape),
                "level_mps2": rounded(found.level_mps2),
                "interval_90": [rounded(bound) for bound in found.interval_90_mps2] if is_known else None,
            }
    return table


def threshold_of(counts: Float[np.ndarray, " bin"]) -> float:
    """Return the first border of a class beyond which at most a tenth of all lies, in m/s^2."""
    beyond = np.append(counts[::-1].cumsum()[::-1], 0.0)
    return float(DRAC_BORDER_MPS2[int(np.argmax(beyond <= MOST_BEYOND * counts.sum()))])


def tail_of(counts: Float[np.ndarray, "drive bin"], distance_m: float, threshold: float) -> Tail:
    """Return the tail beyond a threshold.

    Args:
        counts: approaches of each drive in each class of `DRAC_BORDER_MPS2`.
        distance_m: distance over which they were counted, all drives together.
        threshold: border of a class from which on the tail is fitted, in m/s^2.
    """
    beyond = _beyond(counts, threshold)
    total = beyond.sum()
    if total < FEWEST_EXCEEDANCES or len(counts) < FEWEST_DRIVES or not distance_m > 0.0:
        return UNKNOWN
    rarer = PER_M * distance_m / total  # than an exceedance
    edges = np.asarray([border for border in DRAC_BORDER_MPS2[:-1] if border >= threshold]) - threshold
    shape, level = SHAPES[:, None], LEVELS_MPS2[None, :]
    scale = level * shape / np.expm1(-shape * np.log(min(rarer, 0.5)))  # of the tail that has this level
    survival = survival_of(edges[:, None, None], shape, scale)
    shares = np.concatenate([survival[:-1] - survival[1:], survival[-1:]])
    likelihood = np.tensordot(beyond.sum(axis=0), np.log(np.maximum(shares, 1e-300)), axes=1)
    best_shape, best_level = np.unravel_index(int(np.argmax(likelihood)), likelihood.shape)
    profile = 2.0 * (likelihood.max() - likelihood.max(axis=0)) / _dispersion(beyond.sum(axis=1))
    inside = LEVELS_MPS2[profile <= fisher.ppf(CONFIDENCE, 1, len(counts) - 1)]
    return Tail(
        level_mps2=float(threshold + LEVELS_MPS2[best_level]),
        interval_90_mps2=(float(threshold + inside[0]), float(threshold + inside[-1])),
        shape=float(SHAPES[best_shape]),
    )


def survival_of(
    excess: Float[np.ndarray, "*#size"], shape: Float[np.ndarray, "*#size"], scale: Float[np.ndarray, "*#size"]
) -> Float[np.ndarray, "*size"]:
    """Share of a generalised Pareto distribution that lies above an excess; the shape must not be 0."""
    return np.maximum(1.0 + shape * excess / scale, 0.0) ** (-1.0 / shape)


def _beyond(counts: Float[np.ndarray, "drive bin"], threshold: float) -> Float[np.ndarray, "drive class"]:
    return counts[:, np.asarray(DRAC_BORDER_MPS2)[:-1] >= threshold]


def _dispersion(exceedances: Float[np.ndarray, " drive"]) -> float:
    """Variance of exceedances between drives over that of independent ones, at least 1."""
    return max(float(exceedances.var(ddof=1) / exceedances.mean()), 1.0)
