"""Everything that drives in a scenario: flows and single vehicles, from SUMO's route and additional files.

A flow of several vTypes or routes (distributions) is read as one part for each, with its share of the rate. Single
vehicles and trips are kept one by one, and dealt the members of theirs, for SUMO draws them; for the surrogate, and for
inputs, those that enter at one edge are a flow whose name is that edge's (`vehicles_id`).
"""

import xml.etree.ElementTree as ET
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.demand_definitions import (
    Definitions,
    FindRoute,
    Route,
    read_route,
    read_vtype,
    routes_of,
    vtypes_of,
)
from sim_adapters.scenario.demand_elements import (
    DEFAULT_VTYPE,
    Departure,
    attribute_of,
    departure_of,
    rate_of,
    time_of,
)
from sim_adapters.scenario.demand_windows import Windows, cut_flows
from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.plain_form import MOVERS, plain_elements
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.scenario.unfollowed import mover_findings

# Elements that move nobody, and those that act on traffic by themselves.
BESIDE = (
    "inductionLoop", "e1Detector", "instantInductionLoop", "laneAreaDetector", "e2Detector", "entryExitDetector",
    "e3Detector", "edgeData", "laneData", "timedEvent", "poly", "polygon", "poi", "routeProbe", "vTypeProbe",
    "busStop", "trainStop", "containerStop", "chargingStation", "parkingArea", "overheadWireSegment",
    "tractionSubstation", "taz", "tazs", "interval", "param", "location", "e3", "viewsettings", "tlLogic", "WAUT",
    "wautJunction", "edgeRelation",
)  # fmt: skip
ACTING = ("rerouter", "calibrator", "variableSpeedSign", "closingReroute")
OTHER_TRAFFIC = ("person", "personFlow", "container", "containerFlow", "personTrip", "walk", "ride")
VEHICLES = "vehicles of "
Member = TypeVar("Member")


def vehicles_id(edge: str) -> str:
    """Name of the flow that stands for the single vehicles which enter at an edge."""
    return f"{VEHICLES}{edge}"


@dataclass(frozen=True)
class Flow:
    """Vehicles of one vType and route that come at one rate."""

    id: str  # SUMO id of the flow; parts of one flow share it
    vtype: str  # vType of its vehicles
    route: Route  # edges
    rate_vehps: float  # vehicles per second, of this part
    is_regular: bool  # whether they come evenly instead of at random
    begin_s: float  # when it begins
    end_s: float  # when it ends
    departure: Departure = field(default_factory=Departure)  # how they depart


@dataclass(frozen=True)
class Vehicle:
    """A single vehicle or trip."""

    id: str
    vtype: str
    route: Route
    depart_s: float
    departure: Departure


@dataclass(frozen=True)
class Demand:
    """Everything that drives."""

    file: Path  # route file of the subject vehicle, for messages
    vtypes: dict[str, dict[str, str]]  # attributes of each vType
    flows: tuple[Flow, ...]  # background traffic that comes at a rate
    vehicles: tuple[Vehicle, ...]  # background vehicles that depart one by one, by departure
    subject_route: Route  # edges of the subject vehicle
    subject_vtype: str
    subject_depart_s: float  # when the file lets it depart
    subject_departure: Departure  # how it departs
    findings: tuple[Finding, ...] = ()  # what else stands in the files
    # edge at which each single vehicle enters, by id, those of the time after the end, too
    entrance_of: Mapping[str, str] = field(default_factory=dict)
    # in which file each element stands, by tag and id, for messages
    files: Mapping[tuple[str, str], Path] = field(default_factory=dict)

    def file_of(self, tag: str, name: str) -> Path:
        """The file in which an element stands; that of the subject vehicle where there is no such element."""
        return self.files.get((tag, name), self.file)

    def file_at(self, edge: str) -> Path:
        """The file with the traffic that enters at an edge."""
        flow = next((flow.id for flow in self.flows if flow.route[0] == edge), None)
        if flow is not None:
            return self.file_of("flow", flow)
        vehicle = next((vehicle.id for vehicle in self.vehicles if vehicle.route[0] == edge), "")
        return self.files.get(("vehicle", vehicle)) or self.file_of("trip", vehicle)


