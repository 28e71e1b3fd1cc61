"""What neither scenario nor logs say, guessed from both."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jaxcalib.case.log_form import LogForm
from jaxcalib.field.map_matching import match_points
from jaxcalib.field.route_geometry import RouteGeometry
from jaxcalib.new_case.recorded_drives import RecordedDrive, put_at
from jaxcalib.problem.inputs import found_inputs
from sim_adapters.scenario.configuration import SumoConfiguration
from sim_adapters.scenario.scenario import DEFAULT_MODEL, Scenario
from sim_adapters.units import vehph_from_vehps

LEAST_WARMUP_S = 300.0
USUAL_WARMUP_S = 600.0  # before drives of another clock
LATEST_S = 1e6  # on a scenario's clock that has no end: eleven days
USUAL_RANGE_M = 150.0
ROUNDED_M = 10.0
LEAST_SPEED_MPS = 5.0
LIKE_LENGTH = 0.3  # trucks are often told from cars by nothing but their length
NEAR_BEGIN_M = 50.0  # a drive whose log begins so near to its entrance begins with its departure
AT_BEGIN = ("base", "0", "")


@dataclass(frozen=True)
class Entrance:
    """An entrance, its flows, and what enters there in the scenario."""

    id: str
    flows: tuple[str, ...]
    rate_vehph: float


@dataclass(frozen=True)
class Drivers:
    """The vTypes to calibrate, their car-following model, and those that keep their values."""

    vtypes: tuple[str, ...]
    car_following: str
    others: tuple[str, ...]


def entrances_of(scenario: Scenario) -> list[Entrance]:
    """The entrances of the route at which vehicles come."""
    return [
        Entrance(one.id, one.flows, float(vehph_from_vehps(sum(map(scenario.mean_rate_vehps, one.flows)))))
        for one in found_inputs(scenario)
    ]


def drivers_of(scenario: Scenario) -> Drivers:
    """The vTypes by which most of the route's vehicles drive: of one model and vehicle class, and about as long."""
    vehicles: dict[str, float] = {}
    for flow in scenario.flows:
        vehicles[flow.vtype] = vehicles.get(flow.vtype, 0.0) + flow.rate_vehps * max(flow.end_s - flow.begin_s, 0.0)
    by_number = sorted(vehicles, key=lambda vtype: -vehicles[vtype])
    groups: dict[tuple[str, str], list[str]] = {}
    for vtype in by_number:
        attributes = scenario.demand.vtypes[vtype]
        key = (attributes.get("carFollowModel", DEFAULT_MODEL), attributes.get("vClass", "passenger"))
        groups.setdefault(key, []).append(vtype)
    model, vclass = max(groups, key=lambda key: sum(vehicles[vtype] for vtype in groups[key]))
    lengths_m = {vtype: scenario.values_of(vtype)["length"] for vtype in groups[(model, vclass)]}
    usual_m = lengths_m[groups[(model, vclass)][0]]
    chosen = [vtype for vtype, length_m in lengths_m.items() if abs(length_m - usual_m) <= LIKE_LENGTH * usual_m]
    return Drivers(tuple(chosen), model, tuple(vtype for vtype in by_number if vtype not in chosen))


def filling_s(scenario: Scenario, drives: Sequence[RecordedDrive]) -> float:
    """Time in which a vehicle gets from the farthest entrance to the route's end, at the speed of the logs."""
    network = scenario.network
    begin_m = min(network.edge_start_m(edge) for edge in (*network.main_edges, *network.ramp_edges))
    driven_m, took_s = (sum(parts) for parts in zip(*((d.driven_m, d.end_s - d.begin_s) for d in drives), strict=True))
    return (network.length_m - begin_m) / max(driven_m / max(took_s, 1e-9), LEAST_SPEED_MPS)


def warmup_s(begin_s: float, first_depart_s: float, filling: float) -> float:
    """End of the warm-up: when the road is filled, some minutes at least, and not after the first drive's departure."""
    return min(begin_s + max(LEAST_WARMUP_S, math.ceil(filling)), first_depart_s)


def on_scenario_clock(
    drives: Sequence[RecordedDrive], configuration: SumoConfiguration, form: LogForm
) -> tuple[RecordedDrive, ...]:
    """Drives on the scenario's clock: logs with times beyond it begin when its road may be filled, each for itself."""
    begin_s, end_s = configuration.begin_s, configuration.end_s
    latest_s = LATEST_S if end_s is None else end_s
    if all(begin_s <= drive.begin_s and drive.end_s <= latest_s for drive in drives):
        return tuple(drives)
    longest_s = max(drive.end_s - drive.begin_s for drive in drives)
    first_s = begin_s + USUAL_WARMUP_S
    if end_s is not None:
        first_s = max(begin_s, min(first_s, end_s - 2.0 * longest_s))
    return tuple(put_at(drive, first_s, form) for drive in drives)


def depart_s(scenario: Scenario, geometry: RouteGeometry, drive: RecordedDrive) -> float:
    """When a drive departs: with its first row, or as much earlier as it takes from about the entrance to there."""
    lead_s = 0.0
    place = drive.log.place
    rows = np.flatnonzero(~place.is_missing & ~np.isnan(drive.log.speed_mps))[:1]
    if len(rows) and (place.kind != "globe" or geometry.has_projection):
        xy = place.points(geometry, rows)
        if np.isfinite(xy).all():
            position_m = float(match_points(geometry, xy).position_m[0])
            is_at_begin = scenario.demand.subject_departure.position in AT_BEGIN
            first_m = NEAR_BEGIN_M if is_at_begin else max(NEAR_BEGIN_M, float(geometry.edge_end_m[0]))
            if position_m > first_m:
                lead_s = (position_m - first_m) / max(float(drive.log.speed_mps[rows[0]]), LEAST_SPEED_MPS)
    return max(float(math.floor(drive.begin_s - lead_s)), scenario.configuration.begin_s)


def end_s(drives: Sequence[RecordedDrive]) -> float:
    """When runs may end: as long after the last row as the longest drive takes, for simulated drives may be slower."""
    longest_s = max(drive.end_s - drive.begin_s for drive in drives)
    return math.ceil((max(drive.end_s for drive in drives) + longest_s) / 10.0) * 10.0


def range_m(farthest_m: Sequence[float]) -> float | None:
    """Range of the sensors from the farthest objects of drives; None where none was seen."""
    farthest = max(farthest_m)
    return ROUNDED_M * math.ceil(farthest / ROUNDED_M) if farthest > 0.0 else None
