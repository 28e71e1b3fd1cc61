"""Points and lines of the projective geometry PG(n - 1, q): the columns of Rao-Hamming arrays and their aliasing.

Three columns of such an array are dependent, so that the main effect of each is aliased with the two-factor
interaction of the other two, exactly when their points lie on one line.
"""

import functools
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Int

from jaxcalib.search.orthogonal_arrays.galois_field import galois_field


@dataclass(frozen=True)
class ProjectiveGeometry:
    """PG(num_coordinates - 1, order)."""

    order: int  # field order q
    num_coordinates: int  # coordinates n of a point
    # one point per row, its first non-zero coordinate 1, in the order (1, a, b, ...), (0, 1, a, ...), ...
    points: Int[np.ndarray, "point coordinate"]
    line_through: Int[np.ndarray, "point point"]  # line through two points; -1 on the diagonal
    line_points: Int[np.ndarray, "line incidence"]  # the q + 1 points of each line, ascending

    @property
    def num_points(self) -> int:
        """Number of points, (q^n - 1) / (q - 1)."""
        return self.points.shape[0]


def count_points(order: int, num_coordinates: int) -> int:
    """Return the number of points of PG(num_coordinates - 1, order)."""
    return (order**num_coordinates - 1) // (order - 1)


def projective_points(order: int, num_coordinates: int) -> Int[np.ndarray, "point coordinate"]:
    """Return all points of PG(num_coordinates - 1, order), one normalised vector per row."""
    return np.array(
        [
            (0,) * leading + (1,) + rest
            for leading in range(num_coordinates)
            for rest in product(range(order), repeat=num_coordinates - 1 - leading)
        ]
    )


@functools.cache
def projective_geometry(order: int, num_coordinates: int) -> ProjectiveGeometry:
    """Return the points and the lines of PG(num_coordinates - 1, order).

    Source: Hedayat, Sloane & Stufken (1999), Orthogonal Arrays, ch. 3 (Rao-Hamming construction).
    """
    field = galois_field(order)
    points = projective_points(order, num_coordinates)
    num_points = points.shape[0]
    place_value = order ** np.arange(num_coordinates - 1, -1, -1)
    scaled_points = field.multiplication[
        np.arange(1, order)[:, None, None], points[None]
    ]  # [scalar, point, coordinate]

    point_of_vector = np.full(order**num_coordinates, -1)
    for vectors in scaled_points:
        point_of_vector[vectors @ place_value] = np.arange(num_points)

    # The line through a and b holds a, b and a + c b for every non-zero c.
    members = np.empty((num_points, num_points, order + 1), dtype=np.int64)
    members[..., 0] = np.arange(num_points)[:, None]
    members[..., 1] = np.arange(num_points)[None, :]
    for index, vectors in enumerate(scaled_points):
        sums = np.zeros((num_points, num_points), dtype=np.int64)
        for coordinate, value in enumerate(place_value):
            sums += field.addition[points[:, None, coordinate], vectors[None, :, coordinate]] * value
        members[..., 2 + index] = point_of_vector[sums]
    members.sort(axis=-1)
    names = members[..., 0] * num_points + members[..., 1]
    is_pair = ~np.eye(num_points, dtype=bool)
    _, first, line = np.unique(names[is_pair], return_index=True, return_inverse=True)
    line_through = np.full((num_points, num_points), -1)
    line_through[is_pair] = line
    line_points = members[is_pair][first]
    for table in (points, line_through, line_points):
        table.setflags(write=False)
    return ProjectiveGeometry(order, num_coordinates, points, line_through, line_points)
