"""Which lane a route needs, as SUMO's `MSVehicle::updateBestLanes` sees it."""

from collections.abc import Sequence
from dataclasses import dataclass

from sim_adapters.scenario.route_lane import LaneKey
from sim_adapters.scenario.route_network import RouteNetwork

LOOK_AHEAD_M = 3000.0  # SUMO looks no further along the route,
LOOK_AHEAD_EDGES = 9  # and at no more edges (measured with getBestLanes of SUMO 1.28)
NEAR_OFFSET = 2  # a lane one change away from the best continuation counts as if it were the best


@dataclass
class LaneOutlook:
    """How one lane serves a route."""

    offset: int  # lane changes to the best lane, left positive
    length_m: float  # how far the route can be followed from the beginning of the lane without a lane change
    continues: bool  # whether the lane leads to the route's next edge


def best_lanes(network: RouteNetwork, edges: Sequence[str]) -> list[LaneOutlook]:
    """Return the outlook of each lane of `edges[0]` for a route along `edges`.

    Lengths include the junctions between edges, so that `edge_start_m` plus a length is a place on the route's axis.

    Source: `MSVehicle::updateBestLanes`: backwards from the last edge within 3000 m; a lane takes the length of its
    best connected next lane, and the best length of the whole next edge if it is at most one change away from it.
    """
    horizon, seen_m = 0, 0.0
    while horizon < min(len(edges), LOOK_AHEAD_EDGES) and seen_m < LOOK_AHEAD_M:
        seen_m += _length_m(network, edges[horizon])
        horizon += 1
    following: list[LaneOutlook] | None = None
    for position in range(horizon - 1, -1, -1):
        next_edge = edges[position + 1] if position + 1 < len(edges) else None
        following = _outlooks(network, edges[position], next_edge, following)
    assert following is not None
    return following


def _outlooks(
    network: RouteNetwork, edge: str, next_edge: str | None, following: list[LaneOutlook] | None
) -> list[LaneOutlook]:
    length_m = _length_m(network, edge)
    lanes = network.edge_lanes(edge)
    outlooks = []
    connected = [index for lane in lanes for index in _into(lane.leads_to, next_edge)]
    for lane in lanes:
        targets = _into(lane.leads_to, next_edge)
        continues = lane.is_open and (next_edge is None or bool(targets))
        outlook = LaneOutlook(offset=0, length_m=length_m if lane.is_open else 0.0, continues=continues)
        if following is not None and targets and lane.is_open:
            best_connected_m = max(following[index].length_m for index in connected)
            best_m = max(next_outlook.length_m for next_outlook in following)
            target = min((following[index] for index in targets), key=lambda o: (-o.length_m, abs(o.offset)))
            is_near = target.length_m == best_connected_m and abs(target.offset) < NEAR_OFFSET
            through_m = network.edge_start_m(next_edge) - network.edge_start_m(edge) if next_edge else length_m
            outlook.length_m = through_m + (best_m if is_near else target.length_m)
            outlook.offset = target.offset
        outlooks.append(outlook)
    if following is None and next_edge is not None:
        # the last edge within the horizon: lanes that lead on are as good as any
        for outlook in outlooks:
            outlook.length_m = length_m if outlook.continues else 0.0
    return _set_offsets(outlooks)


def _set_offsets(outlooks: list[LaneOutlook]) -> list[LaneOutlook]:
    """Point every lane that is worse than the best one towards it."""

    def quality(outlook: LaneOutlook) -> tuple[float, int]:
        return (outlook.length_m, -abs(outlook.offset))

    best = max(quality(outlook) for outlook in outlooks)
    good = [index for index, outlook in enumerate(outlooks) if quality(outlook) == best]
    for index, outlook in enumerate(outlooks):
        if index in good:
            outlook.offset = 0
        else:
            outlook.offset = min((target - index for target in good), key=abs)
    return outlooks


def _into(successors: Sequence[LaneKey], edge: str | None) -> list[int]:
    return [index for successor, index in successors if successor == edge]


def _length_m(network: RouteNetwork, edge: str) -> float:
    return network.edge_end_m(edge) - network.edge_start_m(edge)
