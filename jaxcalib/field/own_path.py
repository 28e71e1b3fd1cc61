"""The way that a subject vehicle drove, as a road: what a log is judged by where there is no map."""

import numpy as np
import pyproj

from jaxcalib.field.log_tables import SubjectLog
from jaxcalib.field.logged_place import LoggedPlace
from jaxcalib.field.route_geometry import RouteGeometry, geometry_of_line

SMOOTHED_S = 1.0  # of places: they are noisy, and a way of noise is longer than it was
THINNED_M = 2.0  # between the points of the line
BEYOND_M = 300.0  # straight on at both ends, for what lies before and behind


def own_path_geometry(log: SubjectLog) -> RouteGeometry | None:
    """The vehicle's way as a road without lanes; None where the log has no places in a plane or on the globe.

    Args:
        log: the subject vehicle's table.
    """
    place = log.place
    rows = np.flatnonzero(~place.is_missing)
    if place.kind == "edge" or len(rows) < 2:
        return None
    projection = _projection(place, rows)
    points = _points(place, rows, projection)
    line = _thinned(_smoothed(points, max(1, round(SMOOTHED_S / log.sampling_s))))
    return None if len(line) < 2 else geometry_of_line(_extended(line), projection)


def _projection(place: LoggedPlace, rows: np.ndarray) -> pyproj.Proj | None:
    """A plane around the log's middle, in which a metre is a metre."""
    if place.kind != "globe":
        return None
    longitude_deg, latitude_deg = (np.degrees(np.median(x[rows].astype(float))) for x in (place.first, place.second))
    return pyproj.Proj(proj="tmerc", lon_0=float(longitude_deg), lat_0=float(latitude_deg))


def _points(place: LoggedPlace, rows: np.ndarray, projection: pyproj.Proj | None) -> np.ndarray:
    first, second = place.first[rows].astype(float), place.second[rows]
    if projection is not None:
        first, second = projection(np.degrees(first), np.degrees(second))
    return np.stack([np.asarray(first), np.asarray(second)], axis=-1)


def _smoothed(points: np.ndarray, num_rows: int) -> np.ndarray:
    """Running mean over an odd number of rows, fewer at the ends."""
    half = num_rows // 2
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(points, axis=0)])
    at = np.arange(len(points))
    reach = np.minimum(np.minimum(at, len(points) - 1 - at), half)
    return (sums[at + reach + 1] - sums[at - reach]) / (2 * reach + 1)[:, None]


def _thinned(points: np.ndarray) -> np.ndarray:
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return points[np.diff(np.floor(driven_m / THINNED_M), prepend=-1.0) > 0.0]


def _extended(line: np.ndarray) -> np.ndarray:
    def beyond(end: np.ndarray, before: np.ndarray) -> np.ndarray:
        step = end - before
        return end + BEYOND_M * step / np.hypot(*step)

    first, last = line[min(5, len(line) - 1)], line[max(-6, -len(line))]
    return np.concatenate([[beyond(line[0], first)], line, [beyond(line[-1], last)]])
