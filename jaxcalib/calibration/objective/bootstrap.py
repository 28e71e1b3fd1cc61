"""Errors of simulations and drives drawn again, for the intervals of errors and of their change."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy import stats

from jaxcalib.calibration.objective.accuracy import MOES, VEHICLE_LEVEL_SUM, effectiveness
from jaxcalib.measures.measure import Measure

NUM_DRAWS = 1000
PROBABILITY = 0.9

Samples = Mapping[str, Float[np.ndarray, " draw"]]


def bootstrap_errors(
    measures: Mapping[str, Measure],
    tally_names: tuple[str, ...],
    field: Float[np.ndarray, "drive tally"],
    runs: Float[np.ndarray, "run tally"],
    num_draws: int = NUM_DRAWS,
    seed: int = 0,
) -> Samples:
    """Return samples of each error and of Eq. 23, drives and runs drawn with replacement; nan where there is none.

    The same seed draws the same drives, whatever the runs: samples of two simulations can be compared one by one.

    Args:
        measures: all measures, by name.
        tally_names: names of the tallies.
        field: tallies of each drive.
        runs: tallies of each run.
        num_draws: number of samples.
        seed: of the draws.
    """
    of_drives, of_runs = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(2))
    samples = {name: np.full(num_draws, np.nan) for name in (*MOES, VEHICLE_LEVEL_SUM)}
    for draw in range(num_draws):
        real = field[of_drives.integers(0, len(field), len(field))].sum(axis=0)
        model = runs[of_runs.integers(0, len(runs), len(runs))].sum(axis=0)
        drawn = effectiveness(measures, tally_names, real, model)
        samples[VEHICLE_LEVEL_SUM][draw] = drawn.vehicle_level
        for name, error in drawn.errors.items():
            if error is not None:
                samples[name][draw] = error
    return samples


def interval_of(samples: Float[np.ndarray, " draw"], num_drives: int) -> tuple[float, float] | None:
    """Return the 90 % interval that samples tell of; None if there is none, or a single drive.

    Source: Hesterberg (2015), "What Teachers Should Know About the Bootstrap", The American Statistician 69(4), on
    narrowness bias and the expanded percentile interval. The plain percentile interval is short by the factor
    sqrt((n - 1) / n) and by normal instead of t quantiles, which counts with three or four drives.

    Args:
        samples: as `bootstrap_errors` gives them.
        num_drives: drives that they were drawn from.
    """
    known = samples[np.isfinite(samples)]
    if not len(known) or num_drives < 2:
        return None
    tail = (1.0 - PROBABILITY) / 2.0
    widened = np.sqrt(num_drives / (num_drives - 1.0)) * stats.t.ppf(tail, num_drives - 1.0)
    expanded = float(stats.norm.cdf(widened))
    low, high = np.quantile(known, [expanded, 1.0 - expanded])
    return float(low), float(high)
