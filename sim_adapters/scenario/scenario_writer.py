"""Writes a scenario with other parameter values, as SUMO files that plain `sumo` runs.

The same files serve the runs that confirm a result and the calibrated scenario that is handed over, so that both give
the same bits for the same seed.
"""

import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.demand_file import Flow
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_effects import Draft, put_into
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.shared_runs import subject_names
from sim_adapters.units import SECONDS_PER_HOUR
from surrogate.effects.base import EffectSetting

FORCED_OPTIONS = {"time-to-teleport": "-1"}  # a vehicle that vanishes would leave a gap that nobody made
DROPPED_OPTIONS = ("ignore-route-errors",)


@dataclass(frozen=True)
class WrittenScenario:
    """Files of a written scenario.

    Attributes:
        config: the configuration.
        demand: routes, flows and the subject vehicle.
        vtypes: vTypes that were set.
    """

    config: Path
    demand: Path
    vtypes: Path


def write_scenario(
    scenario: Scenario,
    layout: ParameterLayout,
    values: Sequence[float],
    depart_s: float | Sequence[float],
    subject_vehicle: str,
    folder: Path,
    name: str = "calibrated",
    copy_net: bool = False,
    comments: Mapping[str, str] | None = None,
    head: str = "",
    effects: Mapping[str, EffectSetting] | None = None,
    seed: int = 0,
) -> WrittenScenario:
    """Write a scenario.

    Args:
        scenario: what to write.
        layout: meaning of the values.
        values: parameter values.
        depart_s: when the subject vehicle departs; several departures, in order, for as many subject vehicles.
        subject_vehicle: id of the scenario's subject vehicle; further ones are named by `subject_names`.
        folder: where to write; must exist.
        name: part of the files' names.
        copy_net: whether to copy the network into the folder, so that the folder can be given away.
        comments: a line for each attribute that is written beside the vTypes.
        head: comment at the top of the configuration.
        effects: unmodelled effects to put in.
        seed: of what effects draw.

    Returns:
        The files written.

    Raises:
        NotExpressibleError: SUMO has no means for an effect.
    """
    set_attributes = dict(zip(layout.attributes, values[layout.num_inputs :], strict=True))
    rates = flow_rates_vehps(scenario, layout, values)
    elements: list[ET.Element] = []
    own: set[str] = set()
    files = [*scenario.configuration.additional_files, *scenario.configuration.route_files]
    for element in [element for file in files for element in read_xml(file)]:
        element.tail = "\n"
        if element.tag == "vType" and element.get("id") in layout.vtypes:
            _set_attributes(element, set_attributes)
            own.add(element.get("id", ""))
        if element.tag == "flow" and element.get("id") in rates:
            _set_rate(element, scenario.flow_by_id[element.get("id", "")], rates[element.get("id", "")])
        if element.get("id") == subject_vehicle and element.tag in ("vehicle", "trip"):
            elements += _subjects(element, [depart_s] if isinstance(depart_s, float | int) else depart_s)
            continue
        elements.append(element)
    all_rates = {flow.id: rates.get(flow.id, flow.rate_vehps) for flow in scenario.flows}
    draft = Draft(scenario, elements, seed, all_rates)
    put_into(draft, effects or {})
    vtypes = [one for one in draft.elements if one.tag.startswith("vType") and one.get("id") in own]
    routes = _in_order([one for one in draft.elements if one not in vtypes])
    demand = folder / f"demand.{name}.rou.xml"
    vtype_file = folder / f"vtypes.{name}.add.xml"
    _write(demand, "routes", ["routes, flows and the subject vehicle; vTypes are in the .add.xml"], routes)
    _write(vtype_file, "additional", [f"{k}: {v}" for k, v in (comments or {}).items()], vtypes)
    net = scenario.configuration.net_file
    if copy_net:
        shutil.copyfile(net, folder / net.name)
    config = folder / f"{name}.sumocfg"
    inputs = {
        "net-file": net.name if copy_net else str(net),
        "additional-files": vtype_file.name,
        "route-files": demand.name,
    }
    _write_configuration(config, scenario, inputs, head, draft.processing)
    return WrittenScenario(config, demand, vtype_file)


