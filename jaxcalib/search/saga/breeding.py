"""From one evaluated generation to the next: pairing, crossover, mutation and elitism of Algorithm 3."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from jaxcalib.search.saga.config import SagaConfig
from jaxcalib.search.saga.genetic_operators import (
    adaptive_probability,
    blend_crossover,
    literal_weights,
    mutate,
    ranked_weights,
    spin_roulette,
    uniform_crossover,
    windowed_weights,
)


@dataclass(frozen=True)
class Brood:
    """The next generation and how it came about.

    Attributes:
        population: as many candidates as before, all in the unit cube; elites first.
        crossover_probability: P_c of each pair.
        mutation_probability: P_m of each offspring.
        last_pair_accuracy: accuracy of the better parent of the last pair, which the printed Algorithm 3 mistakes for
            the best accuracy of the search.
    """

    population: Float[np.ndarray, "candidate parameter"]
    crossover_probability: Float[np.ndarray, " pair"]
    mutation_probability: Float[np.ndarray, " offspring"]
    last_pair_accuracy: float


def pair_positions(num_candidates: int, literal: bool = False) -> Int[np.ndarray, "pair 2"]:
    """Return which places of the mating pool are paired.

    Args:
        num_candidates: size of the population, >= 2 (literal: >= 3).
        literal: pairs (M[i], M[i + 1]) for i = 0 ... len(M) / 2, as printed.

    Source: Algorithm 3, lines 15-16.
    Deviation: pairs (M[2i], M[2i + 1]), so that the whole pool mates once. As printed, the pairs overlap, use half of
        the pool and are one too many. An odd population mates from a pool with one more place.
    """
    if literal:
        first = np.arange(num_candidates // 2 + 1)
        return np.stack([first, first + 1], axis=1)
    return np.arange(num_candidates + num_candidates % 2).reshape(-1, 2)


def breed(
    population: Float[np.ndarray, "candidate parameter"],
    accuracy: Float[np.ndarray, " candidate"],
    is_successful: Bool[np.ndarray, " candidate"],
    config: SagaConfig,
    rng: np.random.Generator,
) -> Brood | None:
    """Return the next generation, or None where the printed Eq. 19 is no probability.

    Args:
        population: in the unit cube.
        accuracy: at most 1, any sign; not looked at where the candidate failed.
        is_successful: whether the candidate was evaluated; at least one must be. Others neither breed nor enter a mean.
        config: options.
        rng: source of the random numbers.

    Source: Algorithm 3, lines 13-30; Eqs. 19, 21-22.
    Deviation: without crossover the offspring are copies of their parents (line 22 repeats the crossover); the best
        accuracy of a pair is kept apart from the best of the search (line 17 overwrites it); elites survive (the paper
        has none, so the population may lose its best). With `literal` all is as printed.
    """
    num_candidates = population.shape[0]
    if config.literal:
        weights = literal_weights(accuracy, is_successful)
        if weights is None:
            return None
    else:
        weights = (ranked_weights if config.selection == "rank" else windowed_weights)(accuracy, is_successful)
    positions = pair_positions(num_candidates, config.literal)
    parents = spin_roulette(weights, rng.random(max(num_candidates, int(positions.max()) + 1)))[positions]

    crossover_probability, mutation_probability = _probabilities(accuracy, is_successful, parents, config)
    offspring: list[Float[np.ndarray, " parameter"]] = []
    for pair, (a, b) in enumerate(parents):
        children = (population[a], population[b])
        if rng.random() < crossover_probability[pair] or config.literal:
            children = (
                blend_crossover(*children, config.blend_alpha, rng)
                if config.crossover == "blx"
                else uniform_crossover(*children, rng)
            )
        for probability, child in zip(mutation_probability[pair], children, strict=True):
            offspring.append(mutate(child, rng) if rng.random() < probability else child)

    elites = population[:0]
    if not config.literal:
        by_accuracy = np.argsort(np.where(is_successful, -accuracy, np.inf), kind="stable")
        elites = population[by_accuracy[: min(config.num_elites, int(is_successful.sum()))]]
    return Brood(
        population=np.vstack([elites, *offspring])[:num_candidates],
        crossover_probability=crossover_probability,
        mutation_probability=mutation_probability.ravel(),
        last_pair_accuracy=float(accuracy[parents[-1]].max()),
    )


def _probabilities(
    accuracy: Float[np.ndarray, " candidate"],
    is_successful: Bool[np.ndarray, " candidate"],
    parents: Int[np.ndarray, "pair 2"],
    config: SagaConfig,
) -> tuple[Float[np.ndarray, " pair"], Float[np.ndarray, "pair 2"]]:
    """Return P_c of each pair and P_m of each of its two offspring."""
    counted = accuracy[is_successful]
    mean_accuracy, best_accuracy = float(counted.mean()), float(counted.max())
    parent_accuracy = accuracy[parents]
    if config.probability_mode == "srinivas":
        for_crossover, for_mutation = parent_accuracy.max(axis=1), parent_accuracy
    else:
        for_crossover = parent_accuracy.mean(axis=1)
        for_mutation = np.repeat(for_crossover[:, None], 2, axis=1)
    return (
        adaptive_probability(
            for_crossover,
            mean_accuracy,
            best_accuracy,
            config.crossover_probability_min,
            config.crossover_probability_max,
        ),
        adaptive_probability(
            for_mutation,
            mean_accuracy,
            best_accuracy,
            config.mutation_probability_min,
            config.mutation_probability_max,
        ),
    )
