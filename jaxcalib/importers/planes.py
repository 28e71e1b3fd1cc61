"""Planes in which distances mean metres, for places that are given on the globe or in a vehicle's own frame."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pyproj

from jaxcalib.importers.trajectories import Slice


def utm_at(longitude_deg: float, latitude_deg: float) -> str:
    """The UTM zone of a place, as EPSG names it."""
    zone = int(np.clip(np.floor((longitude_deg + 180.0) / 6.0) + 1, 1, 60))
    return f"EPSG:{(32600 if latitude_deg >= 0.0 else 32700) + zone}"


def plane_of(longitude_deg: np.ndarray, latitude_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray, str]:
    """Places in the UTM zone of the first of them, and the name of that zone."""
    known = np.flatnonzero(np.isfinite(longitude_deg) & np.isfinite(latitude_deg))
    first = known[0] if len(known) else 0
    crs = utm_at(float(longitude_deg[first]), float(latitude_deg[first]))
    x_m, y_m = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(longitude_deg, latitude_deg)
    return np.asarray(x_m), np.asarray(y_m), crs


def slices_in_plane(slices: Iterable[Slice], crs: str) -> Iterator[Slice]:
    """Slices whose places are longitude and latitude, in the plane of a coordinate reference system."""
    transformer = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    for one in slices:
        x_m, y_m = transformer.transform(one.x_m, one.y_m)
        yield replace(one, x_m=np.asarray(x_m), y_m=np.asarray(y_m))


def from_vehicle_frame(
    pose: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    time_s: np.ndarray,
    ahead_m: np.ndarray,
    left_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Places in the plane of what a vehicle sees ahead of itself and to its left.

    Args:
        pose: times of the vehicle, its x and y in the plane, and its heading, counterclockwise from +x; the vehicle is
            interpolated between them.
        time_s: when each thing is seen.
        ahead_m: distance along the vehicle's heading.
        left_m: distance across it.
    """
    at_s, x_m, y_m, heading_rad = pose
    heading = np.interp(time_s, at_s, np.unwrap(heading_rad))
    cos, sin = np.cos(heading), np.sin(heading)
    return (
        np.interp(time_s, at_s, x_m) + cos * ahead_m - sin * left_m,
        np.interp(time_s, at_s, y_m) + sin * ahead_m + cos * left_m,
    )
