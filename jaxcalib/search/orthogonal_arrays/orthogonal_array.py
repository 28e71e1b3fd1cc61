"""Orthogonal arrays of strength 2 by the Rao-Hamming construction: L4(2^3), L9(3^4), L64(4^21), ...

The cases are all vectors u of GF(q)^n, the factors are points p of PG(n - 1, q), and the level is the product <u, p>.
Any two columns show every pair of levels equally often. Three columns on a line do not show every triple, so a main
effect there is aliased with the two-factor interaction of the other two: the array says which triples those are.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Int

from jaxcalib.search.orthogonal_arrays.column_choice import choose_columns, collinear_triples
from jaxcalib.search.orthogonal_arrays.galois_field import FIELD_ORDERS, galois_field
from jaxcalib.search.orthogonal_arrays.projective_geometry import count_points, projective_geometry

MOST_CASES = 1024


@dataclass(frozen=True)
class OrthogonalArray:
    """A test design in which every pair of factors shows every pair of levels equally often."""

    name: str  # Taguchi's notation, for example "L64(4^12)"
    num_levels: int  # levels of every factor
    levels: Int[np.ndarray, "case factor"]  # level of each factor in each case, 0 ... num_levels - 1.
    error_degrees_of_freedom: int  # cases - 1 - factors x (levels - 1), what is left to estimate the error from
    # factors (i, j, k), i < j < k, in which the main effect of each is aliased with the two-factor interaction of
    # the other two
    aliased_triples: Int[np.ndarray, "triple 3"]

    @property
    def num_cases(self) -> int:
        """Number of cases."""
        return self.levels.shape[0]

    @property
    def num_factors(self) -> int:
        """Number of factors."""
        return self.levels.shape[1]

    @property
    def num_aliased_triples(self) -> int:
        """Number of triples of factors in which main effects and two-factor interactions are aliased."""
        return self.aliased_triples.shape[0]


def array_sizes(num_levels: int) -> tuple[tuple[int, int], ...]:
    """Return (cases, most factors) of every array that can be built, the smallest first.

    Args:
        num_levels: one of 2, 3, 4, 5, 7, 8, 9.

    Raises:
        ValueError: no array with this number of levels can be built.
    """
    if num_levels not in FIELD_ORDERS:
        raise ValueError(
            f"Expected a number of levels among {FIELD_ORDERS} (there must be a finite field of that order); "
            f"got {num_levels}."
        )
    sizes = []
    num_coordinates = 2
    while num_levels**num_coordinates <= MOST_CASES:
        sizes.append((num_levels**num_coordinates, count_points(num_levels, num_coordinates)))
        num_coordinates += 1
    return tuple(sizes)


def orthogonal_array(num_factors: int, num_levels: int, least_cases: int = 0) -> OrthogonalArray:
    """Return the smallest array of strength 2 that has room for the factors and at least the cases asked for.

    Args:
        num_factors: >= 1.
        num_levels: levels of every factor, one of 2, 3, 4, 5, 7, 8, 9.
        least_cases: ask for more cases than the factors need: more error degrees of freedom and less aliasing.

    Raises:
        ValueError: no such array can be built; the message names the largest.

    Source: Hu et al., Section 4.3.1 ii (arrays "refer to the handbook of statistical methods", Guthrie 2020);
        construction: Rao (1947) and Hamming (1950), in Hedayat, Sloane & Stufken (1999), ch. 3.
    Deviation: the handbook does not tabulate the arrays that 12 and 20 factors at 4 levels need, so they are built;
        columns are dropped so that few triples of factors are aliased, while the paper does not say which it drops.
    """
    sizes = array_sizes(num_levels)
    if num_factors < 1:
        raise ValueError(f"Expected at least 1 factor; got {num_factors}.")
    for index, (num_cases, most_factors) in enumerate(sizes):
        if most_factors >= num_factors and num_cases >= least_cases:
            return _build(num_factors, num_levels, num_coordinates=index + 2)
    num_cases, most_factors = sizes[-1]
    raise ValueError(
        f"Expected at most {most_factors} factors at {num_levels} levels and at most {num_cases} cases; got "
        f"{num_factors} factors and {least_cases} cases. The largest known array is "
        f"L{num_cases}({num_levels}^{most_factors})."
    )


def _build(num_factors: int, num_levels: int, num_coordinates: int) -> OrthogonalArray:
    field = galois_field(num_levels)
    geometry = projective_geometry(num_levels, num_coordinates)
    columns = choose_columns(geometry, num_factors)
    cases = np.array(list(product(range(num_levels), repeat=num_coordinates)))
    levels = np.zeros((len(cases), num_factors), dtype=np.int64)
    for coordinate in range(num_coordinates):
        terms = field.multiplication[cases[:, None, coordinate], geometry.points[None, columns, coordinate]]
        levels = field.addition[levels, terms]
    levels.setflags(write=False)
    return OrthogonalArray(
        name=f"L{len(cases)}({num_levels}^{num_factors})",
        num_levels=num_levels,
        levels=levels,
        error_degrees_of_freedom=len(cases) - 1 - num_factors * (num_levels - 1),
        aliased_triples=collinear_triples(geometry, columns),
    )
