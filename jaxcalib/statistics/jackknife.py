"""Standard errors from leaving out one run or drive at a time."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

Statistic = Callable[[Float[np.ndarray, " tally"]], Float[np.ndarray, " value"]]


def jackknife(
    tallies: Float[np.ndarray, "run tally"], statistic: Statistic
) -> tuple[Float[np.ndarray, " value"], Float[np.ndarray, " value"]]:
    """Statistics of summed tallies and their standard errors over runs; nan of a single run.

    Args:
        tallies: of each run.
        statistic: values of summed tallies.

    Source: Efron & Stein (1981), The jackknife estimate of variance, Ann. Statist. 9.
    """
    total, num_runs = tallies.sum(axis=0), len(tallies)
    values = statistic(total)
    if num_runs < 2:
        return values, np.full(len(values), np.nan)
    others = np.stack([statistic(total - run) for run in tallies])
    spread = np.sum((others - others.mean(axis=0)) ** 2, axis=0)
    return values, np.sqrt((num_runs - 1) / num_runs * spread)
