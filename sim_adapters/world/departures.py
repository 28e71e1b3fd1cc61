"""SUMO's words for how vehicles depart, as the surrogate knows them."""

from collections.abc import Sequence

import numpy as np

from sim_adapters.scenario.best_lanes import LOOK_AHEAD_M, best_lanes
from sim_adapters.scenario.demand_elements import Departure
from sim_adapters.scenario.route_network import RouteNetwork
from surrogate.inflow import departure as surrogate_departure
from surrogate.inflow.departure import Lane, Position, Speed

POSITIONS = {
    "base": Position.BASE,
    "stop": Position.BASE,  # as SUMO does where the vehicle has no stop on the lane
    "last": Position.LAST,
    "free": Position.FREE,
    "random": Position.RANDOM,
    "random_free": Position.RANDOM_FREE,
}
SPEEDS = {
    "max": Speed.MAX,
    "desired": Speed.DESIRED,
    "speedLimit": Speed.LIMIT,
    "last": Speed.LAST,
    "avg": Speed.AVERAGE,
    "random": Speed.RANDOM,
}
LANES = {"best_prob": Lane.PROBABLE, "random": Lane.RANDOM}  # others take the one with most room
BEST = ("best", "best_prob")


def departure_of(words: Departure) -> surrogate_departure.Departure:
    """Return what departPos and departSpeed say; words that SUMO does not know are its defaults."""
    position, position_m = POSITIONS.get(words.position), _number(words.position)
    speed, speed_mps = SPEEDS.get(words.speed), _number(words.speed)
    return surrogate_departure.Departure(
        position=position if position is not None else Position.BASE if position_m is None else Position.GIVEN,
        position_m=position_m or 0.0,
        speed=speed if speed is not None else Speed.AVERAGE if speed_mps is None else Speed.GIVEN,
        speed_mps=speed_mps or 0.0,
    )


def lanes_of(network: RouteNetwork, route: Sequence[str], lane: str) -> np.ndarray:
    """Return which lanes of a route's first edge a vehicle may enter by its departLane.

    Source: `MSEdge::getDepartLane`.
    """
    lanes = network.edge_lanes(route[0])
    is_open = np.asarray([one.is_open for one in lanes])
    is_open = is_open if is_open.any() else np.ones(len(lanes), bool)
    if lane.isdecimal():
        return np.arange(len(lanes)) == int(lane)
    if lane == "first":
        return np.arange(len(lanes)) == np.argmax(is_open)
    if lane in BEST:
        lengths = [outlook.length_m for outlook in best_lanes(network, route)]
        enough = min(LOOK_AHEAD_M, max(lengths)) - 1e-6
        return np.asarray([length >= enough for length in lengths])
    if lane == "allowed" and len(route) > 1:
        leads_on = np.asarray([any(edge == route[1] for edge, _ in one.successors) for one in lanes])
        return is_open & leads_on if (is_open & leads_on).any() else is_open
    return is_open


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
