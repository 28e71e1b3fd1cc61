"""The vTypes, routes and flows of a scenario, read from SUMO's route and additional files."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.units import vehps_from_vehph

HARMLESS_ELEMENTS = ("vType", "vTypeDistribution", "route", "flow", "vehicle", "param")


@dataclass(frozen=True)
class Flow:
    """A stream of vehicles with one route.

    Attributes:
        id: SUMO id.
        vtype: vType of its vehicles.
        route: edges.
        rate_vehps: vehicles per second.
        is_regular: whether they come evenly instead of at random.
        begin_s: when it begins.
        end_s: when it ends.
    """

    id: str
    vtype: str
    route: tuple[str, ...]
    rate_vehps: float
    is_regular: bool
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Demand:
    """Everything that drives.

    Attributes:
        file: route file, for messages.
        vtypes: attributes of each vType.
        flows: background traffic.
        subject_route: edges of the subject vehicle.
        subject_vtype: its vType.
        subject_depart_s: when the file lets it depart.
    """

    file: Path
    vtypes: dict[str, dict[str, str]]
    flows: tuple[Flow, ...]
    subject_route: tuple[str, ...]
    subject_vtype: str
    subject_depart_s: float


def read_demand(files: Sequence[Path], subject_vehicle: str, end_s: float) -> Demand:
    """Read vTypes, routes and flows.

    Args:
        files: additional files first, then route files, as SUMO loads them.
        subject_vehicle: id of the subject vehicle.
        end_s: end of the simulation, for flows that do not say when they end.

    Raises:
        ScenarioError: something is missing, or the traffic has something that cannot be represented.
    """
    vtypes: dict[str, dict[str, str]] = {}
    routes: dict[str, tuple[str, ...]] = {}
    flow_elements: list[tuple[Path, ET.Element]] = []
    subject: tuple[Path, ET.Element] | None = None
    for file in files:
        for element in read_xml(file):
            if element.tag == "vType":
                vtypes[_get(file, element, "id")] = dict(element.attrib)
            elif element.tag == "vTypeDistribution":
                name = element.get("id", "")
                raise ScenarioError(file, f"vTypeDistribution '{name}': expected plain vTypes; write one per share.")
            elif element.tag == "route":
                routes[_get(file, element, "id")] = tuple(_get(file, element, "edges").split())
            elif element.tag == "flow":
                flow_elements.append((file, element))
            elif element.tag in ("vehicle", "trip") and element.get("id") == subject_vehicle:
                subject = (file, element)
            elif element.tag not in HARMLESS_ELEMENTS or element.tag == "vehicle":
                name = element.get("id", "")
                raise ScenarioError(
                    file, f"<{element.tag}> '{name}': expected vTypes, routes, flows and the subject vehicle only."
                )
    if subject is None:
        raise ScenarioError(
            files[-1], f"expected a <vehicle id='{subject_vehicle}'>, the subject vehicle; there is none."
        )
    flows = tuple(_flow(file, element, routes, vtypes, end_s) for file, element in flow_elements)
    if not flows:
        raise ScenarioError(files[-1], "expected at least one <flow> of background traffic.")
    file, element = subject
    vtype = _known_vtype(file, element, vtypes)
    route = _route(file, element, routes)
    return Demand(file, vtypes, flows, route, vtype, _number(file, element, "depart", element.get("depart", "0")))


def _flow(
    file: Path,
    element: ET.Element,
    routes: dict[str, tuple[str, ...]],
    vtypes: dict[str, dict[str, str]],
    end_s: float,
) -> Flow:
    name = _get(file, element, "id")
    begin_s = _number(file, element, "begin", element.get("begin", "0"))
    until_s = _number(file, element, "end", element.get("end", str(end_s)))
    rate, is_regular = _rate(file, element, begin_s, until_s)
    for option, expected in (("departLane", "best"), ("departPos", "last"), ("departSpeed", "avg")):
        found = element.get(option, "")
        if found != expected:
            raise ScenarioError(
                file, f"flow '{name}': {option}: expected '{expected}', which the surrogate follows, got '{found}'."
            )
    vtype, route = _known_vtype(file, element, vtypes), _route(file, element, routes)
    return Flow(name, vtype, route, rate, is_regular, begin_s, until_s)


def _rate(file: Path, element: ET.Element, begin_s: float, end_s: float) -> tuple[float, bool]:
    """Return vehicles per second, and whether they come evenly."""
    name = element.get("id")
    period = element.get("period") or element.get("vehsPerHour") or ""
    if (element.get("vehsPerHour") or "").strip().startswith("exp"):
        raise ScenarioError(file, f"flow '{name}': vehsPerHour: expected a number; SUMO knows exp(...) in period only.")
    random = re.fullmatch(r"exp\(([^)]*)\)", period.strip())
    if random:
        return _number(file, element, "period", random.group(1)), False
    if element.get("period"):
        return 1.0 / max(_number(file, element, "period", period), 1e-9), True
    if element.get("vehsPerHour"):
        return vehps_from_vehph(_number(file, element, "vehsPerHour", period)), True
    if element.get("probability"):
        # one chance per second: at the rates of a road this is a Poisson stream
        return _number(file, element, "probability", element.get("probability", "")), False
    if element.get("number") and end_s > begin_s:
        return _number(file, element, "number", element.get("number", "")) / (end_s - begin_s), True
    raise ScenarioError(file, f"flow '{name}': expected period, vehsPerHour, probability or number.")


def _route(file: Path, element: ET.Element, routes: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    inner = element.find("route")
    if inner is not None:
        return tuple(_get(file, inner, "edges").split())
    name = element.get("route", "")
    if name not in routes:
        raise ScenarioError(file, f"<{element.tag}> '{element.get('id')}': expected the id of a route, got '{name}'.")
    return routes[name]


def _known_vtype(file: Path, element: ET.Element, vtypes: dict[str, dict[str, str]]) -> str:
    name = element.get("type", "")
    if name not in vtypes:
        raise ScenarioError(file, f"<{element.tag}> '{element.get('id')}': expected the id of a vType, got '{name}'.")
    return name


def _get(file: Path, element: ET.Element, attribute: str) -> str:
    value = element.get(attribute)
    if not value:
        raise ScenarioError(file, f"<{element.tag}> '{element.get('id', '')}': expected attribute '{attribute}'.")
    return value


def _number(file: Path, element: ET.Element, attribute: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = float("nan")
    if not 0.0 <= number < 1e9:
        raise ScenarioError(
            file, f"<{element.tag}> '{element.get('id', '')}': {attribute}: expected a number >= 0, got '{value}'."
        )
    return number
