"""The subject vehicle of a new case: found in the scenario, or written beside case.toml with a configuration for it."""

import os
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path

from sim_adapters.scenario.configuration import SYNONYMS, SumoConfiguration
from sim_adapters.scenario.demand_elements import DEFAULT_VTYPE
from sim_adapters.scenario.sumo_files import read_xml

USUAL_IDS = ("ego", "subject", "av", "ego_vehicle", "subject_vehicle", "host")
ROUTE_FILE = "ego.rou.xml"


def find_subject(configuration: SumoConfiguration, route: Sequence[str]) -> tuple[str, str] | None:
    """Find the subject vehicle in a scenario.

    Args:
        configuration: of the scenario.
        route: edges of the logged drive.

    Returns:
        Its id, and by what it was found; None where no vehicle seems to be it.
    """
    elements = _elements(configuration)
    vehicles = [element for element in elements if element.tag in ("vehicle", "trip")]
    by_name = {(vehicle.get("id") or "").lower(): vehicle.get("id", "") for vehicle in vehicles}
    for name in USUAL_IDS:
        if name in by_name:
            return by_name[name], "by its id"
    users = Counter(element.get("type") or DEFAULT_VTYPE for element in elements)
    routes = {element.get("id"): element.get("edges", "").split() for element in elements if element.tag == "route"}
    alone = [one for one in vehicles if users[one.get("type") or DEFAULT_VTYPE] == 1]
    on_route = [one for one in alone if {route[0], route[-1]} <= {*_edges(one, routes)}]
    if len(on_route) == 1:
        return on_route[0].get("id", ""), "the only vehicle on the logged route whose vType nobody else has"
    return None


def subject_edges(configuration: SumoConfiguration) -> tuple[str, ...]:
    """Edges that the scenario's subject vehicle names, found by a usual id; none where there is no such vehicle."""
    elements = _elements(configuration)
    routes = {element.get("id"): element.get("edges", "").split() for element in elements if element.tag == "route"}
    for element in elements:
        if element.tag in ("vehicle", "trip") and (element.get("id") or "").lower() in USUAL_IDS:
            return tuple(_edges(element, routes))
    return ()


def _elements(configuration: SumoConfiguration) -> list[ET.Element]:
    files = (*configuration.additional_files, *configuration.route_files)
    return [element for file in files for element in read_xml(file)]


def _edges(vehicle: ET.Element, routes: Mapping[str | None, Sequence[str]]) -> Sequence[str]:
    inner = vehicle.find("route")
    if inner is not None:
        return inner.get("edges", "").split()
    return routes.get(vehicle.get("route"), ()) or (vehicle.get("from", ""), vehicle.get("to", ""))


def add_subject(
    configuration: SumoConfiguration,
    folder: Path,
    route: Sequence[str],
    depart_s: float,
    max_speed_mps: float,
) -> tuple[Path, str]:
    """Write a subject vehicle, and a configuration that adds it to a scenario whose files stay as they are.

    Args:
        configuration: of the scenario.
        folder: where to write.
        route: edges.
        depart_s: when it departs.
        max_speed_mps: the speed that it does not exceed.

    Returns:
        The configuration, and the vehicle's id.
    """
    taken = {name for element in _elements(configuration) for one in element.iter() if (name := one.get("id"))}
    vehicle, vtype = _free("ego", taken), _free("subject", taken)
    root = ET.Element("routes")
    root.append(ET.Comment(" A guess of `jaxcalib new`: write here how the automated vehicle drives. "))
    driver = {"id": vtype, "vClass": "passenger", "carFollowModel": "IDM", "maxSpeed": f"{max_speed_mps:.2f}"}
    ET.SubElement(root, "vType", driver | {"speedFactor": "1", "speedDev": "0"})
    departure = {"depart": f"{depart_s:.2f}", "departLane": "best", "departPos": "base", "departSpeed": "avg"}
    element = ET.SubElement(root, "vehicle", {"id": vehicle, "type": vtype} | departure)
    ET.SubElement(element, "route", edges=" ".join(route))
    ET.indent(root, "    ")
    (folder / ROUTE_FILE).write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    config = folder / f"{configuration.file.name.removesuffix('.sumocfg')}.sumocfg"
    _write_configuration(configuration, config)
    return config, vehicle


def _free(name: str, taken: set[str]) -> str:
    return next(one for one in (name, *(f"{name}_{number}" for number in range(1, len(taken) + 2))) if one not in taken)


def _write_configuration(configuration: SumoConfiguration, config: Path) -> None:
    """Write the scenario's configuration again: files by their new paths, the subject vehicle's added."""
    root = deepcopy(read_xml(configuration.file))
    lists = {
        "net-file": (configuration.net_file,),
        "route-files": (*configuration.route_files, config.parent / ROUTE_FILE),
        "additional-files": configuration.additional_files,
    }
    for element in list(root.iter()):
        key = "value" if "value" in element.attrib else "v"
        value = element.get(key)
        option = SYNONYMS.get(element.tag, element.tag)
        if value is None:
            continue
        if option in lists:  # may stand several times; all of its files stand in the first
            element.set(key, ",".join(path_from(config.parent, file) for file in lists[option]))
            lists[option] = ()
            if not element.get(key):
                _remove(root, element)
        elif value and (configuration.file.parent / value).is_file():
            element.set(key, path_from(config.parent, configuration.file.parent / value))
    ET.indent(root, "    ")
    config.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")


def _remove(root: ET.Element, element: ET.Element) -> None:
    for parent in root.iter():
        if element in list(parent):
            parent.remove(element)
            return


def path_from(folder: Path, file: Path) -> str:
    """A file's path as seen from a folder: relative where it lies near by, else absolute."""
    folder, file = folder.resolve(), file.resolve()
    if file.is_relative_to(folder.parent.parent) and folder.parent.parent != folder.parent:
        return Path(os.path.relpath(file, folder)).as_posix()
    return file.as_posix()
