"""Checks that both tables of a drive have in common."""

from pathlib import Path

import numpy as np

from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.field.map_matching import LaneMatch
from jaxcalib.field.route_geometry import RouteGeometry
from jaxcalib.field.table_files import row_place

MOST_WRONG = 0.5  # share of rows: with more something is wrong with the whole table
MOST_MISPLACED = 0.05  # share of rows whose lane is there a little before or farther on


def refuse_if_most(file: Path, is_wrong: np.ndarray, expected: str) -> None:
    """Raise a CaseError for the first wrong row if most rows are wrong; `expected` goes on with their share."""
    share = float(np.mean(is_wrong))
    if share > MOST_WRONG:
        expected = f"{expected}, here and in {share:.0%} of the rows."
        raise CaseError(file, row_place(int(np.argmax(is_wrong))), expected)


def refuse_lanes(
    geometry: RouteGeometry,
    file: Path,
    log_row: np.ndarray,
    lane: np.ndarray,
    is_considered: np.ndarray,
    lanes: LaneMatch,
) -> int:
    """Raise a CaseError for the first row whose lane the road does not have, and return how many are only misplaced.

    A few rows may have a lane that begins a little farther on, or ended a little before: places are not exact.

    Args:
        geometry: the route.
        file: the table.
        log_row: number of each row in it, counted from 0.
        lane: lane of each row.
        is_considered: whether a row counts.
        lanes: what its lane means.
    """
    is_wrong, is_misplaced = is_considered & lanes.no_such_lane, is_considered & lanes.misplaced
    if is_misplaced.sum() <= MOST_MISPLACED * is_considered.sum():
        is_wrong &= ~is_misplaced
    if not np.any(is_wrong):
        return int(is_misplaced.sum())
    index = int(np.argmax(is_wrong))
    name, num_lanes = geometry.edges[lanes.edge[index]], geometry.num_lanes[lanes.edge[index]]
    expected = f"expected 1 to {num_lanes}, the lanes of edge {quote(name)}, got {lane[index]}."
    raise CaseError(file, row_place(int(log_row[index]), "lane"), expected)


def unread_columns(columns: tuple[str, ...], name: str) -> list[str]:
    """Return a warning that names the columns that nobody reads."""
    shown = ", ".join(shorten(column, 30) for column in columns[:10])
    return [f"{name}: columns that are not read: {shown}."] if columns else []
