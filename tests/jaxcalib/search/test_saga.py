from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float

from jaxcalib.search import SagaConfig, SagaState, SearchStatus, saga

ENDLESS = SagaConfig(stop_at_threshold=False)
OPTIMUM = np.array([0.62, 0.31, 0.77, 0.15, 0.54, 0.08, 0.91, 0.36, 0.69, 0.23])


def sphere(points: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, " candidate"]:
    """Accuracy 0.7 - distance^2 to an optimum off the centre; negative far away."""
    return 0.7 - ((points - OPTIMUM[: points.shape[1]]) ** 2).sum(axis=1)


def rastrigin(points: Float[np.ndarray, "candidate parameter"]) -> Float[np.ndarray, " candidate"]:
    """Accuracy with about ten local optima along each parameter."""
    x = 10.24 * (points - OPTIMUM[: points.shape[1]])
    return -(x**2 - 10.0 * np.cos(2.0 * np.pi * x) + 10.0).sum(axis=1)


def run(state: SagaState, accuracy_of: Callable[[np.ndarray], np.ndarray]) -> tuple[SagaState, list[float], int]:
    best, num_evaluated = [], 0
    while not state.status.is_final:
        candidates = saga.ask(state)
        num_evaluated += candidates.shape[0]
        state, info = saga.tell(state, accuracy_of(candidates))
        best.append(info.best_accuracy)
    return state, best, num_evaluated


def test_exactly_the_given_number_of_generations_is_evaluated() -> None:
    state, best, num_evaluated = run(saga.init(10, seed=1, config=ENDLESS), sphere)
    assert (len(best), num_evaluated, state.status) == (15, 300, SearchStatus.COMPLETE)
    assert saga.ask(state).shape == (0, 10)


def test_literal_evaluates_one_generation_more() -> None:
    config = replace(ENDLESS, literal=True)
    state, best, num_evaluated = run(saga.init(10, seed=1, config=config), lambda points: 3.0 + sphere(points))
    assert (len(best), num_evaluated, state.status) == (16, 320, SearchStatus.COMPLETE)


@given(seed=st.integers(0, 10**6), size=st.integers(2, 9), num_parameters=st.integers(1, 4), data=st.data())
@settings(max_examples=60, deadline=None)
def test_asks_stay_in_the_unit_cube_and_the_population_keeps_its_size(
    seed: int, size: int, num_parameters: int, data: st.DataObject
) -> None:
    config = SagaConfig(
        population_size=size,
        num_generations=4,
        num_elites=data.draw(st.integers(0, size - 1)),
        stop_at_threshold=False,
        selection=data.draw(st.sampled_from(["roulette", "rank"])),
        crossover=data.draw(st.sampled_from(["blx", "uniform"])),
        probability_mode=data.draw(st.sampled_from(["pair_mean", "srinivas"])),
    )
    state = saga.init(num_parameters, seed, config=config)
    accuracies = st.lists(st.floats(-1e9, 1.0) | st.sampled_from([np.nan, -np.inf]), min_size=size, max_size=size)
    for _ in range(4):
        candidates = saga.ask(state)
        assert candidates.shape == (size, num_parameters)
        assert ((candidates >= 0.0) & (candidates <= 1.0)).all()
        state, _ = saga.tell(state, np.array(data.draw(accuracies)))
    assert state.status.is_final


def test_the_same_seed_and_the_same_tells_give_the_same_asks_bit_for_bit() -> None:
    told = 1.0 - np.random.default_rng(5).exponential(size=(15, 20))
    told[3, 4:9] = np.nan
    told[6] = np.nan
    asks = []
    for _ in range(2):
        state = saga.init(6, seed=42, initial_candidates=np.full((1, 6), 0.3), config=ENDLESS)
        for accuracy in told:
            asks.append(saga.ask(state))
            state, _ = saga.tell(state, accuracy)
    assert (np.array(asks[:15]) == np.array(asks[15:])).all()


def test_a_state_can_be_told_twice_and_another_seed_asks_something_else() -> None:
    state = saga.init(6, seed=42)
    first, _ = saga.tell(state, sphere(saga.ask(state)))
    second, _ = saga.tell(state, sphere(saga.ask(state)))
    assert (saga.ask(first) == saga.ask(second)).all()
    assert (saga.ask(saga.init(6, seed=43)) != saga.ask(state)).any()


def test_the_first_population_holds_the_given_candidates_and_a_latin_hypercube() -> None:
    given_candidates = np.array([[0.1, 0.2, 1.0], [0.0, 0.7, 0.4]])
    population = saga.ask(saga.init(3, seed=2, initial_candidates=given_candidates))
    assert (population[:2] == given_candidates).all()
    strata = np.sort(np.floor(18 * population[2:]), axis=0)
    assert (strata == np.arange(18)[:, None]).all()


def test_elitism_the_best_never_gets_worse_and_stays_in_the_population() -> None:
    state = saga.init(10, seed=3, config=replace(ENDLESS, num_generations=30))
    previous = -np.inf
    while not state.status.is_final:
        accuracy = rastrigin(saga.ask(state))
        assert accuracy.max() >= previous
        previous = accuracy.max()
        state, info = saga.tell(state, accuracy)
        assert info.best_accuracy == previous
        assert state.best_candidate is not None
        assert rastrigin(state.best_candidate[None])[0] == info.best_accuracy


