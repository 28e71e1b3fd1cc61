"""Rates and their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

NUM_RESAMPLES = 10_000


@dataclass(frozen=True)
class Rate:
    """A share of cases."""

    hits: int  # cases that count
    of: int  # all cases
    low: float  # lower end of Wilson's 95 % interval; NaN where there are no cases
    high: float  # upper end

    @property
    def value(self) -> float:
        """Return the share; NaN where there are no cases."""
        return self.hits / self.of if self.of else float("nan")


def rate(marks: Sequence[bool]) -> Rate:
    """Return the share of true marks with Wilson's score interval (Wilson 1927)."""
    hits, of = int(sum(marks)), len(marks)
    if not of:
        return Rate(0, 0, float("nan"), float("nan"))
    interval = binomtest(hits, of).proportion_ci(0.95, method="wilson")
    return Rate(hits, of, float(interval.low), float(interval.high))


def paired_difference(ours: Sequence[bool], theirs: Sequence[bool]) -> tuple[float, float]:
    """Return the difference of two rates on the same cases and the lower end of its 95 % interval (bootstrap)."""
    steps = np.asarray(ours, dtype=float) - np.asarray(theirs, dtype=float)
    if not len(steps):
        return float("nan"), float("nan")
    rng = np.random.default_rng(0)
    means = steps[rng.integers(len(steps), size=(NUM_RESAMPLES, len(steps)))].mean(axis=1)
    return float(steps.mean()), float(np.quantile(means, 0.025))
