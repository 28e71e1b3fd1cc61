"""Where accepted gaps begin: the edge of a distribution whose smallest values are not to be trusted.

Gaps, as shares of the secure gap, are accepted from an edge on. Some pile up there, for drivers change as soon as they
may; the others lie beyond it. A few lie anywhere, even below: a neighbour moved at the same moment, a track was cut, a
sensor erred. How many is not known beforehand (a fixed quantile fails as soon as they are more), so it is estimated
with the edge, its blur and the two scales behind it: the posterior mean over a grid of all of them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import exponnorm

EDGES = np.geomspace(0.15, 5.0, 176)
BLURS = np.asarray([0.01, 0.03, 0.06])  # of the edge, beside each share's own error
SCALES = np.asarray([0.2, 0.4, 0.8, 1.6])  # of the edge: how far beyond it gaps lie
PILE_SCALE = 0.05  # of the edge: how near to it those lie that had waited
PILES = np.asarray([0.0, 0.2, 0.5])
STRAYS = np.asarray([0.01, 0.03, 0.1, 0.25, 0.45])
LARGEST_SHARE = 6.0  # beyond it a gap says nothing of the edge
LOWEST_STRAY = -1.0


@dataclass(frozen=True)
class AcceptanceEdge:
    """Where accepted gaps begin."""

    share: float  # of the secure gap
    logarithmic_error: float  # standard deviation of its logarithm


def acceptance_edge(share: np.ndarray, error: np.ndarray) -> AcceptanceEdge:
    """Return the edge that accepted shares begin at; all values of the grid are equally likely beforehand.

    Args:
        share: accepted gaps over secure gaps, finite, [change].
        error: standard error of each, above zero, [change].
    """
    near = share < LARGEST_SHARE
    share, error = share[near], error[near]
    log_likelihood = np.asarray([_log_likelihood(share, error, edge) for edge in EDGES])
    weight = np.exp(log_likelihood - logsumexp(log_likelihood))
    logarithm = np.log(EDGES)
    mean = float(weight @ logarithm)
    return AcceptanceEdge(float(np.exp(mean)), float(np.sqrt(weight @ (logarithm - mean) ** 2)))


def _log_likelihood(share: np.ndarray, error: np.ndarray, edge: float) -> float:
    """Return the log likelihood of an edge, averaged over blurs, scales, piles and strays."""
    blur = np.hypot(error, edge * BLURS[:, None])

    def beyond(scale: np.ndarray) -> np.ndarray:
        return exponnorm.pdf(share, edge * scale / blur, loc=edge, scale=blur)  # [blur, change]

    pile = PILES[:, None, None, None, None]
    stray = STRAYS[:, None, None, None]
    rest = np.stack([beyond(scale) for scale in SCALES])
    density = pile * beyond(np.asarray(PILE_SCALE)) + (1.0 - pile) * rest  # [pile, stray, scale, blur, change]
    anywhere = stray / (LARGEST_SHARE - LOWEST_STRAY)
    total = np.log((1.0 - stray) * density + anywhere).sum(axis=-1)
    return float(logsumexp(total) - np.log(total.size))
