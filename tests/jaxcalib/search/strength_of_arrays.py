"""How strong an orthogonal array is, by counting."""

import numpy as np
from jaxtyping import Int


def is_balanced(levels: Int[np.ndarray, "case factor"], num_levels: int) -> bool:
    """Return whether every factor shows every level equally often (strength 1)."""
    counts = (levels[:, :, None] == np.arange(num_levels)).sum(axis=0)
    return bool((counts * num_levels == levels.shape[0]).all())


def has_strength_two(levels: Int[np.ndarray, "case factor"], num_levels: int) -> bool:
    """Return whether every pair of factors shows every pair of levels equally often."""
    num_cases, num_factors = levels.shape
    shows = (levels[:, :, None] == np.arange(num_levels)).astype(np.float64).reshape(num_cases, -1)
    pair_counts = (shows.T @ shows).reshape(num_factors, num_levels, num_factors, num_levels)
    is_other_factor = ~np.eye(num_factors, dtype=bool)
    return is_balanced(levels, num_levels) and bool(
        (pair_counts.transpose(0, 2, 1, 3)[is_other_factor] * num_levels**2 == num_cases).all()
    )


def has_strength_three(levels: Int[np.ndarray, "case factor"], num_levels: int) -> bool:
    """Return whether every three factors show every triple of levels equally often; meant for a few factors."""
    num_cases, num_factors = levels.shape
    for i in range(num_factors):
        for j in range(i + 1, num_factors):
            for k in range(j + 1, num_factors):
                number = (levels[:, i] * num_levels + levels[:, j]) * num_levels + levels[:, k]
                counts = np.bincount(number, minlength=num_levels**3)
                if (counts * num_levels**3 != num_cases).any():
                    return False
    return True
