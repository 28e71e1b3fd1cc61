"""An ordinary SUMO scenario, read for both simulators."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.configuration import SumoConfiguration, read_configuration
from sim_adapters.scenario.demand_definitions import Route
from sim_adapters.scenario.demand_file import VEHICLES, Demand, Flow, read_demand
from sim_adapters.scenario.demand_windows import Windows
from sim_adapters.scenario.finding import Finding, Level
from sim_adapters.scenario.followed_options import flow_findings, option_findings, vtype_findings
from sim_adapters.scenario.loaded_scenario import LoadedScenario
from sim_adapters.scenario.road_builder import RowMap, lay_rows
from sim_adapters.scenario.route_check import RouteUser
from sim_adapters.scenario.route_network import RouteNetwork, read_route_network
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.scenario.sumo_names import attribute_values, nearest_model
from sim_adapters.scenario.unfollowed import road_findings
from sim_adapters.scenario.vehicle_flows import flows_of_vehicles

DEFAULT_MODEL = "Krauss"
Vtypes = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class Scenario:
    """A road with its traffic."""

    configuration: SumoConfiguration  # what the .sumocfg says
    demand: Demand  # vTypes, routes, flows, vehicles, subject vehicle
    network: RouteNetwork  # lanes along the subject vehicle's route
    row_map: RowMap  # rows of the surrogate
    entrances: tuple[str, ...]  # first edges of the flows that reach the route, the subject vehicle's first
    destinations: tuple[str, ...]  # last edges of these flows, the subject vehicle's first
    # for each destination the edges from the beginning of the carriageway to the end
    destination_routes: tuple[Route, ...]
    flows: tuple[Flow, ...]  # flows that use the subject vehicle's route; single vehicles as flows of their edge
    end_s: float  # end of a run, on the scenario's clock
    # numeric attributes of vTypes as SUMO has them, defaults of their class included
    vtype_numbers: Vtypes = field(default_factory=dict)
    windows: Windows = field(default_factory=dict)  # windows of time that cut flows
    findings: tuple[Finding, ...] = ()  # how well each part can be followed by the surrogate
    warnings: tuple[str, ...] = ()  # one line for each thing that was left out

    @property
    def flow_ids(self) -> tuple[str, ...]:
        """Ids of the flows, each once."""
        return tuple(dict.fromkeys(flow.id for flow in self.flows))

    def parts_of(self, flow: str) -> tuple[Flow, ...]:
        """The parts of a flow: one for each vType, route and window of time."""
        return tuple(part for part in self.flows if part.id == flow)

    def mean_rate_vehps(self, flow: str) -> float:
        """Vehicles of a flow per second, over the time in which it comes at all."""
        parts = self.parts_of(flow)
        if len({(part.begin_s, part.end_s) for part in parts}) == 1:
            return sum(part.rate_vehps for part in parts)
        vehicles = sum(part.rate_vehps * (part.end_s - part.begin_s) for part in parts)
        return vehicles / max(max(part.end_s for part in parts) - min(part.begin_s for part in parts), 1e-9)

    @property
    def is_left_to_sumo(self) -> bool:
        """Whether the surrogate cannot follow this road or traffic at all."""
        return any(finding.level is Level.SUMO_ALONE for finding in self.findings)

    def model_of(self, vtype: str) -> str:
        """Car-following model of a vType, or the nearest one that the surrogate has."""
        return nearest_model(self.demand.vtypes[vtype].get("carFollowModel", DEFAULT_MODEL))

    def values_of(self, vtype: str) -> dict[str, float]:
        """Every attribute of a vType as a number.

        Raises:
            ScenarioError: one is not a number.
        """
        try:
            return attribute_values(self.demand.vtypes[vtype], self.model_of(vtype), self.vtype_numbers.get(vtype))
        except ValueError as error:
            raise ScenarioError(self.demand.file_of("vType", vtype), f"vType '{vtype}': {error}.") from None


def read_scenario(
    config: Path,
    subject_vehicle: str,
    duration_s: float,
    load: Callable[[SumoConfiguration], LoadedScenario] | None = None,
    windows: Windows | None = None,
) -> Scenario:
    """Read a scenario.

    Args:
        config: the .sumocfg.
        subject_vehicle: id of the subject vehicle.
        duration_s: end of a run, on the scenario's clock.
        load: has SUMO load the scenario and say what its vTypes are and how trips go; without it, types take the
            defaults of passenger cars and trips are refused.
        windows: windows of time, by flow, each of which becomes a flow `FLOW@BEGIN` of its own.

    Raises:
        ScenarioError: SUMO refuses it, or something is missing; one line says what.
    """
    configuration = read_configuration(config)
    road = read_xml(configuration.net_file)
    is_left_hand = road.get("lefthand", "false").lower() in ("true", "1", "yes", "on", "x")
    loaded = load(configuration) if load else LoadedScenario()
    end_s = duration_s if configuration.end_s is None else min(configuration.end_s, duration_s)
    demand = read_demand(
        [*configuration.additional_files, *configuration.route_files],
        subject_vehicle,
        configuration.begin_s,
        end_s,
        configuration.processing,
        configuration.scale,
        loaded.find_route,
        windows,
        configuration.end_s,
    )
    singles = flows_of_vehicles(demand.vehicles, configuration.begin_s, end_s, configuration.scale, windows or {})
    all_flows = (*demand.flows, *singles)
    main_edges = demand.subject_route
    vclasses = {demand.vtypes[flow.vtype].get("vClass", "passenger") for flow in all_flows}
    routes, users = [flow.route for flow in all_flows], _users(demand, subject_vehicle)
    network = read_route_network(configuration.net_file, main_edges, routes, sorted(vclasses), users, is_left_hand)
    flows = tuple(flow for flow in all_flows if any(edge in main_edges for edge in flow.route))
    warnings = [*configuration.ignored, *loaded.warnings]
    if len(flows) < len(all_flows):
        warnings.append(f"{demand.file.name}: {len(all_flows) - len(flows)} flows never meet the route; left out.")
    if not flows:
        raise ScenarioError(demand.file, "expected background traffic on the subject vehicle's route; there is none.")
    entrances = _unique([main_edges[0], *(flow.route[0] for flow in flows)])
    destinations = _unique([main_edges[-1], *(flow.route[-1] for flow in flows)])
    scenario = Scenario(
        configuration=configuration,
        demand=demand,
        network=network,
        row_map=lay_rows(network),
        entrances=entrances,
        destinations=destinations,
        destination_routes=tuple(_whole_route(network, destination, flows) for destination in destinations),
        flows=flows,
        end_s=end_s,
        vtype_numbers=loaded.vtypes,
        windows=windows or {},
        warnings=tuple(warnings),
    )
    vtypes = _unique([*(flow.vtype for flow in flows), demand.subject_vtype])
    for vtype in vtypes:
        scenario.values_of(vtype)
    findings = [
        *option_findings(configuration),
        *vtype_findings(demand, vtypes),
        *flow_findings(demand, flows),
        *demand.findings,
        *network.findings,
        *road_findings(configuration.net_file, road, network.lane_count, vclasses),
    ]
    if is_left_hand:
        words = (
            "left-hand traffic, mirrored; lane 1 of the logs is the rightmost, the network's last"
            if network.is_left_hand
            else "left-hand traffic; lanes are drawn from the right, and taken so"
        )
        findings.append(Finding(Level.FOLLOWED, configuration.net_file.name, "attribute 'lefthand' of <net>", words))
    return replace(scenario, findings=tuple(_placed(demand, finding) for finding in findings))


def _users(demand: Demand, subject_vehicle: str) -> dict[Route, RouteUser]:
    """Who drives along each route."""
    ids: dict[Route, dict[tuple[str, str], None]] = {}
    subject = (demand.subject_route, [("vehicle", subject_vehicle)])
    flows = [(flow.route, [("flow", flow.id)]) for flow in demand.flows]
    vehicles = [(vehicle.route, [("vehicle", vehicle.id)]) for vehicle in demand.vehicles]
    for route, names in (subject, *flows, *vehicles):
        ids.setdefault(route, {}).update(dict.fromkeys(names))
    users = {}
    for route, several in ids.items():
        tag, name = next(iter(several))
        file = demand.files.get((tag, name)) or demand.file_of("trip", name)
        users[route] = RouteUser(file, f"{tag} '{name}'", len(several))
    return users


def _placed(demand: Demand, finding: Finding) -> Finding:
    """A finding on vTypes or traffic with the file in which these stand."""
    named = re.fullmatch(rf"(vType|flow|flows from edge) '({VEHICLES})?(.*)'", finding.element)
    if named is None:
        return finding
    tag, is_of_vehicles, name = named.groups()
    by_edge = tag == "flows from edge" or is_of_vehicles
    return replace(finding, file=(demand.file_at(name) if by_edge else demand.file_of(tag, name)).name)


def _whole_route(network: RouteNetwork, destination: str, flows: Sequence[Flow]) -> Route:
    """The edges from the beginning of the carriageway to a destination."""
    main = network.main_edges
    if destination in main:
        return main[: main.index(destination) + 1]
    route = next(flow.route for flow in flows if flow.route[-1] == destination)
    last_main = max(index for index, edge in enumerate(route) if edge in main)
    return (*main[: main.index(route[last_main]) + 1], *route[last_main + 1 :])


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))
