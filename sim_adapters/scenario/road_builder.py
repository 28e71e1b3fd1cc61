"""Lays the lanes of a route into the rows of the surrogate's `Road`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from sim_adapters.scenario.best_lanes import best_lanes
from sim_adapters.scenario.change_zones import LEFT, ChangeZone
from sim_adapters.scenario.route_lane import LaneKey, RouteLane
from sim_adapters.scenario.route_network import RouteNetwork
from surrogate.road.road import Road

CELL_LENGTH_M = 2.0
TRACK_MARGIN_M = 60.0  # free space between two tracks in one row, so that nobody follows across it
NOWHERE_M = 1e9
# SUMO 1.28, as seen on `corridor`: with more than one change to make, a vehicle stands so far from the end of its lane
ROOM_FOR_ONE_MORE_CHANGE_M = 20.0
# SUMO's vehicles stand on the last millimetre of their lane (436.079 of 436.080 m); beyond the border of a segment they
# would be on what lies behind it, with nobody beside to change to
ON_THIS_SIDE_M = 0.02


@dataclass(frozen=True)
class RowMap:
    """Which row each lane lies in."""

    row_of_lane: dict[LaneKey, int]  # row of each lane
    num_rows: int  # number of rows
    network: RouteNetwork  # the lanes


def lay_rows(network: RouteNetwork) -> RowMap:
    """Chain lanes that follow one another into tracks and put tracks that do not overlap into common rows."""
    tracks = _tracks(network)
    tracks.sort(key=lambda track: (track[0].start_m, track[0].index))
    rows: list[list[tuple[float, float]]] = []
    row_of_lane: dict[LaneKey, int] = {}
    for track in sorted(tracks, key=lambda track: track[0].start_m - track[-1].end_m):
        begin_m, end_m = track[0].start_m - TRACK_MARGIN_M, track[-1].end_m + TRACK_MARGIN_M
        free = (
            row
            for row, taken in enumerate(rows)
            if all(end_m <= other_begin or begin_m >= other_end for other_begin, other_end in taken)
        )
        row = next(free, len(rows))
        if row == len(rows):
            rows.append([])
        rows[row].append((track[0].start_m, track[-1].end_m))
        for lane in track:
            row_of_lane[lane.key] = row
    return RowMap(row_of_lane, len(rows), network)


def _tracks(network: RouteNetwork) -> list[list[RouteLane]]:
    """Return maximal chains of lanes; where a lane forks, the chain stays on the carriageway."""
    onward: dict[LaneKey, LaneKey] = {}
    taken: set[LaneKey] = set()
    for lane in _main_first(network):
        on_main = [successor for successor in lane.successors if successor[0] in network.main_edges]
        successors = on_main or list(lane.successors)
        free = [successor for successor in successors if successor not in taken]
        if free:
            onward[lane.key] = free[0]
            taken.add(free[0])  # of lanes that merge into one, the others end
    has_predecessor = set(onward.values())
    tracks = []
    for lane in network.lanes.values():
        if lane.key in has_predecessor:
            continue
        track = [lane]
        while track[-1].key in onward:
            track.append(network.lanes[onward[track[-1].key]])
        tracks.append(track)
    return tracks


def _main_first(network: RouteNetwork) -> list[RouteLane]:
    """Lanes of the carriageway before those of ramps: where lanes merge, the carriageway goes on."""
    return sorted(network.lanes.values(), key=lambda lane: lane.edge not in network.main_edges)


def build_road(row_map: RowMap, routes: Sequence[Sequence[str]]) -> Road:
    """Return the surrogate's road.

    Args:
        row_map: rows of the lanes.
        routes: for each destination the edges from the beginning of the carriageway to where it leaves the road.
    """
    network, num_rows = row_map.network, row_map.num_rows
    edges = [*network.main_edges, *network.ramp_edges]
    zone_ends_m = [end_m for zone in network.zones for end_m in (zone.begin_m, zone.end_m)]
    breaks = np.unique([*(network.edge_start_m(edge) for edge in edges), *zone_ends_m])
    num_segments = len(breaks)
    lane_at = _lanes_by_row_and_segment(row_map, breaks)
    main_edge_at = _main_edge_by_segment(network, breaks)

    limit = np.full((num_rows, num_segments), 1.0)
    slow_position = np.full((num_rows, num_segments), np.inf)
    slow_limit = np.full((num_rows, num_segments), 1.0)
    left, right = np.full((2, num_rows, num_segments), -1)
    carriageway = np.zeros((num_rows, num_segments), bool)
    elsewhere = np.zeros((num_rows, num_segments), bool)
    for (row, segment), lane in lane_at.items():
        limit[row, segment] = lane.speed_limit_mps
        slow = _next_lower_limit(network, lane)
        slow_position[row, segment], slow_limit[row, segment] = slow if slow else (np.inf, lane.speed_limit_mps)
        left[row, segment] = _row_beside(row_map, lane_at, segment, (lane.edge, lane.index + 1))
        right[row, segment] = _row_beside(row_map, lane_at, segment, (lane.edge, lane.index - 1))
        carriageway[row, segment] = lane.edge in network.main_edges
        elsewhere[row, segment] = lane.edge in network.main_edges and leads_elsewhere(network, lane)
    for zone in network.zones:
        row, beside = row_map.row_of_lane[zone.lane], row_map.row_of_lane[zone.beside]
        (left if zone.side == LEFT else right)[row, _segments_of(zone, row, lane_at, breaks)] = beside
    offset, continuation, stop, destination_end = _route_tables(row_map, routes, lane_at, breaks)
    ends, track_end = np.unique(np.minimum(continuation, stop).round(3), return_inverse=True)
    return Road(
        cell_origin_m=jnp.asarray(breaks[0], jnp.float32),
        cell_length_m=jnp.asarray(CELL_LENGTH_M, jnp.float32),
        borders_per_cell=_most_borders_in_a_cell(breaks),
        cell_segment=_cells(breaks, max(lane.end_m for lane in network.lanes.values())),
        segment_end_m=jnp.asarray([*breaks[1:], np.inf], jnp.float32),
        speed_limit_mps=jnp.asarray(limit, jnp.float32),
        slow_position_m=jnp.asarray(slow_position, jnp.float32),
        slow_limit_mps=jnp.asarray(slow_limit, jnp.float32),
        left_row=jnp.asarray(left, jnp.int32),
        right_row=jnp.asarray(right, jnp.int32),
        best_lane_offset=jnp.asarray(offset, jnp.int32),
        continuation_end_m=jnp.asarray(continuation, jnp.float32),
        end_position_m=jnp.asarray(ends, jnp.float32),
        track_end=jnp.asarray(track_end.reshape(stop.shape), jnp.int32),
        stop_position_m=jnp.asarray(
            stop - ON_THIS_SIDE_M - ROOM_FOR_ONE_MORE_CHANGE_M * (np.abs(offset) > 1), jnp.float32
        ),
        destination_end_m=jnp.asarray(destination_end, jnp.float32),
        is_carriageway=jnp.asarray(carriageway),
        leads_elsewhere=jnp.asarray(elsewhere),
        edge_start_m=jnp.asarray([network.edge_start_m(edge) for edge in main_edge_at], jnp.float32),
        edge_length_m=jnp.asarray(
            [network.edge_end_m(edge) - network.edge_start_m(edge) for edge in main_edge_at], jnp.float32
        ),
        num_lanes=jnp.asarray([network.lane_count[edge] for edge in main_edge_at], jnp.float32),
    )


def _lanes_by_row_and_segment(row_map: RowMap, breaks: np.ndarray) -> dict[tuple[int, int], RouteLane]:
    """Return the lane that fills each (row, segment); a junction's length belongs to the edge before it."""
    network = row_map.network
    lane_at = {}
    for lane in network.lanes.values():
        reach_m = max([lane.end_m, *(network.lanes[successor].start_m for successor in lane.successors)])
        first = int(np.searchsorted(breaks, lane.start_m))
        for segment in range(first, len(breaks)):
            if breaks[segment] >= reach_m:
                break
            lane_at[(row_map.row_of_lane[lane.key], segment)] = lane
    return lane_at