def read_demand(
    files: Sequence[Path],
    subject_vehicle: str,
    begin_s: float,
    end_s: float,
    options: Mapping[str, str] | None = None,
    scale: float = 1.0,
    find_route: FindRoute = lambda origin, destination, via, vtype: None,
    windows: Windows | None = None,
    stated_end_s: float | None = None,
) -> Demand:
    """Read everything that drives.

    Args:
        files: additional files first, then route files, as SUMO loads them.
        subject_vehicle: id of the subject vehicle.
        begin_s: begin of the simulation.
        end_s: end of the simulation, for flows that do not say when they end.
        options: of the configuration, for departures that say nothing.
        scale: SUMO's factor on all demand.
        find_route: finds the edges of trips.
        windows: of time, in which flows have a factor of their own.
        stated_end_s: end of the configuration, over which a flow's number is spread; None where it states none.

    Raises:
        ScenarioError: something is missing, or SUMO would refuse it.
    """
    known, options = Definitions(find_route), options or {}
    others: dict[tuple[str, str], int] = {}
    movers: list[tuple[Path, ET.Element]] = []
    places: dict[tuple[str, str], Path] = {}
    for file in files:
        for element in cut_flows(file, plain_elements(read_xml(file), begin_s, stated_end_s), windows or {}):
            places |= {(one.tag, one.get("id", "")): file for one in (element, *element)}
            if element.tag in ("vType", "vTypeDistribution"):
                read_vtype(known, file, element)
            elif element.tag in ("route", "routeDistribution"):
                read_route(known, file, element)
            elif element.tag in MOVERS:
                movers.append((file, element))
            else:
                key = (file.name, element.tag)
                others[key] = others.get(key, 0) + 1
    flows: list[Flow] = []
    vehicles: list[Vehicle] = []
    subject: tuple[Path, Vehicle] | None = None
    entrance_of: dict[str, str] = {}
    deal = _Dealer()
    for file, element in movers:
        name = attribute_of(file, element, "id")
        if element.tag == "flow":
            flows += _flow_parts(known, file, element, begin_s, end_s, options, scale)
            continue
        depart_s = 0.0 if not _is_timed(element) else time_of(file, element, "depart", 0.0)
        vtypes, routes = vtypes_of(known, file, element), routes_of(known, file, element)
        if name == subject_vehicle and max(len(vtypes), len(routes)) > 1:
            raise ScenarioError(
                file, f"<{element.tag}> '{name}': expected one vType and one route of the subject vehicle; of "
                "distributions SUMO draws another one in each run."
            )  # fmt: skip
        vehicle = Vehicle(name, deal(vtypes), deal(routes), depart_s, departure_of(element, options))
        if name == subject_vehicle:
            subject = (file, vehicle)
            continue
        entrance_of[name] = vehicle.route[0]
        if begin_s <= depart_s < end_s:
            vehicles.append(vehicle)
    if subject is None:
        raise ScenarioError(
            files[-1], f"expected a <vehicle id='{subject_vehicle}'>, the subject vehicle; there is none."
        )
    if not flows and not vehicles:
        raise ScenarioError(files[-1], "expected at least one <flow> or <vehicle> of background traffic.")
    file, ego = subject
    return Demand(
        file=file,
        vtypes=known.vtypes,
        flows=tuple(flows),
        vehicles=tuple(sorted(vehicles, key=lambda vehicle: vehicle.depart_s)),
        subject_route=ego.route,
        subject_vtype=ego.vtype,
        subject_depart_s=ego.depart_s,
        subject_departure=ego.departure,
        findings=(*(_finding(*key, count) for key, count in others.items()), *mover_findings(movers)),
        entrance_of=entrance_of,
        files=places,
    )


class _Dealer:
    """Deals the members of distributions to vehicles, each as often as its share says, in the order of the files."""

    def __init__(self) -> None:
        self._dealt: dict[Hashable, list[float]] = {}

    def __call__(self, members: Sequence[tuple[Member, float]]) -> Member:
        """Return the member of which the most is missing."""
        owed = self._dealt.setdefault(tuple(members), [0.0] * len(members))
        for number, (_, share) in enumerate(members):
            owed[number] += share
        chosen = max(range(len(members)), key=owed.__getitem__)
        owed[chosen] -= 1.0
        return members[chosen][0]


def trips_without_edges(files: Sequence[Path]) -> list[tuple[str, str, Route, str]]:
    """Origin, destination, via and vType of all flows and trips whose edges only SUMO's router knows."""
    found = {}
    for file in files:
        for element in plain_elements(read_xml(file), 0.0, None):
            if element.tag in MOVERS and element.get("from") and element.get("to"):
                via = tuple((element.get("via") or "").split())
                key = (element.get("from", ""), element.get("to", ""), via, element.get("type") or DEFAULT_VTYPE)
                found[key] = None
    return list(found)


def _flow_parts(
    known: Definitions,
    file: Path,
    element: ET.Element,
    begin_s: float,
    end_s: float,
    options: Mapping[str, str],
    scale: float,
) -> list[Flow]:
    rate = rate_of(file, element, begin_s, end_s)
    departure, name = departure_of(element, options), element.get("id", "")
    parts = []
    for vtype, vtype_share in vtypes_of(known, file, element):
        own = float(known.vtypes[vtype].get("scale", "1"))
        for route, route_share in routes_of(known, file, element):
            vehps = rate.vehps * vtype_share * route_share * scale * own
            parts.append(Flow(name, vtype, route, vehps, rate.is_regular, rate.begin_s, rate.end_s, departure))
    return parts


def _is_timed(element: ET.Element) -> bool:
    return (element.get("depart") or "0")[:1] not in "tcs"  # triggered, containerTriggered, split, begin


def _finding(file: str, tag: str, count: int) -> Finding:
    if tag in BESIDE:
        return Finding(Level.BESIDE, file, f"<{tag}>", "", count)
    if tag in OTHER_TRAFFIC:
        return Finding(Level.BESIDE, file, f"<{tag}>", "SUMO moves it; nobody on the route meets it", count)
    words = "the surrogate does without; SUMO runs with it"
    return Finding(Level.APPROXIMATED, file, f"<{tag}>", words, count)
