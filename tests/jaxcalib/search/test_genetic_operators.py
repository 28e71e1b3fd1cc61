import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from jaxcalib.search.saga import genetic_operators as operators

UNIT_VECTORS = arrays(np.float64, 5, elements=st.floats(0.0, 1.0))


def test_roulette_frequencies_match_the_weights() -> None:
    # N = 50000 draws, seed 3; each frequency is binomial, bound z = 4.5 (five cells).
    weights = np.array([0.7, 0.0, 2.1, 0.05, 1.3, 0.0])
    num_draws = 50000
    drawn = operators.spin_roulette(weights, np.random.default_rng(3).random(num_draws))
    share = weights / weights.sum()
    z = (np.bincount(drawn, minlength=6) / num_draws - share) / np.sqrt(
        np.maximum(share * (1 - share), 1e-30) / num_draws
    )
    assert (np.abs(z) < 4.5).all()


def test_zero_weight_is_never_drawn_even_at_the_edges_of_the_wheel() -> None:
    weights = np.array([0.0, 0.0, 0.3, 0.0, 0.7, 0.0])
    below, above = np.nextafter(0.3, 0.0), np.nextafter(0.3, 1.0)
    uniforms = np.array([0.0, 1e-320, below, 0.3, above, np.nextafter(1.0, 0.0), 1.0])
    drawn = operators.spin_roulette(weights, uniforms)
    assert set(drawn.tolist()) == {2, 4}
    assert drawn[0] == 2
    assert drawn[-1] == 4


def test_roulette_is_right_when_the_cumulative_sum_ends_below_one() -> None:
    # 40 single-precision weights, normalised, whose single-precision cumulative sum ends below 1.
    rng = np.random.default_rng(0)
    for _ in range(1000):
        raw = np.exp(rng.normal(size=40).astype(np.float32))
        weights = raw / raw.sum()
        if np.cumsum(weights)[-1] < 1.0:
            break
    else:
        pytest.fail("no such weights were found")
    weights[-1] = 0.0  # the last candidate has failed; the wheel must not fall through to it
    assert weights.sum() < 1.0
    drawn = operators.spin_roulette(weights, np.array([np.nextafter(1.0, 0.0), 1.0, 0.999999]))
    assert (drawn == 38).all()


@given(arrays(np.float64, 7, elements=st.floats(0.0, 1e6)), st.floats(0.0, 1.0))
def test_only_candidates_with_weight_are_drawn(weights: np.ndarray, uniform: float) -> None:
    if weights.sum() > 0.0:
        assert weights[operators.spin_roulette(weights, np.array([uniform]))[0]] > 0.0


@pytest.mark.parametrize("weights", [[0.0, 0.0], [1.0, -0.1], [1.0, np.nan], [np.inf, 1.0]])
def test_weights_that_are_none_are_refused(weights: list[float]) -> None:
    with pytest.raises(ValueError, match="Expected finite weights"):
        operators.spin_roulette(np.array(weights), np.array([0.5]))


def test_windowed_weights_of_negative_accuracies_by_hand() -> None:
    accuracy = np.array([-3.0, np.nan, -1.0, -2.5])
    weights = operators.windowed_weights(accuracy, np.isfinite(accuracy))
    np.testing.assert_allclose(weights, [0.02, 0.0, 2.02, 0.52], rtol=1e-12)


def test_equal_accuracies_have_equal_weights() -> None:
    accuracy = np.array([-0.2, -0.2, np.nan, -0.2])
    for weigh in (operators.windowed_weights, operators.ranked_weights):
        weights = weigh(accuracy, np.isfinite(accuracy))
        assert weights[2] == 0.0
        assert weights[0] == weights[1] == weights[3] > 0.0


def test_one_candidate_that_succeeded_takes_the_whole_wheel() -> None:
    accuracy = np.array([np.nan, -7.0, np.nan])
    for weigh in (operators.windowed_weights, operators.ranked_weights):
        drawn = operators.spin_roulette(weigh(accuracy, np.isfinite(accuracy)), np.linspace(0.0, 1.0, 11))
        assert (drawn == 1).all()


