from itertools import combinations
from math import comb

import numpy as np
import pytest
from jaxtyping import Int

from jaxcalib.search.orthogonal_arrays import column_choice
from jaxcalib.search.orthogonal_arrays.galois_field import FIELD_ORDERS
from jaxcalib.search.orthogonal_arrays.orthogonal_array import array_sizes, orthogonal_array
from jaxcalib.search.orthogonal_arrays.projective_geometry import projective_geometry
from tests.jaxcalib.search.strength_of_arrays import has_strength_three, has_strength_two, is_balanced

# Taguchi's L9(3^4), as printed in Montgomery, Design and Analysis of Experiments, and in most textbooks.
TAGUCHI_L9 = np.array(
    [
        [0, 0, 0, 0],
        [0, 1, 1, 1],
        [0, 2, 2, 2],
        [1, 0, 1, 2],
        [1, 1, 2, 0],
        [1, 2, 0, 1],
        [2, 0, 2, 1],
        [2, 1, 0, 2],
        [2, 2, 1, 0],
    ]
)
ALL_ARRAYS = [
    (num_levels, num_cases, most_factors)
    for num_levels in FIELD_ORDERS
    for num_cases, most_factors in array_sizes(num_levels)
]


@pytest.mark.parametrize(("num_levels", "num_cases", "most_factors"), ALL_ARRAYS)
def test_every_array_has_strength_two(num_levels: int, num_cases: int, most_factors: int) -> None:
    array = orthogonal_array(most_factors, num_levels)
    assert array.levels.shape == (num_cases, most_factors)
    assert array.name == f"L{num_cases}({num_levels}^{most_factors})"
    assert has_strength_two(array.levels, num_levels)
    assert array.error_degrees_of_freedom == 0  # saturated
    # Every pair of points lies on one line of q + 1 points.
    num_lines = most_factors * (most_factors - 1) // ((num_levels + 1) * num_levels)
    assert array.num_aliased_triples == num_lines * comb(num_levels + 1, 3)


def test_the_named_arrays_can_be_built() -> None:
    names = "L4(2^3) L8(2^7) L9(3^4) L16(4^5) L16(2^15) L25(5^6) L27(3^13) L32(2^31) L49(7^8) L64(4^21) L64(8^9)"
    names += " L81(3^40) L81(9^10) L125(5^31) L256(4^85)"
    assert set(names.split()) <= {f"L{cases}({levels}^{factors})" for levels, cases, factors in ALL_ARRAYS}


def test_l64_has_21_columns_of_which_any_two_show_every_pair_four_times() -> None:
    levels = orthogonal_array(21, 4).levels
    assert levels.shape == (64, 21)
    for j, k in combinations(range(21), 2):
        counts = np.bincount(4 * levels[:, j] + levels[:, k], minlength=16)
        assert (counts == 4).all()
    for j in range(21):
        assert (np.bincount(levels[:, j]) == 16).all()


def num_agreements(levels: Int[np.ndarray, "case factor"]) -> set[int]:
    return {int((levels[a] == levels[b]).sum()) for a, b in combinations(range(len(levels)), 2)}


def test_l9_is_taguchis_up_to_relabelling() -> None:
    # An array of 9 cases of which any two agree in exactly one of 4 factors is unique up to relabelling.
    ours = orthogonal_array(4, 3)
    assert ours.name == "L9(3^4)"
    for levels in (TAGUCHI_L9, ours.levels):
        assert len(np.unique(levels, axis=0)) == 9
        assert num_agreements(levels) == {1}
        assert has_strength_two(levels, 3)


