"""Why lanes that a log names may not lie where its places do: counted otherwise, or places to the side."""

import numpy as np

from jaxcalib.field.log_tables import LANE_UNKNOWN
from jaxcalib.field.map_matching import match_lanes
from jaxcalib.field.route_geometry import RouteGeometry

CLEAR = 0.2  # of the contradictions, that a cause must leave at most
FARTHEST_M = 15.0  # to the side, that is looked for
STEP_M = 0.5
MOST_ASIDE_M = 0.5  # from the middle of the lanes, in the median, under a cause that is right


def lane_cause(
    geometry: RouteGeometry,
    position_m: np.ndarray,
    across_m: np.ndarray,
    lane: np.ndarray,
    edge: np.ndarray,
    from_left: bool = False,
) -> str:
    """Say what would make lanes and places agree, as a sentence that begins with a space; empty where nothing would.

    Args:
        geometry: the route.
        position_m: places along it.
        across_m: places across it.
        lane: lanes that the log names.
        edge: edges on which they are counted.
        from_left: whether they are said to be counted from the left.
    """
    named = lane != LANE_UNKNOWN

    def contradicting(across_m: np.ndarray, lane: np.ndarray, from_left: bool = from_left) -> float:
        match = match_lanes(geometry, position_m, across_m, lane, edge, from_left)
        wrong = match.contradicts | match.no_such_lane
        is_aside = not wrong.all() and abs(np.nanmedian(match.lateral_m[~wrong])) > MOST_ASIDE_M
        return 1.0 if is_aside else float(np.mean(wrong))

    as_stated = contradicting(across_m, lane)
    side, other = ("left", "right") if from_left else ("right", "left")
    ways = {
        f"lanes seem to be counted from the {other}; 1 is to be the {side}most, unless [log] has lanes_from.":
        (across_m, lane, not from_left),
        f"lanes seem to be counted from 0; 1 is to be the {side}most, unless [log] has first_lane = 0.":
        (across_m, np.where(named, lane + 1, lane)),
    }  # fmt: skip
    best = min(ways, key=lambda words: contradicting(*ways[words]))
    shifts_m = np.arange(-FARTHEST_M, FARTHEST_M + STEP_M / 2, STEP_M)
    left = [contradicting(across_m - shift_m, lane) for shift_m in shifts_m]
    least = min(left)
    shift_m = float(np.median(shifts_m[np.isclose(left, least)]))
    if contradicting(*ways[best]) <= min(CLEAR * as_stated, least):
        return f" {best[0].upper()}{best[1:]}"
    if least <= CLEAR * as_stated:
        side = "left" if (shift_m > 0.0) != geometry.is_mirrored else "right"
        return f" Places seem to lie {abs(shift_m):.1f} m to the {side} of where they should; is the map of this datum?"
    return ""
