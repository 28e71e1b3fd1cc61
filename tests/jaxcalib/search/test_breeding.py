from dataclasses import replace

import numpy as np
import pytest

from jaxcalib.search import SagaConfig
from jaxcalib.search.saga.breeding import breed, pair_positions

POPULATION = np.random.default_rng(12).random((7, 4))
ACCURACY = np.array([0.1, 0.75, -0.4, 0.3, np.nan, 0.5, -2.0])
# No crossover and no mutation: offspring are copies of their parents.
COPYING = SagaConfig(
    population_size=7,
    crossover_probability_min=0.0,
    crossover_probability_max=0.0,
    mutation_probability_min=0.0,
    mutation_probability_max=0.0,
)


def rows(population: np.ndarray) -> set[tuple[float, ...]]:
    return {tuple(candidate) for candidate in population.tolist()}


def test_pairs_use_the_whole_pool_once_and_as_printed_they_overlap() -> None:
    assert pair_positions(6).tolist() == [[0, 1], [2, 3], [4, 5]]
    assert pair_positions(5).tolist() == [[0, 1], [2, 3], [4, 5]]
    assert pair_positions(6, literal=True).tolist() == [[0, 1], [1, 2], [2, 3], [3, 4]]
    assert len(pair_positions(20, literal=True)) == 11


def test_without_crossover_offspring_are_copies_of_their_parents() -> None:
    brood = breed(POPULATION, ACCURACY, np.isfinite(ACCURACY), COPYING, np.random.default_rng(0))
    assert brood is not None
    assert rows(brood.population) <= rows(POPULATION)


def test_as_printed_crossover_happens_in_the_else_branch_too() -> None:
    # 40 candidates of nearly equal weight: a pair of twice the same parent, whose offspring are copies, is rare.
    rng = np.random.default_rng(3)
    population, accuracy = rng.random((40, 4)), rng.uniform(0.5, 0.6, size=40)
    num_copies = []
    for literal in (False, True):
        config = replace(COPYING, population_size=40, num_elites=0, literal=literal)
        brood = breed(population, accuracy, np.ones(40, dtype=bool), config, rng)
        assert brood is not None
        num_copies.append(sum(tuple(candidate) in rows(population) for candidate in brood.population.tolist()))
    assert num_copies[0] == 40
    assert num_copies[1] < 10


def test_failed_candidates_never_breed() -> None:
    is_ok = np.isfinite(ACCURACY)
    is_ok[1] = False  # the best one is flagged
    for seed in range(50):
        brood = breed(POPULATION, ACCURACY, is_ok, COPYING, np.random.default_rng(seed))
        assert brood is not None
        assert rows(brood.population) <= rows(POPULATION[is_ok])


def test_failed_candidates_never_enter_the_mean_of_equations_21_and_22() -> None:
    # Mean of the successful 0.2 and 0.6 is 0.4; a pair of 0.6 and 0.6 lies at the best, of 0.2 and 0.6 at the mean.
    config = SagaConfig(population_size=4)
    accuracy = np.array([0.2, np.nan, 0.6, 0.99])
    is_ok = np.array([True, False, True, False])
    seen = set()
    for seed in range(30):
        brood = breed(POPULATION[:4], accuracy, is_ok, config, np.random.default_rng(seed))
        assert brood is not None
        seen |= {round(p, 12) for p in brood.crossover_probability.tolist()}
    assert seen == {0.6, 0.9}


def test_srinivas_uses_the_better_parent_for_crossover_and_the_own_parent_for_mutation() -> None:
    # f_avg = 0.4, f_max = 0.6. A pair of 0.2 and 0.6: P_c of the better is 0.6; P_m are 0.25 and 0.05.
    config = SagaConfig(population_size=2, probability_mode="srinivas")
    accuracy = np.array([0.2, 0.6])
    seen = set()
    for seed in range(200):
        brood = breed(POPULATION[:2], accuracy, np.ones(2, dtype=bool), config, np.random.default_rng(seed))
        assert brood is not None
        seen.add((round(float(brood.crossover_probability[0]), 12), *np.round(brood.mutation_probability, 12).tolist()))
    assert (0.6, 0.05, 0.05) in seen
    assert seen <= {(0.6, 0.05, 0.05), (0.6, 0.25, 0.05), (0.6, 0.05, 0.25), (0.9, 0.25, 0.25)}
    assert {(0.6, 0.25, 0.05), (0.6, 0.05, 0.25)} & seen


@pytest.mark.parametrize("num_elites", [0, 1, 3])
def test_elites_survive_unchanged_in_order_of_accuracy(num_elites: int) -> None:
    config = SagaConfig(population_size=7, num_elites=num_elites, mutation_probability_min=0.25)
    brood = breed(POPULATION, ACCURACY, np.isfinite(ACCURACY), config, np.random.default_rng(4))
    assert brood is not None
    assert brood.population.shape == POPULATION.shape
    assert (brood.population[:num_elites] == POPULATION[[1, 5, 3][:num_elites]]).all()


def test_as_printed_negative_accuracies_cannot_be_selected_from() -> None:
    config = SagaConfig(population_size=7, literal=True)
    assert breed(POPULATION, ACCURACY, np.isfinite(ACCURACY), config, np.random.default_rng(0)) is None


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match=r"crossover probability; got 0\.9 and 0\.6"):
        SagaConfig(crossover_probability_min=0.9, crossover_probability_max=0.6)
    with pytest.raises(ValueError, match="population of at least 2"):
        SagaConfig(population_size=1)
    with pytest.raises(ValueError, match="0 to 4 elites; got 5"):
        SagaConfig(population_size=5, num_elites=5)
    with pytest.raises(ValueError, match="at least 1 generation; got 20 and 0"):
        SagaConfig(num_generations=0)
    with pytest.raises(ValueError, match="blend_alpha"):
        SagaConfig(blend_alpha=-0.1)
