"""The memetic algorithm on functions whose optimum is known, and its laws."""

import numpy as np
import pytest

from experiments.paper import memetic
from experiments.paper.memetic import MemeticConfig

OPTIMUM = np.asarray([0.31, 0.77, 0.12, 0.58])


def sphere(points):
    return 1.0 - np.sum((points - OPTIMUM) ** 2, axis=1)


def rastrigin(points):
    far = 4.0 * (points - OPTIMUM)
    return -np.sum(far**2 + 10.0 * (1.0 - np.cos(2.0 * np.pi * far)), axis=1)


def search(function, most, seed=3, config=None):
    state = memetic.init(len(OPTIMUM), seed, config=config)
    while state.num_asked < most:
        state = memetic.tell(state, function(memetic.ask(state)))
    return state


def test_it_finds_the_optimum_of_a_bowl():
    for seed in range(3):
        assert np.abs(search(sphere, 3000, seed).best_candidate - OPTIMUM).max() < 0.03


def test_on_many_hills_every_search_beats_random_search_at_the_same_cost():
    """Rastrigin: hills 0.25 apart, each about 1 lower than the next one nearer to the optimum, which is 0."""
    for seed in range(3):
        points = np.random.default_rng(seed).random((3000, len(OPTIMUM)))
        assert search(rastrigin, 3000, seed).best_accuracy > rastrigin(points).max() + 1.0


def test_the_same_tells_give_the_same_asks():
    one, other = search(rastrigin, 500), search(rastrigin, 500)
    np.testing.assert_array_equal(memetic.ask(one), memetic.ask(other))


def test_rounds_take_turns_and_candidates_stay_in_the_cube():
    config = MemeticConfig(population_size=6, num_chains=2, num_steps=3)
    state = memetic.init(3, 0, config=config)
    sizes = []
    for _ in range(9):
        asked = memetic.ask(state)
        assert ((asked >= 0.0) & (asked <= 1.0)).all()
        sizes.append(len(asked))
        state = memetic.tell(state, -asked.sum(axis=1))
    assert sizes == [6, 2, 2, 2, 6, 2, 2, 2, 6]
    assert state.num_asked == sum(sizes)
    assert state.temperature == pytest.approx(config.temperature * config.cooling**6)


def test_a_failed_candidate_never_wins_nor_breeds():
    def partly(points):
        return np.where(points[:, 0] > 0.5, np.nan, points[:, 0])

    state = search(partly, 2000)
    assert 0.45 < state.best_candidate[0] <= 0.5
    assert (state.population[np.isfinite(state.accuracy), 0] <= 0.5).all()


def test_everything_failed_draws_anew():
    state = memetic.init(4, 1)
    first = memetic.ask(state)
    for _ in range(8):
        state = memetic.tell(state, np.full(len(memetic.ask(state)), np.nan))
    assert state.best_candidate is None
    assert not np.array_equal(memetic.ask(state)[: len(first)], first[: len(memetic.ask(state))])


def test_annealing_takes_a_worse_neighbour_when_hot_and_hardly_when_cold():
    def share_taken(temperature):
        config = MemeticConfig(population_size=40, num_chains=40, num_steps=1, temperature=temperature)
        state = memetic.init(4, 5, config=config)
        state = memetic.tell(state, np.linspace(0.0, 1.0, 40))  # spread of accuracies: 1
        before = state.accuracy.copy()
        state = memetic.tell(state, before - 0.5)
        return np.mean(state.accuracy < before)

    assert share_taken(100.0) > 0.9
    assert share_taken(0.01) == 0.0
    assert 0.2 < share_taken(0.5) < 0.6  # exp(-1) = 0.37


def test_wrong_options_are_refused():
    with pytest.raises(ValueError, match="population"):
        MemeticConfig(population_size=1)
    with pytest.raises(ValueError, match="cooling"):
        MemeticConfig(cooling=0.0)
    with pytest.raises(ValueError, match="4 parameters"):
        memetic.init(4, 0, np.zeros((1, 3)))
    with pytest.raises(ValueError, match="accuracy of 20"):
        memetic.tell(memetic.init(4, 0), np.zeros(3))
