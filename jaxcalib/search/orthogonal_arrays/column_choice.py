"""Which columns of a saturated orthogonal array to keep, so that main effects are aliased as little as possible."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Int

from jaxcalib.search.orthogonal_arrays.projective_geometry import ProjectiveGeometry

MOST_EXCHANGES = 200  # per start; the arrays that are used in practice settle after fewer than 20
NUM_SHUFFLED_STARTS = 10
MOST_POINTS_TO_SHUFFLE = 128  # larger geometries take seconds, and no simulation budget fills them


def collinear_triples(geometry: ProjectiveGeometry, columns: Int[np.ndarray, " factor"]) -> Int[np.ndarray, "triple 3"]:
    """Return the triples of factors whose columns lie on one line, as positions in `columns`, in ascending order.

    Args:
        geometry: the geometry that the columns are points of.
        columns: distinct point numbers, one per factor.
    """
    position = np.full(geometry.num_points, -1)
    position[columns] = np.arange(len(columns))
    triples: list[tuple[int, ...]] = []
    for factors in position[geometry.line_points]:
        chosen = np.sort(factors[factors >= 0]).tolist()
        triples.extend(combinations(chosen, 3))
    return np.array(sorted(triples), dtype=np.int64).reshape(-1, 3)


def _line_counts(geometry: ProjectiveGeometry, is_chosen: Bool[np.ndarray, " point"]) -> Int[np.ndarray, " line"]:
    return is_chosen[geometry.line_points].sum(axis=1)


def _num_triples(line_counts: Int[np.ndarray, " line"]) -> int:
    return int((line_counts * (line_counts - 1) * (line_counts - 2) // 6).sum())


def _pairs_met(
    geometry: ProjectiveGeometry, line_counts: Int[np.ndarray, " line"], is_chosen: Bool[np.ndarray, " point"]
) -> Int[np.ndarray, " point"]:
    """Return for each point the number of chosen pairs (without the point itself) that it is collinear with."""
    others = line_counts[:, None] - is_chosen[geometry.line_points]
    return np.bincount(
        geometry.line_points.ravel(), weights=(others * (others - 1) // 2).ravel(), minlength=geometry.num_points
    ).astype(np.int64)


def _exchange(geometry: ProjectiveGeometry, is_chosen: Bool[np.ndarray, " point"]) -> Bool[np.ndarray, " point"]:
    """Swap one chosen point for one that is not, always the swap that saves most, until no swap saves a triple."""
    is_chosen = is_chosen.copy()
    for _ in range(MOST_EXCHANGES):
        line_counts = _line_counts(geometry, is_chosen)
        pairs_met = _pairs_met(geometry, line_counts, is_chosen)
        inside, outside = np.flatnonzero(is_chosen), np.flatnonzero(~is_chosen)
        on_common_line = line_counts[geometry.line_through[np.ix_(inside, outside)]] - 1
        change = pairs_met[None, outside] - pairs_met[inside, None] - on_common_line
        leaving, entering = np.unravel_index(np.argmin(change), change.shape)
        if change[leaving, entering] >= 0:
            break
        is_chosen[inside[leaving]] = False
        is_chosen[outside[entering]] = True
    return is_chosen


def _greedy(geometry: ProjectiveGeometry, num_columns: int) -> Bool[np.ndarray, " point"]:
    """Add one point after another, always the first of those that add fewest triples."""
    is_chosen = np.zeros(geometry.num_points, dtype=bool)
    for _ in range(num_columns):
        pairs_met = _pairs_met(geometry, _line_counts(geometry, is_chosen), is_chosen)
        is_chosen[np.argmin(np.where(is_chosen, np.iinfo(np.int64).max, pairs_met))] = True
    return is_chosen


def _starts(geometry: ProjectiveGeometry, num_columns: int) -> Iterator[Bool[np.ndarray, " point"]]:
    first = np.arange(geometry.num_points) < num_columns
    greedy = _greedy(geometry, num_columns)
    yield greedy
    yield _exchange(geometry, first)
    yield _exchange(geometry, greedy)
    if geometry.num_points <= MOST_POINTS_TO_SHUFFLE:
        rng = np.random.default_rng(num_columns)
        for _ in range(NUM_SHUFFLED_STARTS):
            yield _exchange(geometry, rng.permutation(first))


def choose_columns(geometry: ProjectiveGeometry, num_columns: int) -> Int[np.ndarray, " factor"]:
    """Return `num_columns` points with few collinear triples, in ascending order.

    Tried are the first points in the order of the geometry, points added greedily, and an exchange descent from both
    and from some shuffled sets; the first of those with fewest collinear triples wins. The result depends on nothing
    but the arguments. It need not be the smallest number that exists.

    Args:
        geometry: the geometry that the columns are points of.
        num_columns: 1 ... num_points.
    """
    best = np.arange(geometry.num_points) < num_columns
    fewest = _num_triples(_line_counts(geometry, best))
    if fewest > 0 and num_columns < geometry.num_points:
        for candidate in _starts(geometry, num_columns):
            num_triples = _num_triples(_line_counts(geometry, candidate))
            if num_triples < fewest:
                best, fewest = candidate, num_triples
            if fewest == 0:
                break
    return np.flatnonzero(best)
