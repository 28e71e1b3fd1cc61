"""What flows and vehicles refer to: vTypes, routes, distributions of both, and ways that SUMO's router finds."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.demand_elements import DEFAULT_VTYPE, attribute_of, members_of

Route = tuple[str, ...]
# A trip's edges, as SUMO's router finds them: from, to, via, vType.
FindRoute = Callable[[str, str, Route, str], Route | None]


@dataclass
class Definitions:
    """What has been defined so far, in the order of the files.

    Attributes:
        find_route: finds the edges of trips.
        vtypes: attributes of each vType.
        vtype_mixes: distributions of vTypes: ids and shares.
        routes: routes by id.
        route_mixes: distributions of routes.
    """

    find_route: FindRoute
    vtypes: dict[str, dict[str, str]] = field(default_factory=lambda: {DEFAULT_VTYPE: {"id": DEFAULT_VTYPE}})
    vtype_mixes: dict[str, list[tuple[str, float]]] = field(default_factory=dict)
    routes: dict[str, Route] = field(default_factory=dict)
    route_mixes: dict[str, list[tuple[Route, float]]] = field(default_factory=dict)


def read_vtype(known: Definitions, file: Path, element: ET.Element) -> None:
    """Keep a vType, or a distribution of them."""
    name = attribute_of(file, element, "id")
    if element.tag == "vType":
        known.vtypes[name] = dict(element.attrib)
        return
    mix = []
    for member, share, inner in members_of(element, "vType", lambda vtype: _own_share(known, vtype)):
        if inner is not None and inner.get("id"):
            read_vtype(known, file, inner)
        if member not in known.vtypes:
            raise ScenarioError(file, f"vTypeDistribution '{name}': expected the id of a vType, got '{member}'.")
        mix.append((member, share))
    if not mix:
        raise ScenarioError(file, f"vTypeDistribution '{name}': expected vTypes; there are none.")
    known.vtype_mixes[name] = mix


def _own_share(known: Definitions, vtype: str) -> float:
    return float(known.vtypes.get(vtype, {}).get("probability") or 1.0)


def read_route(known: Definitions, file: Path, element: ET.Element) -> None:
    """Keep a route, or a distribution of them."""
    if element.tag == "route":
        known.routes[attribute_of(file, element, "id")] = tuple(attribute_of(file, element, "edges").split())
        return
    known.route_mixes[attribute_of(file, element, "id")] = _route_mix(known, file, element)


def _route_mix(known: Definitions, file: Path, element: ET.Element) -> list[tuple[Route, float]]:
    mix = []
    for member, share, inner in members_of(element, "route"):
        if inner is not None and inner.get("edges"):
            route = tuple(inner.get("edges", "").split())
            if inner.get("id"):
                known.routes[inner.get("id", "")] = route
        elif member in known.routes:
            route = known.routes[member]
        else:
            raise ScenarioError(
                file, f"routeDistribution '{element.get('id', '')}': expected the id of a route, got '{member}'."
            )
        mix.append((route, share))
    if not mix:
        raise ScenarioError(file, f"routeDistribution '{element.get('id', '')}': expected routes; there are none.")
    return mix


def vtypes_of(known: Definitions, file: Path, element: ET.Element) -> list[tuple[str, float]]:
    """The vTypes of a mover and their shares."""
    name = element.get("type") or DEFAULT_VTYPE
    if name in known.vtype_mixes:
        total = sum(share for _, share in known.vtype_mixes[name])
        return [(vtype, share / total) for vtype, share in known.vtype_mixes[name] if share > 0.0]
    if name not in known.vtypes:
        raise ScenarioError(
            file, f"<{element.tag}> '{element.get('id')}': type: expected the id of a vType, got '{name}'."
        )
    return [(name, 1.0)]


def routes_of(known: Definitions, file: Path, element: ET.Element) -> list[tuple[Route, float]]:
    """The routes of a mover and their shares."""
    inner = element.find("route")
    mix = element.find("routeDistribution")
    name = element.get("route", "")
    if inner is not None:
        return [(tuple(attribute_of(file, inner, "edges").split()), 1.0)]
    if mix is not None or name in known.route_mixes:
        routes = known.route_mixes[name] if mix is None else _route_mix(known, file, mix)
        total = sum(share for _, share in routes)
        return [(route, share / total) for route, share in routes if share > 0.0]
    if name in known.routes:
        return [(known.routes[name], 1.0)]
    origin, destination = element.get("from"), element.get("to")
    what = f"<{element.tag}> '{element.get('id')}'"
    if not name and origin and destination:
        vtype = element.get("type") or DEFAULT_VTYPE  # SUMO's router takes a distribution's name, too
        route = known.find_route(origin, destination, tuple((element.get("via") or "").split()), vtype)
        if route is None:
            raise ScenarioError(
                file, f"{what}: expected a way from edge '{origin}' to '{destination}'; SUMO finds none."
            )
        return [(route, 1.0)]
    if not name:
        raise ScenarioError(file, f"{what}: expected a route, or the edges 'from' and 'to'.")
    raise ScenarioError(file, f"{what}: route: expected the id of a route, got '{name}'.")
