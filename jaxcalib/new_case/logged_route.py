"""The edges along which a drive was recorded: named in its log, or matched by its places."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from sumolib.route import mapTrace

from jaxcalib.errors import CaseError, quote
from jaxcalib.new_case.recorded_drives import RecordedDrive

FARTHEST_M = 30.0  # of a place from its edge
THINNED_M = 25.0  # between places that are matched
LONGEST_GAP_M = 500  # between two places, to be filled with the shortest way
LEAST_NAMED = 0.5  # share of rows that name an edge: with fewer, places say more


def logged_route(net: Any, drive: RecordedDrive) -> tuple[str, ...]:
    """Return the edges of a drive.

    Args:
        net: sumolib's network.
        drive: the drive.

    Raises:
        CaseError: its places are not on the network, or there is no way along them.
    """
    named = drive.log.place.first if drive.log.place.kind == "edge" else drive.log.road
    known = [str(edge) for edge in named if net.hasEdge(str(edge)) and not str(edge).startswith(":")]
    edges = known if len(known) > LEAST_NAMED * len(named) else _matched_edges(net, drive)
    edges = [edge for number, edge in enumerate(edges) if not number or edge != edges[number - 1]]
    return _connected(net, drive, edges)


def _matched_edges(net: Any, drive: RecordedDrive) -> list[str]:
    place = drive.log.place
    if place.kind == "edge":
        raise CaseError(drive.subject_file, "column edge", "expected edges of the scenario's network; most are not.")
    points = _thinned(_plane_points(net, drive))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # sumolib misses an index of edges, and does without
        found = mapTrace(points, net, FARTHEST_M, fillGaps=LONGEST_GAP_M, direction=True)
    if not found:
        expected = f"expected places within {FARTHEST_M:g} m of the network's edges; none is. Is it another road's log?"
        raise CaseError(drive.subject_file, f"columns {place.columns}", expected)
    return [edge.getID() for edge in found]


def _plane_points(net: Any, drive: RecordedDrive) -> np.ndarray:
    place = drive.log.place
    rows = np.flatnonzero(~place.is_missing)
    first, second = place.first[rows].astype(float), place.second[rows]
    if place.kind == "plane":
        return np.stack([first, second], axis=-1)
    try:
        project = net.getGeoProj()
    except (KeyError, RuntimeError):
        raise CaseError(
            drive.subject_file,
            f"columns {place.columns}",
            "expected places in the network's own coordinates (columns x_m, y_m, or edge, position_m); the network has "
            "no projection that longitude and latitude could refer to.",
        ) from None
    x, y = project(np.degrees(first), np.degrees(second))
    return np.stack([np.asarray(x), np.asarray(y)], axis=-1) + np.asarray(net.getLocationOffset())


def _thinned(points: np.ndarray) -> list[tuple[float, float]]:
    kept: list[np.ndarray] = []
    for point in points[np.isfinite(points).all(axis=1)]:
        if not kept or np.hypot(*(point - kept[-1])) >= THINNED_M:
            kept.append(point)
    return [(float(x), float(y)) for x, y in kept]


def _connected(net: Any, drive: RecordedDrive, edges: Sequence[str]) -> tuple[str, ...]:
    """Fill in the shortest way where two edges do not follow one another."""
    route = [net.getEdge(edges[0])]
    for name in edges[1:]:
        edge = net.getEdge(name)
        if edge not in route[-1].getOutgoing():
            between, _ = net.getShortestPath(route[-1], edge)
            if between is None:
                expected = f"expected a drive along connected edges; none leads from {quote(route[-1].getID())} to "
                raise CaseError(drive.subject_file, "", f"{expected}{quote(name)}.")
            route += between[1:-1]
        route.append(edge)
    return tuple(edge.getID() for edge in route)
