import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.search.saga.genetic_operators import adaptive_probability


def test_hand_computed_values_of_equations_21_and_22() -> None:
    # f_avg = 0.5, f_max = 0.9; f = 0.6, 0.7, 0.9 lie 1/4, 1/2 and all of the way from the mean to the best.
    accuracy = np.array([0.1, 0.5, 0.6, 0.7, 0.9])
    crossover = adaptive_probability(accuracy, 0.5, 0.9, 0.6, 0.9)
    mutation = adaptive_probability(accuracy, 0.5, 0.9, 0.05, 0.25)
    np.testing.assert_allclose(crossover, [0.9, 0.9, 0.825, 0.75, 0.6], rtol=1e-12)
    np.testing.assert_allclose(mutation, [0.25, 0.25, 0.2, 0.15, 0.05], rtol=1e-12)


def test_negative_accuracies_follow_the_same_equations() -> None:
    # f_avg = -3, f_max = -1; f = -1.5 lies 3/4 of the way: 0.9 - 0.3 x 0.75.
    crossover = adaptive_probability(np.array([-1.5, -4.0]), -3.0, -1.0, 0.6, 0.9)
    np.testing.assert_allclose(crossover, [0.675, 0.9], rtol=1e-12)


@pytest.mark.parametrize("accuracy", [0.3, 0.3 + 1e-16, -0.3, 0.0])
def test_equal_accuracies_give_the_greatest_probability(accuracy: float) -> None:
    assert adaptive_probability(np.array([accuracy]), accuracy, accuracy, 0.05, 0.25) == 0.25


def test_a_mean_that_rounding_puts_below_the_common_accuracy_does_no_harm() -> None:
    # The mean of three times 0.1 is 0.10000000000000002 or 0.09999999999999999, depending on the order of summation.
    for mean in (np.nextafter(0.1, 0.0), np.nextafter(0.1, 1.0)):
        assert adaptive_probability(np.array([0.1]), float(mean), 0.1, 0.6, 0.9) == 0.9


def test_a_nan_parent_counts_as_not_above_the_mean() -> None:
    assert adaptive_probability(np.array([np.nan]), 0.4, 0.7, 0.6, 0.9) == 0.9
    assert adaptive_probability(np.array([0.5]), np.nan, np.nan, 0.6, 0.9) == 0.9


@given(st.lists(st.floats(-1e3, 1.0), min_size=1, max_size=30))
def test_probabilities_stay_within_their_bounds_and_fall_with_accuracy(accuracy: list[float]) -> None:
    values = np.sort(np.array(accuracy))
    probability = adaptive_probability(values, float(values.mean()), float(values.max()), 0.05, 0.25)
    assert (probability >= 0.05 - 1e-15).all()
    assert (probability <= 0.25).all()
    assert (np.diff(probability) <= 0.0).all()
