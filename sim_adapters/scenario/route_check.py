"""Whether routes can be driven: all their edges are there, and lead into one another."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.demand_definitions import Route


@dataclass(frozen=True)
class RouteUser:
    """Who drives along a route."""

    file: Path  # where they stand
    element: str  # the first of them
    count: int  # how many flows, vehicles and trips they are


def refuse_broken(net: Any, file: Path, routes: Sequence[Route], users: Mapping[Route, RouteUser]) -> None:
    """Refuse routes that cannot be driven.

    Args:
        net: sumolib's network.
        file: its file.
        routes: edges of each route.
        users: who drives along them.

    Raises:
        ScenarioError: there is one; `others` holds an error for each further one.
    """
    errors = []
    for route in routes:
        words = _broken(net, file, route)
        if words is None:
            continue
        user = users.get(route)
        if user is None:
            errors.append(ScenarioError(file, f"route '{route_ends(route)}': {words}"))
        else:
            more = f" (and {user.count - 1} more)" if user.count > 1 else ""
            errors.append(ScenarioError(user.file, f"{user.element}{more}: route '{route_ends(route)}': {words}"))
    if errors:
        errors[0].others = tuple(errors[1:])
        raise errors[0]


def _broken(net: Any, file: Path, route: Route) -> str | None:
    for edge in route:
        if not net.hasEdge(edge):
            return f"expected edges of the network, got '{edge}', which {file.name} does not have."
    for edge, following in pairwise(route):
        if net.getEdge(following) not in net.getEdge(edge).getOutgoing():
            return (
                f"expected a connection from edge '{edge}' to '{following}'; there is none, and vehicles would stand "
                "there. Mend the route, or leave it out."
            )
    return None


def route_ends(route: Sequence[str]) -> str:
    """A route's first and last edges, for messages."""
    return " ".join(route if len(route) <= 4 else (*route[:2], "...", *route[-2:]))
