"""An ordinary SUMO scenario, read for both simulators."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.demand_file import Demand, Flow, read_demand
from sim_adapters.scenario.road_builder import RowMap, lay_rows
from sim_adapters.scenario.route_network import RouteNetwork, read_route_network
from sim_adapters.scenario.sumo_files import SumoConfiguration, read_configuration, read_xml
from sim_adapters.scenario.sumo_names import SUMO_MODELS, attribute_values


@dataclass(frozen=True)
class Scenario:
    """A road with its traffic.

    Attributes:
        configuration: what the .sumocfg says.
        demand: vTypes, routes, flows, subject vehicle.
        network: lanes along the subject vehicle's route.
        row_map: rows of the surrogate.
        entrances: first edges of the flows that reach the route, the subject vehicle's first.
        destinations: last edges of these flows, the subject vehicle's first.
        destination_routes: for each destination the edges from the beginning of the carriageway to the end.
        flows: flows that use the subject vehicle's route.
        warnings: one line for each thing that was left out.
    """

    configuration: SumoConfiguration
    demand: Demand
    network: RouteNetwork
    row_map: RowMap
    entrances: tuple[str, ...]
    destinations: tuple[str, ...]
    destination_routes: tuple[tuple[str, ...], ...]
    flows: tuple[Flow, ...]
    warnings: tuple[str, ...]

    @property
    def flow_by_id(self) -> Mapping[str, Flow]:
        """Flows by their SUMO id."""
        return {flow.id: flow for flow in self.flows}

    def model_of(self, vtype: str) -> str:
        """Return the car-following model of a vType.

        Raises:
            ScenarioError: the surrogate does not have it.
        """
        model = self.demand.vtypes[vtype].get("carFollowModel", "Krauss")
        if model not in SUMO_MODELS:
            raise ScenarioError(
                self.demand.file,
                f"vType '{vtype}': carFollowModel: expected one of {', '.join(SUMO_MODELS)}, got '{model}'.",
            )
        return model

    def values_of(self, vtype: str) -> dict[str, float]:
        """Return every attribute of a vType as a number.

        Raises:
            ScenarioError: one is not a number.
        """
        try:
            return attribute_values(self.demand.vtypes[vtype], self.model_of(vtype))
        except ValueError as error:
            raise ScenarioError(self.demand.file, f"vType '{vtype}': {error}.") from None


def read_scenario(config: Path, folder: Path, subject_vehicle: str, duration_s: float) -> Scenario:
    """Read a scenario.

    Args:
        config: the .sumocfg.
        folder: the case's folder, which no path may leave.
        subject_vehicle: id of the subject vehicle.
        duration_s: length of a run.

    Raises:
        ScenarioError: something is missing, or cannot be represented; one line says what.
    """
    configuration = read_configuration(config, folder)
    for option in ("lateral-resolution", "step-method.ballistic"):
        value = configuration.processing.get(option, "0").lower()
        if value not in ("0", "0.0", "false", ""):
            raise ScenarioError(config, f"option '{option}' = {value}: expected SUMO's default lane-based Euler model.")
    files = [*configuration.additional_files, *configuration.route_files]
    demand = read_demand(files, subject_vehicle, configuration.end_s or duration_s)
    read_xml(configuration.net_file)  # refuses what sumolib would read without a word
    main_edges = demand.subject_route
    network = read_route_network(configuration.net_file, main_edges, [flow.route for flow in demand.flows])
    flows = tuple(flow for flow in demand.flows if any(edge in main_edges for edge in flow.route))
    warnings = list(configuration.ignored)
    if len(flows) < len(demand.flows):
        warnings.append(f"{demand.file.name}: {len(demand.flows) - len(flows)} flows never meet the route; left out.")
    for option in ("default.action-step-length", "lanechange.overtake-right"):
        if configuration.processing.get(option, "0").lower() not in ("0", "0.0", "false"):
            warnings.append(f"{config.name}: {option}: the surrogate does without; SUMO confirms with it.")
    for vtype, attributes in demand.vtypes.items():
        if "actionStepLength" in attributes:
            warnings.append(f"vType '{vtype}': actionStepLength: the surrogate does without; SUMO confirms with it.")
    entrances = _unique([main_edges[0], *(flow.route[0] for flow in flows)])
    destinations = _unique([main_edges[-1], *(flow.route[-1] for flow in flows)])
    routes = tuple(_whole_route(network, destination, flows) for destination in destinations)
    scenario = Scenario(
        configuration=configuration,
        demand=demand,
        network=network,
        row_map=lay_rows(network),
        entrances=entrances,
        destinations=destinations,
        destination_routes=routes,
        flows=flows,
        warnings=tuple(warnings),
    )
    for vtype in _unique([*(flow.vtype for flow in flows), demand.subject_vtype]):
        scenario.values_of(vtype)
    _refuse_mixed_windows(scenario)
    return scenario


def _whole_route(network: RouteNetwork, destination: str, flows: tuple[Flow, ...]) -> tuple[str, ...]:
    """Return the edges from the beginning of the carriageway to a destination."""
    main = network.main_edges
    if destination in main:
        return main[: main.index(destination) + 1]
    route = next(flow.route for flow in flows if flow.route[-1] == destination)
    last_main = max(index for index, edge in enumerate(route) if edge in main)
    return (*main[: main.index(route[last_main]) + 1], *route[last_main + 1 :])


def _refuse_mixed_windows(scenario: Scenario) -> None:
    for entrance in scenario.entrances:
        windows = {(flow.begin_s, flow.end_s) for flow in scenario.flows if flow.route[0] == entrance}
        if len(windows) > 1:
            raise ScenarioError(
                scenario.demand.file,
                f"flows from edge '{entrance}': expected one begin and end for all, got {windows}.",
            )


def _unique(names: list[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))
