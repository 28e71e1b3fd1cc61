"""The stretch of road that was recorded along a virtual probe's way, and the sensor range that it has room for."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyproj
import sumolib

from jaxcalib.errors import CaseError
from jaxcalib.importers.importer import USUAL_RANGE_M
from jaxcalib.importers.trajectories import Slice
from jaxcalib.new_case.guesses import ROUNDED_M
from sim_adapters.scenario.configuration import read_configuration

LEAST_REMAINING = 0.5  # share of a recorded stretch on which probes count
FARTHEST_ASIDE_M = 40.0  # beyond the other carriageway nobody is looked at
SAME_DIRECTION = 0.7  # cosine
NEAR_ROAD_END_M = 50.0  # vehicles enter and leave networks some way from where the road ends
Place = tuple[float, float, float]  # x_m, y_m, and heading_rad, counterclockwise from +x


@dataclass
class RecordedStretch:
    """From where to where others were recorded along the way of a probe."""

    first: Place  # where the probe is first there
    last: Place
    before_m: float = 0.0  # recorded before the first place; infinite where the road itself begins there
    after_m: float = 0.0  # recorded after the last place
    way_m: np.ndarray = field(default_factory=lambda: np.zeros(1))  # driven by the probe until each of its rows

    def open_at(self, road_ends_m: np.ndarray) -> None:
        """Take it that nothing is missing beyond the places where the road itself ends (rows of x and y)."""
        for name, place, sign in (("before_m", self.first, -1.0), ("after_m", self.last, 1.0)):
            beyond_m = sign * getattr(self, name)
            end_m = np.asarray(place[:2]) + beyond_m * np.asarray([np.cos(place[2]), np.sin(place[2])])
            if np.hypot(*(road_ends_m - end_m).T).min(initial=np.inf) <= NEAR_ROAD_END_M:
                setattr(self, name, np.inf)

    def known_m(self) -> tuple[float, int]:
        """Length of the stretch, as far as somebody was seen, and at how many ends the road goes on unrecorded."""
        beyond_m = [one for one in (self.before_m, self.after_m) if np.isfinite(one)]
        return self.way_m[-1] + sum(beyond_m), len(beyond_m)

    def longest_range_m(self) -> float:
        """Range with which a probe counts on LEAST_REMAINING of the stretch; infinite where no road is missing."""
        length_m, num_ends = self.known_m()
        return (1.0 - LEAST_REMAINING) * length_m / num_ends if num_ends else np.inf

    def has_room(self, range_m: float) -> np.ndarray:
        """For each row of the probe, whether the road was recorded for a range ahead and behind."""
        behind_m, ahead_m = self.before_m + self.way_m, self.way_m[-1] - self.way_m + self.after_m
        return (behind_m >= range_m) & (ahead_m >= range_m)


def widen(stretches: Sequence[RecordedStretch], one: Slice) -> None:
    """Let stretches reach to whoever is farther along, straight on before their first and after their last places."""
    places = np.asarray([(stretch.first, stretch.last) for stretch in stretches]).reshape(-1, 2, 3, 1)
    x_m, y_m, heading_rad = places.transpose(2, 0, 1, 3)  # by stretch, first and last, and vehicle
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    away_x_m, away_y_m = one.x_m - x_m, one.y_m - y_m
    is_along = np.abs(cos * away_y_m - sin * away_x_m) <= FARTHEST_ASIDE_M
    is_along &= np.cos(one.heading_rad - heading_rad) > SAME_DIRECTION
    ahead_m = np.where(is_along, cos * away_x_m + sin * away_y_m, 0.0)
    before_m, after_m = -ahead_m[:, 0].min(-1, initial=0.0), ahead_m[:, 1].max(-1, initial=0.0)
    for stretch, before, after in zip(stretches, before_m, after_m, strict=True):
        stretch.before_m, stretch.after_m = max(stretch.before_m, before), max(stretch.after_m, after)


def range_of(stretches: Sequence[RecordedStretch], asked_m: float | None) -> tuple[float, str]:
    """Range of the sensors of virtual probes ahead and behind, in metres, and a line that says why.

    Args:
        stretches: of the probes.
        asked_m: what the user wants; None for the usual range, or a shorter one on a short stretch.

    Raises:
        CaseError: too little of the stretch remains with the range that was asked for.
    """
    longest_m = float(np.median([one.longest_range_m() for one in stretches]))
    length_m = float(np.median([one.known_m()[0] for one in stretches]))
    if np.isfinite(longest_m):
        longest_m = ROUNDED_M * np.floor(longest_m / ROUNDED_M)  # as case.toml has ranges
    if longest_m < ROUNDED_M:
        raise CaseError("command line", "SOURCE", f"expected a longer stretch of road than {length_m:.0f} m.")
    if asked_m is not None and asked_m > longest_m:
        expected = (
            f"expected at most {longest_m:g} m, got {asked_m:g} m: probes count where all their range was recorded,"
        )
        which = f"which is then less than half of the stretch of {length_m:.0f} m."
        raise CaseError("command line", "--range-m", f"{expected} {which}")
    range_m, why = asked_m or min(USUAL_RANGE_M, longest_m), ""
    if range_m != asked_m and range_m < USUAL_RANGE_M:
        why = f", not {USUAL_RANGE_M:g} m, for the recorded stretch is {length_m:.0f} m long"
    return range_m, f"virtual probes see {range_m:g} m ahead and behind{why}; they count where all that was recorded."


def road_ends_m(config: Path, crs: str | None) -> np.ndarray:
    """Places (rows of x and y) where a network's roads for cars begin or end.

    Args:
        config: configuration of the scenario.
        crs: coordinate reference system of the places; None for the network's plane.
    """
    net = sumolib.net.readNet(str(read_configuration(config).net_file))
    edges = [edge for edge in net.getEdges(withInternal=False) if edge.allows("passenger")]
    nodes = [edge.getFromNode() for edge in edges if not edge.getIncoming()]
    nodes += [edge.getToNode() for edge in edges if not edge.getOutgoing()]
    ends = np.asarray([node.getCoord()[:2] for node in nodes], float).reshape(-1, 2)
    if crs is None or not len(ends):
        return ends
    if not net.hasGeoProj():
        return ends[:0]
    degrees = np.asarray([net.convertXY2LonLat(*end) for end in ends])
    return np.stack(pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(*degrees.T), axis=-1)
