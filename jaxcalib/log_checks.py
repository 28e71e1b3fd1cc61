"""Checks that both tables of a drive have in common."""

from pathlib import Path

import numpy as np

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.route_geometry import RouteGeometry
from jaxcalib.table_files import row_place

MOST_WRONG = 0.5  # share of rows: with more something is wrong with the whole table


def refuse_if_most(file: Path, is_wrong: np.ndarray, expected: str) -> None:
    """Raise a CaseError for the first wrong row if most rows are wrong; `expected` goes on with their share."""
    share = float(np.mean(is_wrong))
    if share > MOST_WRONG:
        expected = f"{expected}, here and in {share:.0%} of the rows."
        raise CaseError(file, row_place(int(np.argmax(is_wrong))), expected)


def refuse_lanes(
    geometry: RouteGeometry, file: Path, log_row: np.ndarray, lane: np.ndarray, is_wrong: np.ndarray, edge: np.ndarray
) -> None:
    """Raise a CaseError for the first row whose lane the road does not have.

    Args:
        geometry: the route.
        file: the table.
        log_row: number of each row in it, counted from 0.
        lane: lane of each row.
        is_wrong: whether the road has no such lane.
        edge: index of the edge that each row lies on.
    """
    if not np.any(is_wrong):
        return
    index = int(np.argmax(is_wrong))
    name, num_lanes = geometry.edges[edge[index]], geometry.num_lanes[edge[index]]
    expected = f"expected 1 to {num_lanes}, the lanes of edge {quote(name)}, got {lane[index]}."
    raise CaseError(file, row_place(int(log_row[index]), "lane"), expected)


def unread_columns(columns: tuple[str, ...], name: str) -> list[str]:
    """Return a warning that names the columns that nobody reads."""
    shown = ", ".join(shorten(column, 30) for column in columns[:10])
    return [f"{name}: columns that are not read: {shown}."] if columns else []