@pytest.mark.parametrize(
    ("num_factors", "num_levels", "least_cases", "fewest"),
    [
        (4, 2, 8, 0),  # complement of a line
        (16, 2, 32, 0),  # complement of a hyperplane
        (10, 3, 81, 0),  # elliptic quadric
        (6, 4, 64, 0),  # hyperoval
        (7, 4, 64, 3),  # this and those below: the smallest number that exchange descent finds from 2000 random starts
        (9, 4, 64, 9),
        (10, 4, 64, 15),
        (12, 4, 64, 28),
        (16, 4, 64, 80),
    ],
)
def test_columns_are_dropped_so_that_few_triples_are_aliased(
    num_factors: int, num_levels: int, least_cases: int, fewest: int
) -> None:
    array = orthogonal_array(num_factors, num_levels, least_cases)
    assert array.num_cases == least_cases
    assert array.num_aliased_triples == fewest


@pytest.mark.parametrize("num_columns", [7, 8, 9, 12, 16])
def test_no_exchange_of_one_column_saves_an_aliased_triple(num_columns: int) -> None:
    geometry = projective_geometry(4, 3)
    columns = column_choice.choose_columns(geometry, num_columns)
    fewest = len(column_choice.collinear_triples(geometry, columns))
    assert fewest > 0
    for leaving in columns:
        for entering in np.setdiff1d(np.arange(geometry.num_points), columns):
            changed = np.append(columns[columns != leaving], entering)
            assert len(column_choice.collinear_triples(geometry, changed)) >= fewest


def test_the_arrays_of_the_paper_have_their_names_and_error_degrees_of_freedom() -> None:
    assert [orthogonal_array(k, 4).name for k in (12, 20)] == ["L64(4^12)", "L64(4^20)"]
    assert [orthogonal_array(k, 4).error_degrees_of_freedom for k in (12, 20)] == [27, 3]
    # Each of the 5 lines through the dropped point loses the pairs of its other 4 points.
    assert orthogonal_array(20, 4).num_aliased_triples == 21 * comb(5, 3) - 5 * comb(4, 2)


def test_aliased_triples_are_exactly_those_without_strength_three() -> None:
    for num_factors, num_levels in ((5, 4), (9, 4), (6, 2), (7, 3), (6, 5)):
        array = orthogonal_array(num_factors, num_levels, least_cases=num_levels**3)
        unbalanced = [
            list(triple)
            for triple in combinations(range(num_factors), 3)
            if not has_strength_three(array.levels[:, triple], num_levels)
        ]
        assert array.aliased_triples.tolist() == unbalanced


def test_more_cases_leave_fewer_triples_aliased_and_more_error_degrees_of_freedom() -> None:
    small, large = orthogonal_array(12, 4), orthogonal_array(12, 4, least_cases=65)
    assert large.name == "L256(4^12)"
    assert large.error_degrees_of_freedom == 256 - 1 - 36
    assert large.num_aliased_triples == 0 < small.num_aliased_triples
    assert has_strength_three(large.levels, 4)


def test_the_checks_notice_an_array_that_is_out_of_balance() -> None:
    levels = orthogonal_array(5, 4).levels.copy()
    assert is_balanced(levels, 4)
    levels[[2, 9], 1] = levels[[9, 2], 1]  # still balanced, but no longer in pairs
    assert is_balanced(levels, 4)
    assert not has_strength_two(levels, 4)
    levels[3, 0] = (levels[3, 0] + 1) % 4
    assert not is_balanced(levels, 4)


def test_an_array_that_does_not_exist_is_refused_with_the_largest_known() -> None:
    with pytest.raises(ValueError, match=r"largest known array is L1024\(4\^341\)"):
        orthogonal_array(342, 4)
    with pytest.raises(ValueError, match=r"at most 1024 cases; got 3 factors and 2000 cases"):
        orthogonal_array(3, 2, least_cases=2000)
    with pytest.raises(ValueError, match=r"among \(2, 3, 4, 5, 7, 8, 9\)"):
        orthogonal_array(3, 6)
    with pytest.raises(ValueError, match="at least 1 factor"):
        orthogonal_array(0, 3)


def test_the_same_array_is_built_every_time() -> None:
    assert (orthogonal_array(17, 4).levels == orthogonal_array(17, 4).levels).all()
