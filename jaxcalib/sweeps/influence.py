"""Which parameter of a sweep moves which measure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata

from jaxcalib.sweeps.columns import OBSERVATIONS

FEWEST_CANDIDATES = 3


@dataclass(frozen=True)
class CandidateMeans:
    """What the runs of each candidate show together; candidates without a successful run are left out.

    Attributes:
        parameters: values by name.
        measures: values by name, runs weighted by their observations; nan where nothing was observed.
    """

    parameters: Mapping[str, Float[np.ndarray, " candidate"]]
    measures: Mapping[str, Float[np.ndarray, " candidate"]]

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(next(iter(self.parameters.values())))


def candidate_means(
    rows: Mapping[str, np.ndarray], column_of: Mapping[str, str], measures: Sequence[str]
) -> CandidateMeans:
    """Return the means of each candidate, from the columns of a sweep's table."""
    good = rows["status"] == "OK"
    _, first, place = np.unique(rows["candidate"][good], return_index=True, return_inverse=True)
    means = {}
    for name in measures:
        values, weights = rows[name][good], rows[OBSERVATIONS + name][good]
        weights = np.where(np.isfinite(values), weights, 0.0)
        above = np.bincount(place, np.where(weights > 0.0, values, 0.0) * weights, len(first))
        below = np.bincount(place, weights, len(first))
        means[name] = np.divide(above, below, out=np.full(len(first), np.nan), where=below > 0.0)
    return CandidateMeans({name: rows[column][good][first] for name, column in column_of.items()}, means)


def rank_correlation(means: CandidateMeans) -> Float[np.ndarray, "parameter measure"]:
    """Return Spearman's rank correlation of each parameter with each measure; nan where one of them is constant."""
    table = np.full((len(means.parameters), len(means.measures)), np.nan)
    for column, measured in enumerate(means.measures.values()):
        known = np.isfinite(measured)
        if known.sum() < FEWEST_CANDIDATES:
            continue
        ranks = rankdata(measured[known])
        for row, values in enumerate(means.parameters.values()):
            others = rankdata(values[known])
            if np.ptp(ranks) > 0.0 and np.ptp(others) > 0.0:
                table[row, column] = np.corrcoef(ranks, others)[0, 1]
    return table
