"""The queues before a scenario's entrances, and what may arrive there, where flows come and depart in different ways.

Where all depart as the surrogate's plain entering has it and each entrance knows one window of time, an entrance is one
queue and nothing of this is needed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from sim_adapters.scenario.demand_elements import Departure
from sim_adapters.scenario.demand_file import VEHICLES, Flow, Vehicle, vehicles_id
from sim_adapters.scenario.demand_windows import id_at
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.world.departures import BEST, LANES, departure_of, lanes_of
from surrogate.inflow.departure import DepartureRules, Lane
from surrogate.inflow.timetable import Schedule

PLAIN_DEPARTURE = Departure("best", "last", "avg")
MOST_DEMAND = 10.0  # times the scenario's for which the timetable has room
MOST_LANE_VEHPS = 0.9  # no lane takes more; what comes beyond it would wait for ever
SPREAD = 5.0  # standard deviations of random arrivals for which it has room
ONE_LANE_RULE = ""


@dataclass(frozen=True)
class Queue:
    """Those who wait for the same lanes of one edge."""

    edge: str
    lane: str  # SUMO's departLane; empty where all who enter at the edge are one queue
    flows: tuple[Flow, ...]  # flows that come to it; single vehicles are one for each vType, route and departure
    # the single vehicles, each with its flow's place among `flows`, and its number at the edge
    vehicles: tuple[tuple[Vehicle, int, int], ...] = ()


def is_plain(scenario: Scenario) -> bool:
    """Whether all depart as the surrogate's plain entering has it, in one window of time for each entrance."""
    departures = {flow.departure for flow in scenario.flows} | {scenario.demand.subject_departure}
    if departures != {PLAIN_DEPARTURE} or any(flow.id.startswith(VEHICLES) for flow in scenario.flows):
        return False
    windows = {(flow.route[0], flow.begin_s, flow.end_s) for flow in scenario.flows}
    return len(windows) == len({edge for edge, _, _ in windows})


def queues_of(scenario: Scenario) -> list[Queue]:
    """Return the queues before the entrances; the first is the subject vehicle's."""
    if is_plain(scenario):
        edges = scenario.entrances
        return [
            Queue(edge, ONE_LANE_RULE, tuple(one for one in scenario.flows if one.route[0] == edge)) for edge in edges
        ]
    own = (scenario.demand.subject_route[0], scenario.demand.subject_departure.lane)
    keys = dict.fromkeys([own, *((flow.route[0], flow.departure.lane) for flow in scenario.flows)])
    return [_queue(scenario, edge, lane) for edge, lane in keys]


def _queue(scenario: Scenario, edge: str, lane: str) -> Queue:
    ours = [flow for flow in scenario.flows if (flow.route[0], flow.departure.lane) == (edge, lane)]
    flows = [flow for flow in ours if not flow.id.startswith(VEHICLES)]
    kinds = {_kind(flow.id, flow): flow for flow in ours if flow.id.startswith(VEHICLES)}
    place = {kind: len(flows) + number for number, kind in enumerate(kinds)}
    at_edge = [vehicle for vehicle in scenario.demand.vehicles if vehicle.route[0] == edge]
    kind = [_kind(id_at(vehicles_id(edge), scenario.windows, one.depart_s), one) for one in at_edge]
    vehicles = [(one, place[kind[number]], number) for number, one in enumerate(at_edge) if kind[number] in place]
    return Queue(edge, lane, (*flows, *kinds.values()), tuple(vehicles))


def _kind(flow: str, one: Flow | Vehicle) -> tuple:
    return flow, one.vtype, one.route, one.departure


