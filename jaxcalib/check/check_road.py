"""What is drawn of a case's road: the plane of the map, the lanes in it, and their borders across the road."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.field.logged_place import LoggedPlace
from jaxcalib.field.map_matching import lane_centre_m, match_points
from jaxcalib.field.route_geometry import RouteGeometry

EARTH_RADIUS_M = 6_371_000.0
SAME_BORDER_M = 0.2  # borders of lanes nearer than that are one
NEAR_ROAD_M = 50.0  # what is farther off is not beside the road
MOST_ON_LINE = 800  # points that a line is drawn through
TOUCH_M = 0.1  # pieces of a lane nearer than that are one line


@dataclass(frozen=True)
class MapPlane:
    """The plane of the map: the network's where the places mean something in it, else one around the first place."""

    road: RouteGeometry | None  # whose network's plane it is; None for one without a road
    kind: str = ""  # how places are given that have a point in a plane without a road
    origin: tuple[float, float] = (0.0, 0.0)  # of that plane, in what the log gives

    def points(self, place: LoggedPlace, rows: np.ndarray) -> np.ndarray:
        """Points of some rows of a log, [row, 2]; nan where they have none in this plane."""
        if self.road is not None:
            if place.kind == "globe" and not self.road.has_projection:
                return np.full((len(rows), 2), np.nan)
            points = self.road.mirrored(place.points(self.road, rows))  # back to the network's own plane
        elif place.kind != self.kind:
            return np.full((len(rows), 2), np.nan)
        else:
            points = np.stack([place.first[rows].astype(float), place.second[rows]], axis=1)
            if place.kind == "globe":
                longitude_m = EARTH_RADIUS_M * np.cos(self.origin[1])  # for each radian
                points = (points - self.origin) * (longitude_m, EARTH_RADIUS_M)
        return np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)


def map_plane(road: RouteGeometry | None, places: Sequence[LoggedPlace]) -> MapPlane:
    """Return the plane in which logs are drawn.

    Args:
        road: of the case; None where it is unknown.
        places: of its drives.
    """
    if road is not None and (not places or any(place.kind != "globe" or road.has_projection for place in places)):
        return MapPlane(road)
    for place in places:
        rows = np.flatnonzero(~place.is_missing)
        if place.kind == "globe" and len(rows):
            longitude_rad, latitude_rad = np.median(place.first[rows]), np.median(place.second[rows])
            return MapPlane(None, "globe", (float(longitude_rad), float(latitude_rad)))
        if place.kind == "plane":
            return MapPlane(None, "plane")
    return MapPlane(None)


@dataclass(frozen=True)
class CrossSection:
    """A road's lanes beside one another, each row at one place, wherever the route's edges begin to count."""

    road: RouteGeometry
    centre_m: np.ndarray  # of each row across the road, in the direction of the geometry
    width_m: np.ndarray
    share: np.ndarray  # of the route that has it

    @property
    def side(self) -> float:
        """What makes + left of a value of the geometry."""
        return -1.0 if self.road.is_mirrored else 1.0

    @property
    def borders_m(self) -> dict[float, float]:
        """Borders of the lanes, + left, with the share of the route that has them."""
        borders: dict[float, float] = {}
        for centre_m, half_m, share in zip(self.centre_m, self.width_m / 2, self.share, strict=True):
            for border_m in (self.side * (centre_m - half_m), self.side * (centre_m + half_m)):
                same = (other for other in borders if abs(other - border_m) < SAME_BORDER_M)
                known = next(same, float(border_m))
                borders[known] = max(borders.get(known, 0.0), float(share))
        return borders

    def laid(self, edge: np.ndarray, across_m: np.ndarray) -> np.ndarray:
        """Lay places across the road, in the geometry's coordinate, beside the lane that is nearest there; + left."""
        away_m = np.abs(across_m[:, None] - self.road.lane_centre_m[edge])
        lane = np.argmin(np.where(np.isnan(away_m), np.inf, away_m), axis=1)
        shift_m = self.centre_m[self.road.row_of_lane[edge, lane]] - self.road.lane_centre_m[edge, lane]
        return self.side * (across_m + shift_m)

    def beside(self, xy_m: np.ndarray) -> np.ndarray | None:
        """Where points lie across the road that they may be off, + left; None where most are nowhere near it."""
        road, across_m = self.road, np.full(len(xy_m), np.nan)
        rows = np.flatnonzero(np.isfinite(xy_m[:, 0]))
        if not len(rows):
            return None
        match = match_points(road, road.mirrored(xy_m[rows]))
        edge = road.edge_at(match.position_m)
        laid_m = self.laid(edge, lane_centre_m(road, edge, match.row) + match.lateral_m)
        across_m[rows] = np.where(match.distance_m < NEAR_ROAD_M, laid_m, np.nan)
        return across_m if np.mean(np.isfinite(across_m)) > 0.5 else None


def cross_section(road: RouteGeometry) -> CrossSection:
    """Return a road's lanes beside one another, as they are on its widest edge; others are added to these."""
    length_m = road.edge_end_m - road.edge_start_m
    centre_m, width_m = np.full((2, len(road.by_row)), np.nan)
    share = np.zeros(len(road.by_row))
    for edge in np.lexsort((-length_m, -road.num_lanes)):  # of the widest ones the longest first
        lanes = np.flatnonzero(road.row_of_lane[edge] >= 0)
        rows = road.row_of_lane[edge, lanes]
        share[rows] += length_m[edge] / max(float(length_m.sum()), 1e-9)
        known = lanes[np.isfinite(centre_m[rows])]
        for lane, row in zip(lanes, rows, strict=True):
            if np.isfinite(centre_m[row]):
                continue
            shift_m = 0.0
            if len(known):
                beside = known[np.argmin(np.abs(known - lane))]
                shift_m = centre_m[road.row_of_lane[edge, beside]] - road.lane_centre_m[edge, beside]
            centre_m[row] = road.lane_centre_m[edge, lane] + shift_m
            width_m[row] = road.lane_width_m[edge, lane]
    return CrossSection(road, centre_m, width_m, share)


def evenly(values: np.ndarray) -> np.ndarray:
    """Indices of values that a line is drawn through, the first and the last among them."""
    return np.unique(np.linspace(0, max(len(values) - 1, 0), min(len(values), MOST_ON_LINE)).astype(int))


def lane_lines(road: RouteGeometry) -> tuple[np.ndarray, ...]:
    """Centre line of each row of lanes in the network's plane, nan where it is interrupted."""
    lines = []
    for in_row in filter(len, road.by_row):
        begin, end = road.begin_xy[in_row], road.begin_xy[in_row] + road.step_xy[in_row]
        cuts = np.flatnonzero(np.hypot(*(begin[1:] - end[:-1]).T) > TOUCH_M) + 1
        pieces = []
        for piece in np.split(np.arange(len(in_row)), cuts):
            pieces += [begin[piece], end[piece[-1:]], np.full((1, 2), np.nan)]
        lines.append(road.mirrored(np.concatenate(pieces[:-1])))
    return tuple(lines)
