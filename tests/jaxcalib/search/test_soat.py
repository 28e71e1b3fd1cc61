import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxcalib.search import SearchStatus, SoatConfig, level_values, orthogonal_array, points_from_levels, soat

LOWER, UPPER = np.array([640.0, 800.0, 960.0]), np.array([960.0, 1200.0, 1440.0])
INITIAL = np.array([800.0, 1000.0, 1200.0])


def test_the_example_of_figure_3_is_reproduced_with_1440_in_case_3() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, INITIAL)
    cases = soat.ask(state)
    assert cases.shape == (5, 3)
    figure_3 = {(640.0, 800.0, 960.0), (640.0, 1200.0, 1440.0), (960.0, 800.0, 1440.0), (960.0, 1200.0, 960.0)}
    assert {tuple(case) for case in cases[:4].tolist()} == figure_3
    assert (cases[4] == INITIAL).all()


def test_levels_are_equidistant_and_hold_both_bounds() -> None:
    values = level_values(np.array([-0.3, 2.0]), np.array([0.7, 2.3]), 4)
    np.testing.assert_allclose(values[0], [-0.3, -0.3 + 1 / 3, -0.3 + 2 / 3, 0.7], rtol=1e-12)
    assert (values[:, [0, -1]] == [[-0.3, 0.7], [2.0, 2.3]]).all()
    assert points_from_levels(values, np.array([[3, 0], [0, 3]])).tolist() == [[0.7, 2.0], [-0.3, 2.3]]


def test_an_initial_point_never_is_a_level_of_four() -> None:
    state = soat.init(orthogonal_array(5, 4), 0.8 * np.arange(1.0, 6.0), 1.2 * np.arange(1.0, 6.0), np.arange(1.0, 6.0))
    assert not np.isclose(state.level_values, np.arange(1.0, 6.0)[:, None], rtol=0.05).any()
    assert (soat.ask(state)[-1] == np.arange(1.0, 6.0)).all()


def test_all_cases_are_evaluated_although_the_threshold_is_reached_early() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, INITIAL)
    state, info = soat.tell(state, np.array([0.85, 0.3]))
    assert info.is_threshold_reached
    assert info.status is SearchStatus.RUNNING
    assert soat.ask(state).shape == (3, 3)
    state, info = soat.tell(state, np.array([0.2, 0.9, 0.1]))
    assert (info.best_case, info.best_accuracy, info.status) == (3, 0.9, SearchStatus.COMPLETE)
    assert soat.ask(state).shape == (0, 3)
    assert state.array_accuracy.tolist() == [0.85, 0.3, 0.2, 0.9]


def test_the_best_may_be_negative_and_may_be_the_initial_point() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, INITIAL)
    _, info = soat.tell(state, np.array([-0.5, -0.4, -2.0, -0.3, -0.2]))
    assert info.best_accuracy == -0.2
    assert info.best_candidate is not None
    assert (info.best_candidate == INITIAL).all()
    assert info.is_initial_point_best
    assert not info.is_threshold_reached


def test_literal_stops_at_the_first_case_that_reaches_the_threshold_and_ignores_the_rest_of_the_chunk() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, INITIAL, SoatConfig(literal=True))
    assert soat.ask(state).shape == (4, 3)  # no extra case
    state, info = soat.tell(state, np.array([0.3, 0.8, 0.95]))
    assert info.status is SearchStatus.THRESHOLD_REACHED
    assert (info.best_case, info.best_accuracy, info.num_told) == (1, 0.8, 2)
    assert soat.ask(state).shape == (0, 3)
    assert np.isnan(state.accuracy[2:]).all()


def test_literal_returns_nothing_if_no_accuracy_is_positive() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, config=SoatConfig(literal=True))
    _, info = soat.tell(state, np.array([-0.1, 0.0, -0.3, -0.2]))
    assert info.best_candidate is None
    assert info.best_accuracy == 0.0


def test_failed_cases_never_win() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER, INITIAL)
    accuracy = np.array([np.nan, 0.99, 0.4, np.inf, -np.inf])
    state, info = soat.tell(state, accuracy, np.array([True, False, True, True, True]))
    assert (info.best_case, info.num_failed) == (2, 4)
    assert np.isnan(state.array_accuracy).tolist() == [True, True, False, True]


def test_a_search_in_which_everything_failed_says_so() -> None:
    state = soat.init(orthogonal_array(3, 2), LOWER, UPPER)
    _, info = soat.tell(state, np.full(4, np.nan))
    assert info.status is SearchStatus.NOTHING_SUCCEEDED
    assert info.best_candidate is None
    assert "simulator" in info.status.advice


@given(st.lists(st.integers(1, 7), min_size=1), st.integers(0, 2**32 - 1))
def test_chunks_of_any_size_give_what_one_tell_gives(chunks: list[int], seed: int) -> None:
    accuracy = 1.0 - np.random.default_rng(seed).exponential(size=28)
    accuracy[::5] = np.nan
    lower, upper = np.linspace(-1.0, 2.0, 13), np.linspace(1.5, 2.5, 13)
    whole = chunked = soat.init(orthogonal_array(13, 3), lower, upper, 0.3 * lower + 0.7 * upper)
    whole, expected = soat.tell(whole, accuracy)
    info, index = None, 0
    while not chunked.status.is_final:
        num_told = chunked.num_told
        size = min(chunks[index % len(chunks)], 28 - num_told)
        chunked, info = soat.tell(chunked, accuracy[num_told : num_told + size])
        index += 1
    assert info is not None
    assert info.best_case == expected.best_case
    np.testing.assert_array_equal(chunked.accuracy, whole.accuracy)


def test_mistakes_of_the_caller_are_refused() -> None:
    array = orthogonal_array(3, 2)
    with pytest.raises(ValueError, match=r"lower < upper; got 1200.0 and 800.0 for parameter 1"):
        soat.init(array, np.array([1.0, 1200.0, 3.0]), np.array([2.0, 800.0, 4.0]))
    with pytest.raises(ValueError, match="bounds of 3 parameters"):
        soat.init(array, LOWER[:2], UPPER[:2])
    with pytest.raises(ValueError, match="within the bounds"):
        soat.init(array, LOWER, UPPER, 2.0 * UPPER)
    with pytest.raises(ValueError, match="at most 4 cases"):
        soat.tell(soat.init(array, LOWER, UPPER), np.zeros(5))
    with pytest.raises((ValueError, TypeError), match="is_ok"):  # TypeError where annotations are checked
        soat.tell(soat.init(array, LOWER, UPPER), np.zeros(4), np.ones(3, dtype=bool))
