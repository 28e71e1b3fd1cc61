"""Where a log says that the subject vehicle is: on the globe, in the network's plane, or on an edge."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pyproj

from jaxcalib.errors import CaseError
from jaxcalib.field.route_geometry import RouteGeometry
from jaxcalib.field.table_files import ColumnTable, Kind

PlaceKind = Literal["globe", "plane", "edge"]
PLACE_COLUMNS: Mapping[PlaceKind, tuple[str, str]] = {
    "globe": ("longitude_rad", "latitude_rad"),
    "plane": ("x_m", "y_m"),  # the coordinates of the SUMO network, its offset included, unless `crs` names others
    "edge": ("edge", "position_m"),  # SUMO edge id, and metres from its beginning
}


@dataclass(frozen=True)
class LoggedPlace:
    """Places of the front bumper's middle (or of what `[perception] reference` says), one per row of the log."""

    kind: PlaceKind  # how they are given
    first: np.ndarray  # longitude, x, or the edge's id
    second: np.ndarray  # latitude, y, or the position on the edge; nan where the log has none

    @property
    def columns(self) -> str:
        """Names of the columns, for messages."""
        return " and ".join(PLACE_COLUMNS[self.kind])

    @property
    def is_missing(self) -> np.ndarray:
        """Rows without a place."""
        empty = self.first == "" if self.kind == "edge" else np.isnan(self.first)
        return np.asarray(empty | np.isnan(self.second), bool)

    def points(self, geometry: RouteGeometry, rows: np.ndarray) -> np.ndarray:
        """Points (x, y) in the geometry's plane, [row, 2]; inf where they lie outside of what can be mapped.

        A place on an edge is that on its rightmost lane; the lane's number tells the lane.
        """
        first, second = self.first[rows], self.second[rows]
        if self.kind == "plane":
            return geometry.mirrored(np.stack([first.astype(float), second], axis=-1))
        if self.kind == "globe":
            x, y = geometry.projection(np.degrees(first.astype(float)), np.degrees(second))
            points = np.stack([np.asarray(x), np.asarray(y)], axis=-1) + np.asarray(geometry.net_offset_m)
            return geometry.mirrored(points)
        number = {edge: index for index, edge in enumerate(geometry.edges)}
        points = np.full((len(rows), 2), np.inf)
        for index, (edge, position_m) in enumerate(zip(first, second, strict=True)):
            if edge in number:
                points[index] = geometry.point_on_edge(number[edge], float(position_m))
        return points


def place_columns(file: Path, names: Sequence[str]) -> tuple[PlaceKind, Mapping[str, Kind]]:
    """In which way a log gives places, and the kinds of these columns.

    Raises:
        CaseError: in none of the three.
    """
    if found := place_columns_among(names):
        return found
    ways = ", or ".join(" and ".join(columns) for columns in PLACE_COLUMNS.values())
    raise CaseError(file, "header", f"expected columns that say where the vehicle is: {ways}.")


def place_columns_among(names: Sequence[str]) -> tuple[PlaceKind, Mapping[str, Kind]] | None:
    """The same; None where these columns say no place."""
    for kind, columns in PLACE_COLUMNS.items():
        if set(columns) <= set(names):
            return kind, {columns[0]: "text" if kind == "edge" else "number", columns[1]: "number"}
    return None


def logged_place(table: ColumnTable, kind: PlaceKind, crs: str | None = None) -> LoggedPlace:
    """Places of a table that was read with the columns of `place_columns`.

    Args:
        table: the table.
        kind: how it gives places.
        crs: coordinate reference system of x_m and y_m; None where they are the network's own.
    """
    first, second = PLACE_COLUMNS[kind]
    if kind == "plane" and crs is not None:
        to_globe = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
        longitude_deg, latitude_deg = to_globe.transform(table.numbers[first], table.numbers[second])
        known = np.isfinite(longitude_deg) & np.isfinite(latitude_deg)
        return LoggedPlace(
            "globe",
            np.where(known, np.radians(longitude_deg), np.nan),
            np.where(known, np.radians(latitude_deg), np.nan),
        )
    if kind != "edge":
        return LoggedPlace(kind, table.numbers[first], table.numbers[second])
    index, words = table.texts[first]
    return LoggedPlace(kind, np.asarray([*words, ""], object)[index], table.numbers[second])