def test_ranked_weights_share_the_rank_of_equal_accuracies() -> None:
    weights = operators.ranked_weights(np.array([0.3, -50.0, 0.3, 0.9, 0.1]), np.array([True, True, True, True, False]))
    assert weights.tolist() == [2.5, 1.0, 2.5, 4.0, 0.0]


def test_literal_weights_are_the_accuracies_or_undefined() -> None:
    accuracy = np.array([0.2, 0.6, np.nan])
    weights = operators.literal_weights(accuracy, np.isfinite(accuracy))
    assert weights is not None
    assert weights.tolist() == [0.2, 0.6, 0.0]
    assert operators.literal_weights(np.array([0.2, -0.1]), np.ones(2, dtype=bool)) is None
    assert operators.literal_weights(np.zeros(2), np.ones(2, dtype=bool)) is None


@given(arrays(np.float64, 6, elements=st.floats(-5.0, 5.0)))
def test_reflection_ends_in_the_unit_cube_and_keeps_what_is_in_it(points: np.ndarray) -> None:
    reflected = operators.reflect_into_unit_cube(points)
    assert ((reflected >= 0.0) & (reflected <= 1.0)).all()
    is_inside = (points >= 0.0) & (points <= 1.0)
    assert (reflected[is_inside] == points[is_inside]).all()


def test_reflection_by_hand() -> None:
    np.testing.assert_allclose(
        operators.reflect_into_unit_cube(np.array([-0.2, 1.3, 2.1, -1.4])), [0.2, 0.7, 0.1, 0.6], rtol=1e-12
    )


@given(UNIT_VECTORS, UNIT_VECTORS, st.integers(0, 1000), st.floats(0.0, 2.0))
def test_blended_offspring_stay_in_the_unit_cube(a: np.ndarray, b: np.ndarray, seed: int, alpha: float) -> None:
    for child in operators.blend_crossover(a, b, alpha, np.random.default_rng(seed)):
        assert ((child >= 0.0) & (child <= 1.0)).all()
        is_equal = a == b
        np.testing.assert_allclose(child[is_equal], a[is_equal], atol=1e-15)


def test_blended_offspring_reach_half_the_distance_beyond_the_parents() -> None:
    a, b = np.array([0.4]), np.array([0.5])
    rng = np.random.default_rng(1)
    children = np.concatenate([np.concatenate(operators.blend_crossover(a, b, 0.5, rng)) for _ in range(2000)])
    assert children.min() >= 0.35
    assert children.max() <= 0.55
    # 4000 uniform draws over 0.2: mean 0.45, standard error 0.2 / sqrt(12 x 4000) = 0.0009, bound z = 4.
    assert abs(children.mean() - 0.45) < 4 * 0.0009
    assert children.min() < 0.351
    assert children.max() > 0.549


@given(UNIT_VECTORS, UNIT_VECTORS, st.integers(0, 1000))
def test_uniform_crossover_shares_out_the_genes_of_both_parents(a: np.ndarray, b: np.ndarray, seed: int) -> None:
    first, second = operators.uniform_crossover(a, b, np.random.default_rng(seed))
    is_kept = (first == a) & (second == b)
    assert (is_kept | ((first == b) & (second == a))).all()


def test_mutation_draws_exactly_two_genes_anew() -> None:
    rng = np.random.default_rng(2)
    candidate = np.linspace(0.1, 0.7, 6)
    num_changed = np.zeros(6)
    for _ in range(300):
        mutated = operators.mutate(candidate, rng)
        assert (mutated != candidate).sum() == 2
        assert ((mutated >= 0.0) & (mutated < 1.0)).all()
        num_changed += mutated != candidate
    # Each gene is binomial(300, 1/3), standard deviation 8.2, bound z = 4.
    assert (np.abs(num_changed - 100) < 4 * 8.2).all()
    assert operators.mutate(np.array([0.3]), rng).shape == (1,)
