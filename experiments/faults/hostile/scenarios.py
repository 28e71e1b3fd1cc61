"""Scenarios that would have SUMO write files elsewhere, read others, or open a port."""

import socket
from collections.abc import Callable, Mapping

from experiments.faults.hostile.place import Place, add_file, add_option, add_to_demand, first_lane, replace

Hostile = Callable[[Place], None]
OUTPUTS = (
    "fcd-output", "tripinfo-output", "summary-output", "vehroute-output", "queue-output", "full-output", "stop-output",
    "collision-output", "statistic-output", "lanechange-output", "emission-output", "link-output", "amitran-output",
    "bt-output", "vtk-output", "battery-output", "personsummary-output",
)  # fmt: skip
SHORT_NAMES = ("netstate-dump", "ndump", "netstate", "vehroutes", "personroutes", "personinfo", "person-fcd", "l", "C")
LOGS = (
    "log", "log-file", "error-log", "message-log", "device.ssm.file", "device.toc.file", "save-state.prefix",
    "save-configuration", "save-template", "save-schema", "edgedata-output", "lanedata-output",
)  # fmt: skip
DETECTORS = (
    '<inductionLoop id="h1" lane="{lane}" pos="10" period="10" file="{file}.1"/>',
    '<instantInductionLoop id="h2" lane="{lane}" pos="10" file="{file}.2"/>',
    '<laneAreaDetector id="h3" lane="{lane}" pos="10" endPos="50" period="10" file="{file}.3"/>',
    '<edgeData id="h4" period="10" file="{file}.4"/>',
    '<laneData id="h5" period="10" file="{file}.5"/>',
    '<routeProbe id="h6" edge="m3" period="10" file="{file}.6"/>',
    '<vTypeProbe id="h7" type="car" period="10" file="{file}.7"/>',
    '<entryExitDetector id="h8" period="10" file="{file}.8"><detEntry lane="{lane}" pos="10"/>'
    '<detExit lane="{lane}" pos="90"/></entryExitDetector>',
)
CALIBRATOR = (
    '<calibrator id="h9" lane="{lane}" pos="0" period="10" output="{file}.9"><flow begin="0" end="180" '
    'route="r_f_main" vehsPerHour="900" speed="20" type="car"/></calibrator>'
)
TELLING = (
    '<param key="has.ssm.device" value="true"/><param key="device.ssm.file" value="{file}"/>'
    '<param key="device.ssm.range" value="50"/><param key="device.ssm.frequency" value="2"/>'
)


def options(*names: str, value: Callable[[Place], str]) -> Hostile:
    """Return what gives options a value, each a file name of its own."""

    def make(place: Place) -> None:
        for name in names:
            add_option(place, name, f"{value(place)}{name}")

    return make


def absolute(place: Place) -> str:
    """Return the begin of an absolute name."""
    return str(place.outside / "written-")


def upwards(place: Place) -> str:
    """Return the begin of a name that leads out of the case, from wherever SUMO's file lies in it."""
    return "../../outside/written-"


def free_port() -> int:
    """Return a port that nobody listens at."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def detectors(place: Place, nested: bool = False, in_routes: bool = False) -> None:
    """Have all kinds of detectors write elsewhere."""
    text = "".join(DETECTORS).format(lane=first_lane(place), file=place.outside / "detector")
    text = f"<unknown>{text}</unknown>" if nested else text
    if in_routes:
        add_to_demand(place, text)
    else:
        add_file(place, "detectors.add.xml", text)


def calibrator(place: Place) -> None:
    """Have a calibrator, which acts on traffic, write elsewhere."""
    add_file(place, "calibrator.add.xml", CALIBRATOR.format(lane=first_lane(place), file=place.outside / "calibrator"))


def rerouter(place: Place) -> None:
    """Have a rerouter read its content elsewhere, where detectors stand."""
    other = place.outside / "more.xml"
    text = "".join(DETECTORS).format(lane=first_lane(place), file=place.outside / "rerouted")
    other.write_text(f"<additional>{text}</additional>", encoding="utf-8")
    add_file(place, "rerouter.add.xml", f'<rerouter id="h10" edges="m3" file="{other}"/>')


def include(place: Place, in_demand: bool) -> None:
    """Include a file that lies elsewhere, where detectors stand."""
    other = place.outside / "included.xml"
    text = "".join(DETECTORS).format(lane=first_lane(place), file=place.outside / "included")
    other.write_text(f"<additional>{text}</additional>", encoding="utf-8")
    if in_demand:
        add_to_demand(place, f'<include href="{other}"/>')
    else:
        add_file(place, "include.add.xml", f'<include href="{other}"/>')


def telling_vehicles(place: Place, of: str) -> None:
    """Have vehicles carry a device that writes elsewhere."""
    inner = TELLING.format(file=place.outside / "ssm.xml")
    if of == "vType":
        replace(place.demand, 'lcKeepRight="0.1"/>', f'lcKeepRight="0.1">{inner}</vType>')
    else:
        replace(place.demand, 'departSpeed="avg"/>', f'departSpeed="avg">{inner}</{of}>', 1)


def signal_states(place: Place) -> None:
    """Have events save states elsewhere."""
    target = place.outside / "states.xml"
    add_file(place, "events.add.xml", f'<timedEvent type="SaveTLSStates" source="n4" dest="{target}"/>')


def port(place: Place) -> None:
    """Have SUMO wait for whoever wants to steer it."""
    add_option(place, "remote-port", str(free_port()))
    add_option(place, "num-clients", "1")


def nested_configuration(place: Place) -> None:
    """Name another configuration that writes elsewhere."""
    other = place.outside / "other.sumocfg"
    inner = f'<fcd-output value="{place.outside / "nested.xml"}"/>'
    other.write_text(f"<configuration>{inner}</configuration>", encoding="utf-8")
    add_option(place, "configuration-file", str(other))


SCENARIOS: Mapping[str, Hostile] = {
    "outputs at absolute places": options(*OUTPUTS, value=absolute),
    "outputs out of the case": options(*OUTPUTS, value=upwards),
    **{f"output by the name {name}": options(name, value=absolute) for name in SHORT_NAMES},
    "logs, templates, states": options(*LOGS, value=absolute),
    "prefix of outputs": options("output-prefix", "fcd-output", value=upwards),
    "times of saved states": options("save-state.times", value=lambda place: "100,"),
    "port for remote control": port,
    "nested configuration": nested_configuration,
    "state to be loaded": options("load-state", value=lambda place: "/etc/passwd"),
    "detectors": detectors,
    "detectors within an unknown element": lambda place: detectors(place, nested=True),
    "detectors in the route file": lambda place: detectors(place, in_routes=True),
    "calibrator with an output": calibrator,
    "rerouter with a file": rerouter,
    "include in an additional file": lambda place: include(place, in_demand=False),
    "include in the route file": lambda place: include(place, in_demand=True),
    "vType with a device that writes": lambda place: telling_vehicles(place, "vType"),
    "flow with a device that writes": lambda place: telling_vehicles(place, "flow"),
    "states of signals": signal_states,
}