def _row_beside(row_map: RowMap, lane_at: Mapping[tuple[int, int], RouteLane], segment: int, key: LaneKey) -> int:
    """Return the row of a lane beside another, -1 where it is not there.

    Within a junction the lanes of an edge part: an exit's may have begun, a little before the carriageway's next edge,
    and whoever changed there would be on the exit.
    """
    row = row_map.row_of_lane.get(key, -1)
    lane = lane_at.get((row, segment))
    return row if lane is not None and lane.key == key and lane.is_open else -1


def _main_edge_by_segment(network: RouteNetwork, breaks: np.ndarray) -> list[str]:
    starts = np.asarray([network.edge_start_m(edge) for edge in network.main_edges])
    index = np.clip(np.searchsorted(starts, breaks, side="right") - 1, 0, len(starts) - 1)
    return [network.main_edges[i] for i in index]


def _next_lower_limit(network: RouteNetwork, lane: RouteLane) -> tuple[float, float] | None:
    here = lane
    while here.successors:
        here = network.lanes[here.successors[0]]
        if here.speed_limit_mps < lane.speed_limit_mps:
            return here.start_m, here.speed_limit_mps
    return None


def leads_elsewhere(network: RouteNetwork, lane: RouteLane) -> bool:
    """Return whether a lane leaves the carriageway; an acceleration lane, which simply ends, does not."""
    here = lane
    while here.successors:
        on_main = [successor for successor in here.successors if successor[0] in network.main_edges]
        here = network.lanes[(on_main or here.successors)[0]]
        if here.edge not in network.main_edges:
            return True
    return False