def test_failed_candidates_never_win() -> None:
    state = saga.init(4, seed=8, config=ENDLESS)
    for generation in range(15):
        accuracy = sphere(saga.ask(state))
        is_ok = np.ones(20, dtype=bool)
        accuracy[:3] = [np.nan, np.inf, -np.inf]
        accuracy[3], is_ok[3] = 0.999, False
        state, info = saga.tell(state, accuracy, is_ok)
        assert info.num_failed == 4
        assert info.best_accuracy <= 0.7
        assert info.generation == generation
        np.testing.assert_allclose(info.generation_mean_accuracy, accuracy[4:].mean(), rtol=1e-12)


def test_if_all_candidates_fail_the_next_generation_is_drawn_anew_and_the_status_says_so() -> None:
    state = saga.init(4, seed=9, config=ENDLESS)
    before = saga.ask(state)
    state, info = saga.tell(state, np.full(20, np.nan))
    assert info.status is SearchStatus.RESAMPLED
    assert not info.status.is_final
    assert (saga.ask(state) != before).all()
    assert (np.sort(np.floor(20 * saga.ask(state)), axis=0) == np.arange(20)[:, None]).all()
    state, info = saga.tell(state, sphere(saga.ask(state)))
    assert info.status is SearchStatus.RUNNING
    best = info.best_candidate
    state, _ = saga.tell(state, np.full(20, -np.inf))
    assert best is not None
    assert (saga.ask(state)[0] == best).all()


def test_a_search_in_which_everything_failed_says_so() -> None:
    state, _, _ = run(saga.init(2, seed=9), lambda points: np.full(len(points), np.nan))
    assert state.status is SearchStatus.NOTHING_SUCCEEDED
    assert state.best_candidate is None
    assert state.best_accuracy == -np.inf


def test_the_threshold_ends_the_search_at_equality_unless_told_otherwise() -> None:
    accuracy = np.linspace(-1.0, 0.8, 20)
    state, info = saga.tell(saga.init(2, seed=0), accuracy)
    assert info.status is SearchStatus.THRESHOLD_REACHED
    assert saga.ask(state).shape == (0, 2)
    state, info = saga.tell(saga.init(2, seed=0, config=ENDLESS), accuracy)
    assert info.is_threshold_reached
    assert info.status is SearchStatus.RUNNING
    _, info = saga.tell(saga.init(2, seed=0, config=SagaConfig(literal=True)), np.abs(accuracy) * 0.8)
    assert info.status is SearchStatus.RUNNING  # as printed, the threshold must be exceeded


def test_literal_overwrites_the_best_accuracy_with_that_of_the_last_pair() -> None:
    config = SagaConfig(literal=True, population_size=6, num_generations=8)
    state = saga.init(3, seed=1, config=config)
    reported, reached = [], []
    while not state.status.is_final:
        accuracy = 0.1 + 0.5 * saga.ask(state)[:, 0]
        reached.append(accuracy.max())
        state, info = saga.tell(state, accuracy)
        reported.append(info.best_accuracy)
    assert any(r < best for r, best in zip(reported, np.maximum.accumulate(reached), strict=True))


def test_the_sound_reading_never_touches_the_best_so_far() -> None:
    state = saga.init(3, seed=1, config=replace(ENDLESS, population_size=6))
    reported, reached = [], []
    while not state.status.is_final:
        accuracy = 0.1 + 0.5 * saga.ask(state)[:, 0]
        reached.append(accuracy.max())
        state, info = saga.tell(state, accuracy)
        reported.append(info.best_accuracy)
    assert reported == np.maximum.accumulate(reached).tolist()


def test_literal_ends_where_equation_19_is_no_probability() -> None:
    state = saga.init(3, seed=1, config=SagaConfig(literal=True))
    state, info = saga.tell(state, np.linspace(-0.5, 0.5, 20))
    assert info.status is SearchStatus.SELECTION_UNDEFINED
    assert info.best_accuracy == 0.5
    assert "literal=False" in info.status.advice


@pytest.mark.parametrize("accuracy_of", [sphere, rastrigin])
@pytest.mark.parametrize("crossover", ["blx", "uniform"])
def test_it_beats_random_search_with_the_same_number_of_evaluations(
    accuracy_of: Callable[[np.ndarray], np.ndarray], crossover: str
) -> None:
    # 20 seeds, 300 evaluations each, 10 parameters; paired differences, one-sided bound z = 4.
    differences = []
    for seed in range(20):
        config = SagaConfig(stop_at_threshold=False, crossover="blx" if crossover == "blx" else "uniform")
        state, _, _ = run(saga.init(10, seed=seed, config=config), accuracy_of)
        random_points = np.random.default_rng(1000 + seed).random((300, 10))
        differences.append(state.best_accuracy - accuracy_of(random_points).max())
    standard_error = np.std(differences, ddof=1) / np.sqrt(20)
    assert np.mean(differences) > 4.0 * standard_error


def test_mistakes_of_the_caller_are_refused() -> None:
    with pytest.raises(ValueError, match="unit cube"):
        saga.init(2, seed=0, initial_candidates=np.array([[0.5, 1.2]]))
    with pytest.raises(ValueError, match=r"at most 20 initial candidates of 2 parameters; got shape \(21, 2\)"):
        saga.init(2, seed=0, initial_candidates=np.zeros((21, 2)))
    with pytest.raises(ValueError, match="accuracy of 20 candidates"):
        saga.tell(saga.init(2, seed=0), np.zeros(19))
    with pytest.raises(ValueError, match="num_parameters >= 1 and seed >= 0"):
        saga.init(0, seed=0)
