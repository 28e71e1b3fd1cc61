"""Reads SUMO's files without letting them do anything: a case from a stranger may be wrong, it may not do harm.

Document types (entities) are refused, sizes are bounded, paths must stay inside the case's folder, and of a
configuration only what describes the traffic is taken; sections that would write files or open sockets are ignored,
and the reader says so.
"""

import gzip
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from xml.parsers import expat

from sim_adapters.errors import ScenarioError

LARGEST_UNPACKED_BYTES = 200 * 1024 * 1024
GZIP_MAGIC = b"\x1f\x8b"
HARMLESS_SECTIONS = ("random_number", "routing", "report", "mesoscopic")
IGNORED_SECTIONS = ("output", "traci_server", "gui_only", "taxi_device", "fcd_device", "emissions")
PROCESSING_OPTIONS = (
    "collision.action",
    "collision.check-junctions",
    "collision.mingap-factor",
    "default.action-step-length",
    "default.emergencydecel",
    "default.speeddev",
    "lanechange.duration",
    "lanechange.overtake-right",
    "lateral-resolution",
    "step-method.ballistic",
    "time-to-teleport",
    "max-depart-delay",
    "ignore-route-errors",
)


@dataclass(frozen=True)
class SumoConfiguration:
    """What a .sumocfg says about the traffic.

    Attributes:
        file: the configuration.
        net_file: the network.
        route_files: vTypes, routes and flows.
        additional_files: further files with vTypes and routes.
        begin_s: begin of the simulation.
        end_s: end of the simulation, or None.
        step_s: step length.
        lane_change_duration_s: time that a lane change takes; 0 for none.
        processing: options of the processing section that are passed on to SUMO.
        ignored: one line for each thing that was left out.
    """

    file: Path
    net_file: Path
    route_files: tuple[Path, ...]
    additional_files: tuple[Path, ...]
    begin_s: float
    end_s: float | None
    step_s: float
    lane_change_duration_s: float
    processing: dict[str, str]
    ignored: tuple[str, ...]


def read_xml(file: Path) -> ET.Element:
    """Return the root of an XML file, packed or not.

    Raises:
        ScenarioError: the file is missing, too large, has a DOCTYPE, or is not XML.
    """
    if not file.is_file():
        raise ScenarioError(file, f"expected a file at '{file}'; there is none.")
    raw = file.read_bytes()
    if raw[:2] == GZIP_MAGIC:
        with gzip.open(file) as packed:
            raw = packed.read(LARGEST_UNPACKED_BYTES + 1)
    if len(raw) > LARGEST_UNPACKED_BYTES:
        raise ScenarioError(file, f"expected at most {LARGEST_UNPACKED_BYTES // 2**20} MiB of XML.")
    try:
        _refuse_document_type(file, raw)
        return ET.fromstring(raw)
    except (ET.ParseError, expat.ExpatError, RecursionError) as error:
        raise ScenarioError(file, f"expected XML: {error}.") from None


def _refuse_document_type(file: Path, raw: bytes) -> None:
    """Parse as far as a DOCTYPE could stand, in whatever encoding the file is."""

    def refuse(*declaration: object) -> None:
        raise ScenarioError(file, "expected plain XML; found a DOCTYPE, which SUMO files never need.")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.Parse(raw, True)


def read_configuration(file: Path, folder: Path) -> SumoConfiguration:
    """Return what a .sumocfg says about the traffic.

    Args:
        file: the configuration.
        folder: the case's folder, which no path may leave.

    Raises:
        ScenarioError: something is missing or would leave the folder.
    """
    root = read_xml(file)
    ignored: list[str] = []
    values: dict[str, str] = {}
    processing: dict[str, str] = {}
    for section in root:
        if section.tag in IGNORED_SECTIONS:
            ignored.append(f"{file.name}: section <{section.tag}> is ignored; jaxcalib writes its own outputs.")
            continue
        if section.tag not in ("input", "time", "processing", *HARMLESS_SECTIONS):
            ignored.append(f"{file.name}: section <{section.tag}> is ignored; it does not describe traffic.")
            continue
        for option in section:
            value = option.get("value") or option.get("v") or ""
            if section.tag == "processing":
                if option.tag in PROCESSING_OPTIONS:
                    processing[option.tag] = value
                else:
                    ignored.append(f"{file.name}: option '{option.tag}' is ignored.")
            elif section.tag in ("input", "time"):
                values[option.tag] = value
    nets = _paths(file, folder, values.pop("net-file", ""))
    routes = _paths(file, folder, values.pop("route-files", ""))
    additional = _paths(file, folder, values.pop("additional-files", ""))
    if len(nets) != 1 or not routes:
        raise ScenarioError(file, "expected <net-file> with one network and <route-files> in section <input>.")
    begin_s = _number(file, "begin", values.pop("begin", "0"))
    end = values.pop("end", "")
    step_s = _number(file, "step-length", values.pop("step-length", "1"))
    ignored.extend(f"{file.name}: option '{option}' is ignored." for option in values)
    return SumoConfiguration(
        file=file,
        net_file=nets[0],
        route_files=routes,
        additional_files=additional,
        begin_s=begin_s,
        end_s=_number(file, "end", end) if end else None,
        step_s=step_s,
        lane_change_duration_s=_number(file, "lanechange.duration", processing.get("lanechange.duration", "0")),
        processing=processing,
        ignored=tuple(ignored),
    )


def inside(folder: Path, file: Path, origin: Path) -> Path:
    """Return the resolved path if it stays inside the folder.

    Raises:
        ScenarioError: it does not.
    """
    try:
        resolved = file.resolve()
    except (OSError, ValueError):
        raise ScenarioError(origin, f"expected a path, got '{file}'.") from None
    if not resolved.is_relative_to(folder.resolve()):
        raise ScenarioError(origin, f"path '{file.name}' leaves the case's folder; expected one inside.")
    return resolved


def _paths(file: Path, folder: Path, value: str) -> tuple[Path, ...]:
    names = [name.strip() for name in value.replace(",", " ").split()]
    return tuple(inside(folder, file.parent / name, file) for name in names)


def _number(file: Path, option: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        raise ScenarioError(file, f"option '{option}': expected seconds, got '{value}'.") from None
    if not 0.0 <= number < 1e7:
        raise ScenarioError(file, f"option '{option}': expected seconds >= 0, got '{value}'.")
    return number