def _route_tables(
    row_map: RowMap,
    routes: Sequence[Sequence[str]],
    lane_at: dict[tuple[int, int], RouteLane],
    breaks: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    network = row_map.network
    num_rows, num_segments = row_map.num_rows, len(breaks)
    offset = np.zeros((len(routes), num_rows, num_segments), int)
    end_m = np.zeros((len(routes), num_rows, num_segments))
    stop_m = np.full((len(routes), num_rows, num_segments), np.inf)
    destination_end = np.zeros(len(routes))
    for destination, route in enumerate(routes):
        destination_end[destination] = network.edge_end_m(route[-1])
        outlooks = {edge: best_lanes(network, route[position:]) for position, edge in enumerate(route)}
        for ramp_edge in network.ramp_edges:
            if ramp_edge not in outlooks:
                outlooks[ramp_edge] = best_lanes(network, _via_ramp(network, ramp_edge, route))
        for (row, segment), lane in lane_at.items():
            if lane.edge not in outlooks:
                continue
            outlook = outlooks[lane.edge][lane.index]
            offset[destination, row, segment] = outlook.offset
            end_m[destination, row, segment] = lane.start_m + outlook.length_m
            stop_m[destination, row, segment] = _stop_m(network, lane, route)
        for zone in network.zones:
            if not zone.is_merge and zone.beside[0] not in route:
                continue
            row, beside = row_map.row_of_lane[zone.lane], outlooks.get(zone.beside[0])
            at = _segments_of(zone, row, lane_at, breaks)
            offset[destination, row, at] = _offset_over(zone.side, beside[zone.beside[1]].offset if beside else 0)
            end_m[destination, row, at] = stop_m[destination, row, at] = zone.end_m
    return offset, end_m, stop_m, destination_end


def _segments_of(
    zone: ChangeZone, row: int, lane_at: Mapping[tuple[int, int], RouteLane], breaks: np.ndarray
) -> list[int]:
    """Return the segments of a zone in the row of the lane that is left there."""
    within = np.flatnonzero((breaks >= zone.begin_m) & (breaks < zone.end_m))
    lanes = {segment: lane_at.get((row, int(segment))) for segment in within}
    return [int(segment) for segment, lane in lanes.items() if lane is not None and lane.key == zone.lane]


def _offset_over(side: int, beyond: int) -> int:
    """Return the changes to the best lane from a lane that must be left to one side, from those that remain there."""
    offset = side + beyond
    return offset if offset * side > 0 else side


def _via_ramp(network: RouteNetwork, ramp_edge: str, route: Sequence[str]) -> list[str]:
    """Return the route of a vehicle that starts on a ramp and goes on along `route`."""
    edges = [ramp_edge]
    while edges[-1] not in route:
        successors = _onward_from(network, edges[-1])
        if not successors:
            return edges  # an off-ramp of another destination
        edges.append(successors[0][0])
    return edges + list(route[list(route).index(edges[-1]) + 1 :])


def _onward_from(network: RouteNetwork, edge: str) -> tuple[LaneKey, ...]:
    """Return where the first lane of an edge that leads anywhere leads to."""
    return next((lane.leads_to for lane in network.edge_lanes(edge) if lane.leads_to), ())


def _stop_m(network: RouteNetwork, lane: RouteLane, route: Sequence[str]) -> float:
    """Return where a vehicle must stand if it stays in its lane's track; inf if the track follows the route."""
    here = lane
    while here.edge != route[-1]:
        onward = [s for s in here.successors if s[0] in route or (here.edge in network.ramp_edges)]
        if not onward:
            return here.end_m
        here = network.lanes[onward[0]]
    return np.inf


def _most_borders_in_a_cell(breaks: np.ndarray) -> int:
    """Return how many breaks a cell holds at most, wherever rounding puts its borders."""
    reach = np.searchsorted(breaks, breaks + 1.01 * CELL_LENGTH_M)
    return int(np.max(reach - np.arange(len(breaks))))


def _cells(breaks: np.ndarray, end_m: float) -> "jnp.ndarray":
    begins = breaks[0] + CELL_LENGTH_M * np.arange(int((end_m - breaks[0]) / CELL_LENGTH_M) + 2)
    return jnp.asarray(np.clip(np.searchsorted(breaks, begins, side="right") - 1, 0, len(breaks) - 1), jnp.int32)
