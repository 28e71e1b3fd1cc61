"""What a .sumocfg says: inputs, clock, and every option that may act on traffic.

SUMO takes options in any section, and by several names; so does this reader. Options that would write files, open
sockets or windows are left out, for jaxcalib writes outputs of its own; all others are handed to SUMO as they stand.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.option_names import SYNONYMS
from sim_adapters.scenario.sumo_files import read_xml, resolved
from sim_adapters.scenario.times import read_time_s

# What acts on files, sockets, windows and reports, never on traffic.
LEFT_OUT = re.compile(
    r"output|(^|[-.])log($|[-.])|^save-|^load-state|^gui|\.files?$|^netstate-|^device\.ssm\.|^("
    r"pedestrian\.jupedsim\.(wkt|py)|remote-port|num-clients|start|quit-on-end|game.*|delay|window-.*|demo|"
    r"breakpoints|tracker-interval|osg-.*|registry-viewer|verbose|print-options|help|version|no-warnings|"
    r"no-step-log|step-log\.period|aggregate-warnings|xml-validation.*|write-license|duration-log\..*|"
    r"human-readable-time|fcd-.*|device\.fcd\..*|device\.emissions.*|emission.*|alternative-view|"
    r"alternative-net-file|selection-file|edgedata-files|edge-data-.*|threads|precision.*|language|random|seed|"
    r"configuration-file|weights\.minor-penalty\.unused)$"
)
HARMLESS = re.compile(
    r"^(verbose|no-warnings|no-step-log|step-log\.period|duration-log\..*|xml-validation.*|random|seed|threads|"
    r"precision.*|start|quit-on-end|delay|gui.*|demo|window-.*|human-readable-time|write-license|print-options|"
    r"aggregate-warnings|breakpoints|tracker-interval|language)$"
)  # not even worth a line


@dataclass(frozen=True)
class SumoConfiguration:
    """What a .sumocfg says about the traffic."""

    file: Path  # the configuration
    net_file: Path  # the network
    route_files: tuple[Path, ...]  # vTypes, routes, vehicles and flows
    additional_files: tuple[Path, ...]  # further files with such, and with all that may stand beside the road
    begin_s: float  # begin of the simulation
    end_s: float | None  # end of the simulation, or None
    step_s: float  # step length
    lane_change_duration_s: float  # time that a lane change takes; 0 for none
    scale: float  # factor on all demand
    processing: Mapping[str, str]  # all further options that are handed to SUMO
    read_files: Mapping[str, tuple[Path, ...]]  # files that some of them name, by option
    ignored: tuple[str, ...]  # one line for each thing that was left out

    def is_on(self, option: str) -> bool:
        """Whether an option is set to something else than nothing, 0 or false."""
        return self.processing.get(option, "0").strip().lower() not in ("", "0", "0.0", "false", "f", "no", "off", "-1")


def read_configuration(file: Path) -> SumoConfiguration:
    """Read a configuration; the files that it names may lie anywhere.

    Raises:
        ScenarioError: something is missing.
    """
    options: dict[str, str] = {}
    ignored: list[str] = []
    for element in read_xml(file).iter():
        value = element.get("value", element.get("v"))
        if value is None:
            continue
        name = SYNONYMS.get(element.tag, element.tag)
        if LEFT_OUT.search(name):
            if not HARMLESS.match(name):
                ignored.append(f"{file.name}: option '{name}' is left out; jaxcalib writes its own outputs.")
        elif name in options and name == "additional-files":
            options[name] += f",{value}"
        else:
            options[name] = value
    nets = _paths(file, options.pop("net-file", ""))
    routes = _paths(file, options.pop("route-files", ""))
    additional = _paths(file, options.pop("additional-files", ""))
    if len(nets) != 1 or not routes:
        raise ScenarioError(file, "expected <net-file> with one network and <route-files>.")
    read_files = {
        option: _paths(file, value) for option, value in options.items() if option.endswith(("-file", "-files"))
    }
    options |= {option: ",".join(map(str, files)) for option, files in read_files.items()}
    end = options.pop("end", "")
    end_s = read_time_s(end) if end else None
    return SumoConfiguration(
        file=file,
        net_file=nets[0],
        route_files=routes,
        additional_files=additional,
        begin_s=_time_s(file, "begin", options.pop("begin", "0")),
        end_s=None if end_s is not None and end_s < 0.0 else end_s,
        step_s=_time_s(file, "step-length", options.pop("step-length", "1")),
        lane_change_duration_s=_time_s(file, "lanechange.duration", options.get("lanechange.duration", "0")),
        scale=_time_s(file, "scale", options.get("scale", "1"), "a factor"),
        processing=options,
        read_files=read_files,
        ignored=tuple(ignored),
    )


def _paths(file: Path, value: str) -> tuple[Path, ...]:
    """Return the files of a list; a name may hold spaces, and spaces may part names."""
    names: list[str] = []
    for part in (part.strip() for part in value.replace(";", ",").split(",")):
        names += [part] if (file.parent / part).is_file() else part.split()
    return tuple(resolved(file.parent / name, file) for name in names)


def _time_s(file: Path, option: str, value: str, expected: str = "seconds") -> float:
    number = read_time_s(value)
    if number is None or not 0.0 <= number < 1e9:
        raise ScenarioError(file, f"option '{option}': expected {expected} >= 0, got '{value}'.")
    return number