def schedule_of(scenario: Scenario, queues: list[Queue]) -> Schedule:
    """Return what may arrive at the queues."""
    flows = [
        (number, column, flow)
        for number, queue in enumerate(queues)
        for column, flow in enumerate(queue.flows)
        if not flow.id.startswith(VEHICLES)
    ]
    singles = [(number, *single) for number, queue in enumerate(queues) for single in queue.vehicles]
    until_s = [min(flow.end_s, scenario.end_s) for _, _, flow in flows]
    main = scenario.demand.subject_route[0]
    lanes = [scenario.network.lane_count[queues[queue].edge] for queue, _, _ in flows]
    room = [_room_of(flow, end_s, own) for (_, _, flow), end_s, own in zip(flows, until_s, lanes, strict=True)]
    most = max(room, default=1)
    most_copies = math.ceil(MOST_DEMAND * scenario.configuration.scale) + 1
    num_of_flows = max(len(flows), 1) * most
    never = num_of_flows + max(len(singles), 1) * most_copies
    source: list[list[int]] = [[] for _ in queues]
    column_of: list[list[int]] = [[] for _ in queues]
    for place, ((queue, column, _), number) in enumerate(zip(flows, room, strict=True)):
        source[queue] += range(place * most, place * most + number)
        column_of[queue] += [column] * number
    for place, (queue, _, column, _) in enumerate(singles):
        source[queue] += range(num_of_flows + place * most_copies, num_of_flows + (place + 1) * most_copies)
        column_of[queue] += [column] * most_copies
    longest = max(map(len, source)) + 1  # nobody ever arrives at the last place
    parts = _parts(scenario)
    return Schedule(
        begin_s=_floats([flow.begin_s for _, _, flow in flows]),
        end_s=_floats(until_s),
        opens_s=jnp.asarray(scenario.configuration.begin_s, jnp.float32),
        is_regular=jnp.asarray([flow.is_regular for _, _, flow in flows] or [False]),
        begins_anywhere=jnp.asarray([parts[_window(flow)] > 1 for _, _, flow in flows] or [False]),
        queue=_whole([queue for queue, _, _ in flows]),
        column=_whole([column for _, column, _ in flows]),
        is_mainline=jnp.asarray([queues[queue].edge == main for queue, _, _ in flows] or [False]),
        num_lanes=_whole(lanes, otherwise=1),
        vehicle_s=_floats([vehicle.depart_s for _, vehicle, _, _ in singles], otherwise=jnp.inf),
        vehicle_number=_whole([number for _, _, _, number in singles]),
        vehicle_column=jnp.asarray([(queue, column) for queue, _, column, _ in singles] or [(0, 0)], jnp.int32),
        source=jnp.asarray([one + [never] * (longest - len(one)) for one in source], jnp.int32),
        flow=jnp.asarray([one + [0] * (longest - len(one)) for one in column_of], jnp.int32),
        most_of_flow=most,
        most_copies=most_copies,
    )


def _parts(scenario: Scenario) -> Mapping[tuple[str, float, float], int]:
    parts: dict[tuple[str, float, float], int] = {}
    for flow in scenario.flows:
        parts[_window(flow)] = parts.get(_window(flow), 0) + 1
    return parts


def _window(flow: Flow) -> tuple[str, float, float]:
    return flow.id, flow.begin_s, flow.end_s


def _room_of(flow: Flow, end_s: float, num_lanes: int) -> int:
    most_vehps = min(MOST_DEMAND * flow.rate_vehps, max(flow.rate_vehps, MOST_LANE_VEHPS * num_lanes))
    most = most_vehps * max(end_s - flow.begin_s, 0.0)
    return math.ceil(most + SPREAD * math.sqrt(most)) + 2


def rules_of(scenario: Scenario, queues: list[Queue]) -> DepartureRules:
    """Return how the vehicles of the queues depart."""
    most = max(1, *(len(queue.flows) for queue in queues))
    table = [[departure_of(flow.departure) for flow in queue.flows] for queue in queues]
    subject = departure_of(scenario.demand.subject_departure)
    everybody = [subject, *(one for row in table for one in row)]
    usual = everybody[0]
    rows = [[*row, *[usual] * (most - len(row))] for row in table]
    return DepartureRules(
        lane=jnp.asarray([LANES.get(queue.lane, Lane.FREE) for queue in queues], jnp.int32),
        position=jnp.asarray([[int(one.position) for one in row] for row in rows], jnp.int32),
        position_m=jnp.asarray([[one.position_m for one in row] for row in rows], jnp.float32),
        speed=jnp.asarray([[int(one.speed) for one in row] for row in rows], jnp.int32),
        speed_mps=jnp.asarray([[one.speed_mps for one in row] for row in rows], jnp.float32),
        subject=subject,
        has_random_lanes=any(LANES.get(queue.lane) is Lane.RANDOM for queue in queues),
        has_probable_lanes=any(LANES.get(queue.lane) is Lane.PROBABLE for queue in queues),
        positions=tuple(sorted({one.position for one in everybody})),
        speeds=tuple(sorted({one.speed for one in everybody})),
    )


def _floats(values: list[float], otherwise: float = 0.0) -> Array:
    return jnp.asarray(values or [otherwise], jnp.float32)


def _whole(values: list[int], otherwise: int = 0) -> Array:
    return jnp.asarray(values or [otherwise], jnp.int32)


def entrance_tables(scenario: Scenario, queues: list[Queue]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows of the lanes, which lanes serve which destination, and begin and end of each queue's edge."""
    network = scenario.network
    most = max(network.lane_count[edge] for edge in scenario.entrances)
    lane_row = np.full((len(queues), most), -1)
    serves = np.zeros((len(queues), len(scenario.destinations), most), bool)
    edge_m = np.zeros((len(queues), 2))
    routes = [flow.route for flow in scenario.flows] + [scenario.demand.subject_route]
    for q, queue in enumerate(queues):
        edge = queue.edge
        edge_m[q] = network.edge_start_m(edge), network.edge_end_m(edge)
        for lane in range(network.lane_count[edge]):
            lane_row[q, lane] = scenario.row_map.row_of_lane[(edge, lane)]
        for d, destination in enumerate(scenario.destinations):
            route = next((r for r in routes if r[0] == edge and r[-1] == destination), None)
            if route is not None:
                lanes = lanes_of(network, route, queue.lane or BEST[0])
                serves[q, d, : len(lanes)] = lanes
    return lane_row, serves, edge_m
