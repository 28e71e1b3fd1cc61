"""Percentile intervals of the bootstrap."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Int


def percentile_interval(
    statistic: Callable[[Int[np.ndarray, " item"]], float | None],
    num_items: int,
    random: np.random.Generator,
    num_draws: int,
    shares: tuple[float, float] = (0.025, 0.975),
    method: Literal["linear", "nearest"] = "linear",
) -> tuple[float, float] | None:
    """Return the interval of a statistic of items drawn with replacement; None where no draw has one.

    Args:
        statistic: of the numbers of the items drawn; None where these items have none.
        num_items: items to draw from; as many are drawn each time.
        random: of the draws.
        num_draws: times that items are drawn.
        shares: of draws below each end.
        method: how to take quantiles; "nearest" where statistics may be infinite.
    """
    drawn = random.integers(num_items, size=(num_draws, num_items))
    known = [one for one in map(statistic, drawn) if one is not None]
    if not known:
        return None
    low, high = np.quantile(known, shares, method=method)
    return float(low), float(high)
