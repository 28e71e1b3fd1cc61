"""Selection, crossover and mutation on the unit cube, and probabilities that adapt to the parents (Eqs. 21-22)."""

import numpy as np
from jaxtyping import Bool, Float, Int

SMALLEST_SPREAD = 1e-12  # of accuracies: below it a generation counts as converged
WINDOW_SHARE = 0.01  # weight of the worst successful candidate, as a share of the spread of accuracies
NUM_MUTATED_GENES = 2


def windowed_weights(
    accuracy: Float[np.ndarray, " candidate"], is_successful: Bool[np.ndarray, " candidate"]
) -> Float[np.ndarray, " candidate"]:
    """Return roulette weights f - f_min + eps; failed candidates weigh nothing.

    Adding a constant to all accuracies, or scaling them, does not change the probabilities.

    Source: Eq. 19.
    Deviation: Eq. 19 uses f itself, which gives probabilities below 0 or above 1 as soon as an accuracy is negative.
    """
    weights = np.zeros(accuracy.shape)
    if is_successful.any():
        counted = accuracy[is_successful]
        spread = counted.max() - counted.min()
        weights[is_successful] = (
            counted - counted.min() + WINDOW_SHARE * spread if spread >= SMALLEST_SPREAD else np.ones(counted.shape)
        )
    return weights


def ranked_weights(
    accuracy: Float[np.ndarray, " candidate"], is_successful: Bool[np.ndarray, " candidate"]
) -> Float[np.ndarray, " candidate"]:
    """Return roulette weights 1, 2, ... by ascending accuracy; failed candidates weigh nothing.

    One very bad candidate does not level the others, as it does with `windowed_weights`. Equal accuracies share the
    mean of their ranks.

    Source: linear ranking, Baker (1985).
    Deviation: replaces Eq. 19.
    """
    weights = np.zeros(accuracy.shape)
    counted = accuracy[is_successful]
    num_worse = (counted[:, None] > counted[None, :]).sum(axis=1)
    num_equal = (counted[:, None] == counted[None, :]).sum(axis=1)
    weights[is_successful] = num_worse + 0.5 * (num_equal + 1)
    return weights


def literal_weights(
    accuracy: Float[np.ndarray, " candidate"], is_successful: Bool[np.ndarray, " candidate"]
) -> Float[np.ndarray, " candidate"] | None:
    """Return the weights of Eq. 19 as printed, or None where they are no probabilities.

    Source: Eq. 19.
    """
    weights = np.where(is_successful, accuracy, 0.0)
    return weights if (weights >= 0.0).all() and weights.sum() > 0.0 else None


def spin_roulette(
    weights: Float[np.ndarray, " candidate"], uniforms: Float[np.ndarray, " draw"]
) -> Int[np.ndarray, " draw"]:
    """Return the candidate that each uniform number falls on.

    The uniform numbers are scaled to the last cumulative sum, so nothing depends on the weights summing to 1.

    Args:
        weights: >= 0, not all 0, any sum; a candidate of weight 0 is never drawn.
        uniforms: in [0, 1].

    Raises:
        ValueError: a weight is negative or not finite, or all are 0.
    """
    cumulative = np.cumsum(weights, dtype=np.float64)
    if not (np.isfinite(weights).all() and (weights >= 0.0).all() and cumulative[-1] > 0.0):
        raise ValueError("Expected finite weights >= 0 that are not all 0.")
    picked = np.searchsorted(cumulative, uniforms * cumulative[-1], side="right")
    return np.minimum(picked, np.flatnonzero(weights)[-1])


def reflect_into_unit_cube(points: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Return the points folded back at 0 and at 1, as often as needed."""
    folded = np.mod(points, 2.0)
    return np.where(folded > 1.0, 2.0 - folded, folded)


def blend_crossover(
    parent_a: Float[np.ndarray, " parameter"],
    parent_b: Float[np.ndarray, " parameter"],
    alpha: float,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
    """Return two offspring, each gene uniform between the parents' genes and a share alpha of their distance beyond.

    Parents lie in the unit cube; alpha 0.5 keeps the spread of the population on average.

    Source: BLX-alpha, Eshelman & Schaffer (1993); the paper does not say which crossover it uses.
    Deviation: offspring beyond the unit cube are reflected into it.
    """
    low, high = np.minimum(parent_a, parent_b), np.maximum(parent_a, parent_b)
    reach = alpha * (high - low)
    offspring = reflect_into_unit_cube(rng.uniform(low - reach, high + reach, size=(2, low.shape[0])))
    return offspring[0], offspring[1]


def uniform_crossover(
    parent_a: Float[np.ndarray, " parameter"], parent_b: Float[np.ndarray, " parameter"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, " parameter"], Float[np.ndarray, " parameter"]]:
    """Return two offspring that share out the parents' genes, each gene to either with probability 1/2.

    Source: Syswerda (1989); the paper does not say which crossover it uses.
    """
    is_swapped = rng.random(parent_a.shape[0]) < 0.5
    return np.where(is_swapped, parent_b, parent_a), np.where(is_swapped, parent_a, parent_b)


def mutate(candidate: Float[np.ndarray, " parameter"], rng: np.random.Generator) -> Float[np.ndarray, " parameter"]:
    """Return a candidate of the unit cube with two genes drawn anew in [0, 1); with the only gene if there is one.

    Source: Section 4.3.2 iii ("modifies the values of two parameters").
    Deviation: the paper does not say how; uniform over the range of the parameter is the plainest choice.
    """
    num_parameters = candidate.shape[0]
    genes = rng.choice(num_parameters, size=min(NUM_MUTATED_GENES, num_parameters), replace=False)
    mutated = candidate.copy()
    mutated[genes] = rng.random(genes.shape[0])
    return mutated


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
