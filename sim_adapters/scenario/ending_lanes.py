"""Lanes of the carriageway that end, or lead off it: who is to go on along the road must leave them in time."""

from dataclasses import dataclass

from sim_adapters.scenario.road_builder import RowMap, leads_elsewhere
from sim_adapters.scenario.route_lane import RouteLane
from sim_adapters.scenario.route_network import RouteNetwork


@dataclass(frozen=True)
class EndingLane:
    """The part of a row on the carriageway that ends before the road does."""

    row: int
    begin_m: float  # where it begins on the route's axis
    end_m: float  # where it ends, or leaves the carriageway
    leads_off: bool  # whether it goes on to an exit


def ending_lanes(row_map: RowMap) -> list[EndingLane]:
    """Return all of them, by where they end."""
    network = row_map.network
    found = []
    for lane in network.lanes.values():
        if lane.edge not in network.main_edges or lane.edge == network.main_edges[-1] or _onward(network, lane):
            continue
        before = _chain_before(row_map, lane)
        found.append(
            EndingLane(row_map.row_of_lane[lane.key], before[-1].start_m, lane.end_m, leads_elsewhere(network, lane))
        )
    return sorted(found, key=lambda one: (one.end_m, one.row))


def _onward(network: RouteNetwork, lane: RouteLane) -> list[RouteLane]:
    """Lanes of the carriageway that it goes on in."""
    return [network.lanes[key] for key in lane.successors if key[0] in network.main_edges]


def _chain_before(row_map: RowMap, lane: RouteLane) -> list[RouteLane]:
    """The lane and those of its row that lead to it alone, backwards; who is on one that forks has yet to choose."""
    network, row = row_map.network, row_map.row_of_lane[lane.key]
    chain = [lane]
    while True:
        before = [
            one
            for one in network.lanes.values()
            if one.edge in network.main_edges
            and row_map.row_of_lane[one.key] == row
            and [onward.key for onward in _onward(network, one)] == [chain[-1].key]
        ]
        if not before:
            return chain
        chain.append(before[0])
