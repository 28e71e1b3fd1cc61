"""How alike the critical parameters of two traffic patterns are, and how alike chance would make them."""

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.stats import hypergeom


def similarity_index(first: Sequence[str], second: Sequence[str]) -> float:
    """Return the share of parameters that two sets of K have in common.

    Raises:
        ValueError: the sets are empty or of different sizes.

    Source: Eq. 37.
    """
    if not first or len(set(first)) != len(set(second)):
        raise ValueError(f"Expected two sets of one size; got {len(set(first))} and {len(set(second))} parameters.")
    return len(set(first) & set(second)) / len(set(first))


def similarity_matrix(sets: Sequence[Sequence[str]]) -> np.ndarray:
    """Return Eq. 37 for all pairs, [set, set]."""
    return np.asarray([[similarity_index(one, other) for other in sets] for one in sets])


def pair_shares(sets: Sequence[Sequence[str]], least: float) -> float | None:
    """Return the share of pairs whose similarity is at least so high; None if there is no pair."""
    pairs = [similarity_index(one, other) for one, other in itertools.combinations(sets, 2)]
    return float(np.mean([index >= least - 1e-12 for index in pairs])) if pairs else None


def chance_similarity(num_critical: int, num_parameters: int) -> float:
    """Return the expected similarity of two sets of K drawn from n parameters at random: K / n."""
    return num_critical / num_parameters


def chance_at_least(least: float, num_critical: int, num_parameters: int) -> float:
    """Return the probability that two random sets of K of n parameters are at least so similar (hypergeometric)."""
    fewest = int(np.ceil(least * num_critical - 1e-9))
    return float(hypergeom.sf(fewest - 1, num_parameters, num_critical, num_critical))
