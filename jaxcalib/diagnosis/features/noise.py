"""What the field would differ by without any effect: chance, the calibration's error, and the simulation's."""

from dataclasses import dataclass

import numpy as np
from sklearn.covariance import LedoitWolf

from jaxcalib.diagnosis.features.features import Cell, DriveTallies

FEWEST_EFFECTIVE_DRIVES = 3.5
FEWEST_EFFECTIVE_RUNS = 10.0
# An identity holds in every drive, and what it leaves open is a tolerance rather than chance: a few drives will do.
FEWEST_DRIVES_OF_IDENTITY, FEWEST_RUNS_OF_IDENTITY = 1.5, 4.0
FEWEST_EVENTS = 5.0
TAIL, NORMAL_TAIL = 0.995, 2.807  # a quantile of means over as many drives as the field has, and the normal one
MOST_TAIL = 3.0
NUM_DRAWS = 1000
LEAST_DEVIATION = 1e-9
CORRELATION_FLOOR = 0.15  # share of the identity that is mixed into correlations: 300 features rest on some 60 runs


@dataclass(frozen=True)
class NullModel:
    """Distribution of the field's features where nothing is missing in the simulator but a shift of its parameters.

    Features count in units of `deviation`: the noise of a field of as many drives.
    """

    cells: tuple[Cell, ...]  # the features that both field and simulation observe often enough
    mean: np.ndarray  # features of the simulation
    deviation: np.ndarray  # noise of the field's features, its own simulation error included
    covariance: np.ndarray  # of all that is unknown without an effect, in those units
    noise: np.ndarray  # the same without the parameters' shift
    slope: np.ndarray  # change of the features per step of each parameter, in those units
    prior_steps: np.ndarray  # standard deviation of the shift that the calibration may have left, in steps

    def standardised(self, values: np.ndarray) -> np.ndarray:
        """Return the difference of feature values from the simulation's, in units of noise."""
        return (values - self.mean) / self.deviation


def effective_number(below: np.ndarray) -> np.ndarray:
    """Effective number of drives behind a pooled quotient, by its denominators, [drive, feature]."""
    return below.sum(axis=0) ** 2 / np.maximum((below**2).sum(axis=0), 1e-12)


def on_cells(tallies: DriveTallies, cells: tuple[Cell, ...]) -> DriveTallies:
    """Return tallies of the given features; those that were never observed are 0."""
    column_of = {cell: index for index, cell in enumerate(tallies.cells)}
    above, below = np.zeros((2, len(tallies), len(cells)))
    for index, cell in enumerate(cells):
        if cell in column_of:
            above[:, index], below[:, index] = tallies.above[:, column_of[cell]], tallies.below[:, column_of[cell]]
    return DriveTallies(cells, above, below, tallies.depart_s, tallies.run)


