"""How far the gap shrinks, on drives that nothing was fitted to or chosen by.

The gap is the mean square of the differences between drives and simulation, weighed by the covariance of the drives'
noise: features that move together with one jam count once, those that hardly vary count for what they show. Where an
effect brings more chance than there is without it, that counts: else the gap would be that of a few features which
hardly vary without the effect.

The floor is what chance makes of the gap of a perfect simulation. It comes from the drives to fit, by how far two
halves of them differ: drives scatter farther than runs of a calibrated simulation, by a half in fields without any
effect. Where there are too few, it comes from runs, with the effect where one was found. The fraction closed needs no
floor but for the error of the simulations' means; see `crossed_gap`.

Source: Mahalanobis (1936), Proc. Natl. Inst. Sci. India 2, 49-55, eq. 3.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from jaxcalib.diagnosis.features.features import DriveTallies
from jaxcalib.diagnosis.features.noise import NullModel, on_cells
from jaxcalib.diagnosis.inference.crossed_gap import Closed, fraction_closed
from jaxcalib.diagnosis.runs.explained_runs import ExplainedRuns

NUM_SETS = 400
FEWEST_DRIVES = 4
NUM_SPLITS = 60


@dataclass(frozen=True)
class Shrinkage:
    """Gaps on held-out drives."""

    default: float | None  # of the scenario as it is; None where its runs failed
    recalibrated: float  # of the calibrated simulation
    with_effect: float  # of that with the effect
    ceiling: float  # with all effects of the library at once, each as strong as the drives to fit ask for
    floor: float  # what chance alone makes of it
    # share of the gap that the effect closes, at most 1; None where there is no gap, or nothing was named
    fraction_closed: float | None
    interval_90: tuple[float, float] | None  # its interval; None where there is no fraction, or a single drive


@dataclass(frozen=True)
class Gap:
    """Measures gaps of differences that are in units of a null model's noise."""

    root: np.ndarray  # lower triangular root of the noise's covariance

    @staticmethod
    def of(null: NullModel, deviation: np.ndarray | None = None) -> "Gap":
        """Return the measure for a null model; where a deviation of the features is given, the larger noise counts."""
        longer = np.ones(len(null.cells)) if deviation is None else np.maximum(deviation, 1.0)
        return Gap(longer[:, None] * np.linalg.cholesky(null.noise))

    def directions(self, difference: np.ndarray) -> np.ndarray:
        """Return a difference in directions whose noise is independent; [feature] or [feature, set]."""
        return solve_triangular(self.root, np.nan_to_num(difference, nan=0.0), lower=True, check_finite=False)

    def __call__(self, difference: np.ndarray) -> float:
        """Return the gap of a difference; features that the drives do not show count as explained."""
        return float(np.mean(self.directions(difference) ** 2))


def differences_by_chance(
    simulated: DriveTallies, null: NullModel, num_drives: int, random: np.random.Generator
) -> np.ndarray:
    """Differences of sets of runs, as many as there are drives, from all of them, in units of noise, [set, feature].

    A set is part of the runs that it is compared with; what that takes off its variance is put back.
    """
    runs = on_cells(simulated, null.cells)
    all_values = _seen_values(runs, null)
    size = min(num_drives, len(runs) // 2)
    scale = np.sqrt((1.0 / num_drives + 1.0 / runs.num_independent) / (1.0 / size - 1.0 / len(runs)))
    differences = []
    for _ in range(NUM_SETS):
        drawn = runs.take(random.permutation(len(runs))[:size])
        values = np.where(drawn.below.sum(axis=0) > 0, drawn.values(), all_values)
        differences.append(scale * (null.standardised(values) - null.standardised(all_values)))
    return np.asarray(differences)


def floor_of_drives(
    drives: DriveTallies, null: NullModel, gap: Gap, num_drives: int, num_runs: float, random: np.random.Generator
) -> float | None:
    """Return the gap between so many drives and the mean of so many runs of a perfect simulation, from drives' halves.

    It is unbiased for features that are linear in the tallies, whatever the drives have in common. None for too few.
    """
    if len(drives) < FEWEST_DRIVES:
        return None
    size = len(drives) // 2
    gaps = []
    for _ in range(NUM_SPLITS):
        one, other = (drives.take(half) for half in np.split(random.permutation(len(drives)), [size]))
        apart = null.standardised(one.values()) - null.standardised(other.values())
        scale = (1.0 / num_drives + 1.0 / num_runs) / (1.0 / size + 1.0 / (len(drives) - size))
        gaps.append(scale * gap(apart))
    return float(np.mean(gaps))


def _seen_values(runs: DriveTallies, null: NullModel) -> np.ndarray:
    return np.where(runs.below.sum(axis=0) > 0, runs.values(), null.mean)


def measure_shrinkage(
    held_out: DriveTallies,
    null: NullModel,
    simulated: DriveTallies,
    expected: Mapping[str, np.ndarray | None],
    random: np.random.Generator,
    explained_runs: ExplainedRuns | None = None,
    fit_drives: DriveTallies | None = None,
) -> Shrinkage:
    """Return the gaps.

    Args:
        held_out: tallies of the drives.
        null: the null model for as many drives.
        simulated: tallies of the null runs, for the floor.
        expected: by how much features differ from the null's, in units of noise, in the scenario as it is
            ("default"; None where its runs failed), with the parameters that the drives to fit ask for
            ("recalibrated"), with the effect ("with_effect"; None where none was found), and with all effects at once
            ("ceiling").
        random: for the floor.
        explained_runs: runs with the effect, for the chance that it brings; None where there are none.
        fit_drives: tallies of the drives to fit, for the floor and the fraction closed; None to take the floor from
            the runs, and to tell no fraction.
    """
    tallies = on_cells(held_out, null.cells)
    gap = Gap.of(null, None if explained_runs is None else explained_runs.deviation(null, len(tallies)))
    difference = null.standardised(tallies.values())
    left = {name: difference - shift for name, shift in expected.items() if shift is not None}
    gaps = {name: gap(remaining) for name, remaining in left.items()}
    runs = simulated if explained_runs is None else explained_runs.with_effect
    by_chance = differences_by_chance(runs, null, len(tallies), random)
    floor = float(np.mean([gap(drawn) for drawn in by_chance]))
    if fit_drives is not None:
        told = floor_of_drives(on_cells(fit_drives, null.cells), null, gap, len(tallies), runs.num_independent, random)
        floor = floor if told is None else told
    recalibrated = gaps["recalibrated"]
    with_effect = gaps.get("with_effect", recalibrated)
    ceiling = min(gaps["ceiling"], with_effect)
    closed = Closed(None, None)
    shift = expected.get("with_effect")
    if shift is not None and fit_drives is not None and expected["recalibrated"] is not None:
        of_one = floor / (1.0 / len(tallies) + 1.0 / runs.num_independent)
        shifts = (expected["recalibrated"], shift)
        in_common = (of_one / simulated.num_independent, of_one / runs.num_independent)
        closed = fraction_closed(tallies, on_cells(fit_drives, null.cells), null, gap.directions, shifts, in_common)
    return Shrinkage(
        gaps.get("default"), recalibrated, with_effect, ceiling, floor, closed.fraction, closed.interval_90
    )
