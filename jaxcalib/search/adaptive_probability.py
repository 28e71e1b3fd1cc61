"""Crossover and mutation probabilities that adapt to the accuracy of the parents, Eqs. 21-22."""

import numpy as np
from jaxtyping import Float

SMALLEST_SPREAD = 1e-12  # of accuracies: below it a generation counts as converged


def adaptive_probability(
    accuracy: Float[np.ndarray, "..."],
    mean_accuracy: float,
    best_accuracy: float,
    probability_min: float,
    probability_max: float,
) -> Float[np.ndarray, "..."]:
    """Return the probability that belongs to an accuracy: the better the parents, the less they are disturbed.

    It falls linearly from `probability_max` at the mean of the current generation to `probability_min` at its best.

    Args:
        accuracy: f, of the parents; nan counts as not above the mean.
        mean_accuracy: f_avg,cur, mean of the successful candidates of the current generation.
        best_accuracy: f_max,cur, best of the current generation, not of the whole search.
        probability_min: at the best accuracy, in [0, probability_max].
        probability_max: at and below the mean accuracy, in [probability_min, 1].

    Source: Eqs. 21 (crossover) and 22 (mutation), which are the same function.
    Deviation: where best and mean coincide, the equations are 0 / 0; then the probability is `probability_max`.
    """
    spread = best_accuracy - mean_accuracy
    accuracy = np.asarray(accuracy, dtype=np.float64)
    if not spread >= SMALLEST_SPREAD:
        return np.full(accuracy.shape, probability_max)
    share = np.where(accuracy > mean_accuracy, (accuracy - mean_accuracy) / spread, 0.0)
    return probability_max - (probability_max - probability_min) * np.minimum(share, 1.0)