def measured_shift(runs: DriveTallies, plain: DriveTallies, null: NullModel) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much runs differ from the null model's and its standard error, in units of noise.

    Features that the runs do not show count as unchanged, with an infinite error. `plain` are the null model's
    own runs.
    """
    ours, theirs = on_cells(runs, null.cells), on_cells(plain, null.cells)
    variance = sum(
        np.nan_to_num(some.influence()).var(axis=0, ddof=1) / some.num_independent for some in (ours, theirs)
    )
    shift = null.standardised(ours.values())
    is_known = np.isfinite(shift) & (ours.below.sum(axis=0) > 0)
    return np.where(is_known, shift, 0.0), np.where(is_known, np.sqrt(variance) / null.deviation, np.inf)


def observed_cells(field: DriveTallies, null: DriveTallies) -> tuple[Cell, ...]:
    """Return the features that both observe often enough to have a mean and a noise."""
    cells = tuple(cell for cell in null.cells if cell in set(field.cells))
    field, null = on_cells(field, cells), on_cells(null, cells)
    is_identity = null.tolerance > 0.0
    fewest_drives = np.where(is_identity, FEWEST_DRIVES_OF_IDENTITY, FEWEST_EFFECTIVE_DRIVES)
    fewest_runs = np.where(is_identity, FEWEST_RUNS_OF_IDENTITY, FEWEST_EFFECTIVE_RUNS)
    enough = effective_number(field.below) >= np.minimum(fewest_drives, 0.6 * len(field))
    of_runs = null.of_runs(null.below)  # drives of one run share its jams
    enough &= effective_number(null.below) >= fewest_runs
    enough &= effective_number(of_runs) >= np.minimum(fewest_runs, 0.5 * len(of_runs))
    # events: fewer than a handful have no normal distribution
    ratio = null.above.mean(axis=0) / np.maximum(null.below.mean(axis=0), 1e-12)
    expected = np.abs(ratio) * field.below.sum(axis=0)
    fewest = FEWEST_EVENTS * null.rows_per_event
    enough &= np.maximum(expected, np.abs(field.above.sum(axis=0))) >= fewest
    enough &= np.isfinite(field.values()) & np.isfinite(null.values())
    varies = np.nan_to_num(null.influence()).std(axis=0) > LEAST_DEVIATION  # what is always the same has no noise
    enough &= varies | is_identity | (null.rows_per_event > 0.0)
    return tuple(cell for cell, kept in zip(cells, enough, strict=True) if kept)


def null_model(
    cells: tuple[Cell, ...],
    field_below: np.ndarray,
    null: DriveTallies,
    slope: np.ndarray,
    slope_error: np.ndarray,
    prior_steps: np.ndarray,
    more_influence: np.ndarray | None,
    num_drives: int,
    flat_deviation: np.ndarray | float = LEAST_DEVIATION,
) -> NullModel:
    """Return the null model for a field.

    Args:
        cells: the features.
        field_below: denominators of the field's pooled features; a mean of fewer observations is noisier.
        null: tallies of SUMO runs with the calibrated values.
        slope: change of the features per step of each parameter, [feature, parameter].
        slope_error: its standard error.
        prior_steps: prior standard deviation of the parameters' shift, in steps.
        more_influence: influences of further runs, for the correlations; nan or 0 where they do not know a feature.
        num_drives: drives in the field.
        flat_deviation: noise of each feature that is the same in all runs; some of them may not show what varies.
    """
    null = on_cells(null, cells)
    influence = np.nan_to_num(null.influence())
    spread = influence.std(axis=0, ddof=1)
    per_drive = null.below.mean(axis=0)
    rarer = np.maximum(per_drive / np.maximum(field_below / num_drives, 1e-12), 1.0)
    chance = spread * np.sqrt(rarer / num_drives + 1.0 / null.num_independent)
    chance = chance * heavy_tail(influence, more_influence, num_drives)
    clump = null.rows_per_event  # counts scatter as Poisson's do; 0 makes no floor
    total = np.maximum(np.abs(null.above.mean(axis=0)) * num_drives, clump) * clump
    floor = np.where(null.is_logarithmic, 0.0, np.sqrt(total) / np.maximum(field_below, 1e-12))
    chance = np.maximum(chance, floor)
    deviation = np.sqrt(chance**2 + null.tolerance**2)
    is_flat = deviation <= LEAST_DEVIATION
    deviation = np.where(is_flat, flat_deviation, deviation)
    share = np.where(is_flat, 1.0, chance / deviation)
    correlation = shrunk_correlation(influence, spread, more_influence)
    noise = correlation * np.outer(share, share) + np.diag((null.tolerance / deviation) ** 2)
    scaled = slope / deviation[:, None]
    error = slope_error / deviation[:, None]
    sizes = np.minimum(prior_steps, 1.0)
    uncertain = np.diag(np.sum((error * sizes) ** 2, axis=1))
    covariance = noise + uncertain + (scaled * prior_steps**2) @ scaled.T
    return NullModel(cells, null.values(), deviation, covariance, noise + uncertain, scaled, prior_steps)


def heavy_tail(influence: np.ndarray, more: np.ndarray | None, num_drives: int) -> np.ndarray:
    """Length of the tail of a mean over drives over that of a normal one of the same deviation, at least 1.

    Jams come in some runs only: means of a few drives are far from normal then, and a normal tail would cry wolf.
    """
    random = np.random.default_rng(0)
    longest = np.ones(influence.shape[1])
    for runs in [influence] + ([more] if more is not None and len(more) > 30 else []):
        spread = runs.std(axis=0, ddof=1)
        drawn = random.integers(0, len(runs), (NUM_DRAWS, num_drives))
        mean = np.abs(sum(runs[drawn[:, k]] for k in range(num_drives))) / num_drives
        tail = np.quantile(mean, TAIL, axis=0) * np.sqrt(num_drives) / NORMAL_TAIL
        longest = np.maximum(longest, np.where(spread > 0, tail / np.where(spread > 0, spread, 1.0), 1.0))
    return np.minimum(longest, MOST_TAIL)


def shrunk_correlation(influence: np.ndarray, spread: np.ndarray, more: np.ndarray | None) -> np.ndarray:
    """Return correlations of features between drives, from SUMO's runs and the many more of the surrogate."""
    own = LedoitWolf(assume_centered=True, store_precision=False).fit(influence / np.maximum(spread, 1e-12)).covariance_
    mixed = np.array(own)
    if more is not None and len(more) > 30:
        other_spread = more.std(axis=0, ddof=1)
        known = other_spread > 0
        scaled = np.where(known, more / np.where(known, other_spread, 1.0), 0.0)
        other = LedoitWolf(assume_centered=True, store_precision=False).fit(scaled).covariance_
        both = np.outer(known, known)
        weight = len(more) / (len(more) + 3.0 * len(influence))
        mixed = np.where(both, (1.0 - weight) * own + weight * other, own * (1.0 - 0.5 * weight))
    diagonal = np.sqrt(np.maximum(np.diag(mixed), 1e-9))
    mixed = mixed / np.outer(diagonal, diagonal)
    return nearest_correlation((1.0 - CORRELATION_FLOOR) * mixed + CORRELATION_FLOOR * np.eye(len(mixed)))


def nearest_correlation(matrix: np.ndarray) -> np.ndarray:
    """Return a matrix of correlations without eigenvalues that are too small."""
    value, vector = np.linalg.eigh(0.5 * (matrix + matrix.T))
    fixed = (vector * np.maximum(value, 0.03)) @ vector.T
    diagonal = np.sqrt(np.diag(fixed))
    return fixed / np.outer(diagonal, diagonal)