def flow_rates_vehps(scenario: Scenario, layout: ParameterLayout, values: Sequence[float]) -> dict[str, float]:
    """Return the rate of each flow that an input scales; shares within an input are kept."""
    rates = {}
    for index, flows in enumerate(layout.input_flows):
        base = [scenario.flow_by_id[flow].rate_vehps for flow in flows]
        factor = values[index] / SECONDS_PER_HOUR / max(float(np.sum(base)), 1e-12)
        rates |= {flow: rate * factor for flow, rate in zip(flows, base, strict=True)}
    return rates


def _subjects(element: ET.Element, departs_s: Sequence[float]) -> list[ET.Element]:
    """Return the subject vehicle once for each departure."""
    found = []
    for name, depart_s in zip(subject_names(element.get("id", ""), departs_s), departs_s, strict=True):
        one = deepcopy(element)
        one.set("id", name)
        one.set("depart", _text(depart_s))
        if found:  # SUMO keeps the option that names the first from one run of a process to the next
            ET.SubElement(one, "param", key="has.fcd.device", value="true")
        found.append(one)
    return found


def _in_order(elements: Sequence[ET.Element]) -> list[ET.Element]:
    """Return elements with flows and vehicles by begin and departure: SUMO leaves out who stands too late in a file."""

    def begin_s(element: ET.Element) -> float:
        if element.tag not in ("flow", "vehicle", "trip"):
            return -np.inf
        try:
            return float(element.get("depart") or element.get("begin") or 0.0)
        except ValueError:  # a time of day, or a vehicle that waits for something
            return 0.0

    return sorted(elements, key=begin_s)


def _set_attributes(vtype: ET.Element, values: Mapping[str, float]) -> None:
    factor = vtype.get("speedFactor", "")
    bounded = re.fullmatch(r"normc\(([^,]*),([^,]*)((?:,[^,]*){0,2})\)", factor.replace(" ", ""))
    for attribute, value in values.items():
        if not (bounded and attribute in ("speedFactor", "speedDev")):
            vtype.set(attribute, _text(value))
    if bounded and {"speedFactor", "speedDev"} & set(values):
        mean = _text(values["speedFactor"]) if "speedFactor" in values else bounded.group(1)
        deviation = _text(values["speedDev"]) if "speedDev" in values else bounded.group(2)
        vtype.set("speedFactor", f"normc({mean},{deviation}{bounded.group(3)})")


def _set_rate(element: ET.Element, flow: Flow, rate_vehps: float) -> None:
    if (element.get("period") or "").strip().startswith("exp"):
        element.set("period", f"exp({_text(rate_vehps)})")
    elif element.get("period"):
        element.set("period", _text(1.0 / max(rate_vehps, 1e-9)))
    elif element.get("vehsPerHour"):
        element.set("vehsPerHour", _text(rate_vehps * SECONDS_PER_HOUR))
    elif element.get("probability"):
        element.set("probability", _text(min(rate_vehps, 1.0)))
    else:
        element.set("number", str(round(rate_vehps * (flow.end_s - flow.begin_s))))


def _write_configuration(
    file: Path, scenario: Scenario, inputs: Mapping[str, str], head: str, processing: Mapping[str, str]
) -> None:
    configuration = scenario.configuration
    root = ET.Element("configuration")
    for section, options in (
        ("input", inputs),
        ("time", {"begin": _text(configuration.begin_s), "step-length": _text(configuration.step_s)}),
        ("processing", configuration.processing | dict(processing) | FORCED_OPTIONS),
    ):
        element = ET.SubElement(root, section)
        for option, value in options.items():
            if option not in DROPPED_OPTIONS:
                ET.SubElement(element, option, value=value)
    if configuration.end_s is not None:
        ET.SubElement(root[1], "end", value=_text(configuration.end_s))
    ET.indent(root, "    ")
    text = ET.tostring(root, encoding="unicode")
    file.write_text(f"<!-- {_harmless(head)} -->\n{text}\n" if head else text + "\n", encoding="utf-8")


def _write(file: Path, tag: str, comments: list[str], elements: list[ET.Element]) -> None:
    root = ET.Element(tag)
    root.text = "\n    "
    root.extend([*(ET.Comment(f" {_harmless(text)} ") for text in comments), *elements])
    ET.indent(root, "    ")
    file.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")


def _harmless(text: str) -> str:
    return text.replace("--", "- -")


def _text(value: float) -> str:
    return repr(float(value))
