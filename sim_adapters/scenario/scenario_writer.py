"""Writes a scenario with other parameter values, as SUMO files that plain `sumo` runs.

It is the user's own scenario: each file keeps its name and all its elements but those that change. The same files serve
the runs that confirm a result and the calibrated scenario that is handed over, so that both give the same bits for the
same seed; what only writes files (detectors) is left out of runs.
"""

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.demand_elements import DEFAULT_VTYPE
from sim_adapters.scenario.demand_windows import cut_flows
from sim_adapters.scenario.effect_draft import Draft
from sim_adapters.scenario.plain_form import MOVERS, plain_elements
from sim_adapters.scenario.scaled_demand import draw_phase, scale_flow, scale_vehicles
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.scenario_files import names_in_use, place_files, placed, without_outputs
from sim_adapters.scenario.sumo_effects import put_into
from sim_adapters.scenario.sumo_files import read_xml
from sim_adapters.scenario.sumo_names import SPEED_DISTRIBUTION
from sim_adapters.scenario.times import read_time_s
from sim_adapters.scenario.unscaled_subject import unscaled_vtype
from sim_adapters.shared_runs import subject_names
from sim_adapters.units import SECONDS_PER_HOUR
from surrogate.effects.base import EffectSetting


@dataclass(frozen=True)
class WrittenScenario:
    """Files of a written scenario."""

    config: Path  # the configuration
    files: tuple[Path, ...]  # additional files, then route files, in the order in which SUMO loads them


def write_scenario(
    scenario: Scenario,
    layout: ParameterLayout,
    values: Sequence[float],
    depart_s: float | Sequence[float],
    subject_vehicle: str,
    folder: Path,
    name: str = "calibrated",
    is_handed_over: bool = False,
    comments: Mapping[str, str] | None = None,
    head: str = "",
    effects: Mapping[str, EffectSetting] | None = None,
    seed: int = 0,
    draws_phases: bool = False,
) -> WrittenScenario:
    """Write a scenario.

    Args:
        scenario: what to write.
        layout: meaning of the values.
        values: parameter values.
        depart_s: when the subject vehicle departs; several departures, in order, for as many subject vehicles.
        subject_vehicle: id of the scenario's subject vehicle; further ones are named by `subject_names`.
        folder: where to write; must exist.
        name: name of the configuration.
        is_handed_over: whether the folder is for people: with the network and with what writes files.
        comments: a line for each driver parameter, at the top of the file with the vTypes.
        head: comment at the top of the configuration.
        effects: unmodelled effects to put in.
        seed: of what effects draw, and phases.
        draws_phases: whether vehicles that come at equal intervals begin anywhere within the first, see `draw_phase`.

    Returns:
        The files written.

    Raises:
        NotExpressibleError: SUMO has no means for an effect.
    """
    configuration = scenario.configuration
    behaviour = values[layout.num_inputs :]
    factors = flow_factors(scenario, layout, values)
    departs_s = [depart_s] if isinstance(depart_s, float | int) else depart_s
    sources = [*configuration.additional_files, *configuration.route_files]
    roots = [read_xml(file) for file in sources]
    in_use = names_in_use(roots)
    for source, root in zip(sources, roots, strict=True):
        place_files(root, source, folder if is_handed_over else None)
        if not is_handed_over:
            without_outputs(root, in_use)
    file_of: dict[int, int] = {}  # by identity of the element
    elements: list[ET.Element] = []
    counted: dict[str, int] = {}
    alone = unscaled_vtype(scenario, roots)
    if alone is not None and scenario.demand.subject_vtype in layout.vtypes:
        _set_attributes(alone, layout.values_of(scenario.demand.subject_vtype, behaviour))
    for number, (source, root) in enumerate(zip(sources, roots, strict=True)):
        own = plain_elements(root, configuration.begin_s, configuration.end_s)
        own = cut_flows(source, own, scenario.windows)
        for element in scale_vehicles(own, factors, scenario.demand.entrance_of, scenario.windows, counted):
            element.tail = "\n"
            for vtype in element.iter("vType"):
                if vtype.get("id") in layout.vtypes:
                    _set_attributes(vtype, layout.values_of(vtype.get("id", ""), behaviour))
            if element.tag == "flow" and element.get("id") in factors:
                scale_flow(element, factors[element.get("id", "")])
                if draws_phases:
                    draw_phase(source, element, seed)
            is_subject = element.get("id") == subject_vehicle and element.tag in ("vehicle", "trip")
            own_vtype = [alone] if is_subject and alone is not None else []
            if own_vtype:
                element.set("type", own_vtype[0].get("id", ""))
            for one in (*own_vtype, *(_subjects(element, departs_s) if is_subject else [element])):
                file_of[id(one)] = number
                elements.append(one)
    if DEFAULT_VTYPE in layout.vtypes and not any(_has_vtype(one, (DEFAULT_VTYPE,)) for one in elements):
        default = ET.Element("vType", id=DEFAULT_VTYPE)  # SUMO's own, which no file needs to name
        _set_attributes(default, layout.values_of(DEFAULT_VTYPE, behaviour))
        elements.insert(0, default)
        file_of[id(default)] = 0
    read = tuple(elements)  # keeps them, and with them their identities, while effects replace some
    rates = {flow: factors.get(flow, 1.0) * scenario.mean_rate_vehps(flow) for flow in scenario.flow_ids}
    draft = Draft(scenario, elements, seed, rates)
    put_into(draft, effects or {})
    parts = _by_file(draft.elements, {id(one): file_of[id(one)] for one in read}, len(sources))
    noted = next((n for n, part in enumerate(parts) if any(_has_vtype(one, layout.vtypes) for one in part)), 0)
    written = []
    for number, (source, root, part) in enumerate(zip(sources, roots, parts, strict=True)):
        lines = [f"{k}: {v}" for k, v in (comments or {}).items()] if number == noted else []
        is_route_file = number >= len(configuration.additional_files)
        file = folder / _file_name(source, sources[:number])
        _write(file, root.tag, lines, _in_order(part) if is_route_file else part)
        written.append(file)
    net = configuration.net_file
    if is_handed_over:
        shutil.copyfile(net, folder / net.name)
    inputs = {"net-file": net.name if is_handed_over else str(net)}
    additional = written[: len(configuration.additional_files)]
    if additional:
        inputs["additional-files"] = ",".join(file.name for file in additional)
    inputs["route-files"] = ",".join(file.name for file in written[len(additional) :])
    config = folder / f"{name}.sumocfg"
    processing = dict(configuration.processing) | draft.processing
    if is_handed_over:
        for option in set(processing) & set(configuration.read_files):
            files = [placed(file, folder) for file in configuration.read_files[option]]
            processing[option] = ",".join(files)
    _write_configuration(config, scenario, inputs, head, processing)
    return WrittenScenario(config, tuple(written))


def flow_factors(scenario: Scenario, layout: ParameterLayout, values: Sequence[float]) -> dict[str, float]:
    """By how much each flow of an input is scaled; shares within an input are kept."""
    factors = {}
    for index, flows in enumerate(layout.input_flows):
        base = sum(scenario.mean_rate_vehps(flow) for flow in flows)
        factors |= dict.fromkeys(flows, values[index] / SECONDS_PER_HOUR / max(float(base), 1e-12))
    return factors


def _by_file(elements: Sequence[ET.Element], file_of: Mapping[int, int], num_files: int) -> list[list[ET.Element]]:
    """Elements of each file; new ones, of effects, go where their neighbour before them stands."""
    parts: list[list[ET.Element]] = [[] for _ in range(num_files)]
    place = 0
    for element in elements:
        place = file_of.get(id(element), place)
        parts[place].append(element)
    return parts


def _has_vtype(element: ET.Element, vtypes: Sequence[str]) -> bool:
    return any(vtype.get("id") in vtypes for vtype in element.iter("vType"))


def _file_name(source: Path, before: Sequence[Path]) -> str:
    """The file's own name; packed files are written unpacked, and a name is taken once."""
    name = source.name.removesuffix(".gz")
    taken = sum(other.name.removesuffix(".gz") == name for other in before)
    return f"{taken}-{name}" if taken else name


def _subjects(element: ET.Element, departs_s: Sequence[float]) -> list[ET.Element]:
    """The subject vehicle once for each departure."""
    subjects = []
    for name, depart_s in zip(subject_names(element.get("id", ""), departs_s), departs_s, strict=True):
        subject = deepcopy(element)
        subject.set("id", name)
        subject.set("depart", _text(depart_s))
        if subjects:  # SUMO keeps the option that names the first from one run of a process to the next
            ET.SubElement(subject, "param", key="has.fcd.device", value="true")
        subjects.append(subject)
    return subjects


def _in_order(elements: Sequence[ET.Element]) -> list[ET.Element]:
    """Elements with flows and vehicles by begin and departure: SUMO leaves out who stands too late in a file."""

    def begin_s(element: ET.Element) -> float:
        if element.tag not in MOVERS:
            return -1.0
        seconds = read_time_s(element.get("depart") or element.get("begin") or "0")
        return 0.0 if seconds is None else max(seconds, 0.0)  # a vehicle that waits for something

    return sorted(elements, key=begin_s)


def _set_attributes(vtype: ET.Element, values: Mapping[str, float]) -> None:
    factor = vtype.get("speedFactor", "")
    distribution = SPEED_DISTRIBUTION.fullmatch(factor.replace(" ", ""))
    for attribute, value in values.items():
        if not (distribution and attribute in ("speedFactor", "speedDev")):
            vtype.set(attribute, _text(value))
    if "speedDev" in values and "speedDev" in vtype.attrib:  # it counts, whatever the distribution says
        vtype.set("speedDev", _text(values["speedDev"]))
    if distribution and {"speedFactor", "speedDev"} & set(values):
        kind, mean, deviation, bounds = distribution.groups()
        mean = _text(values["speedFactor"]) if "speedFactor" in values else mean
        deviation = _text(values["speedDev"]) if "speedDev" in values else deviation or "0"
        vtype.set("speedFactor", f"{kind}({mean},{deviation}{bounds})")


def _write_configuration(
    file: Path, scenario: Scenario, inputs: Mapping[str, str], head: str, processing: Mapping[str, str]
) -> None:
    configuration = scenario.configuration
    root = ET.Element("configuration")
    for section, options in (
        ("input", inputs),
        ("time", {"begin": _text(configuration.begin_s), "step-length": _text(configuration.step_s)}),
        ("processing", processing),
    ):
        if not options:  # SUMO complains of empty sections
            continue
        element = ET.SubElement(root, section)
        for option, value in options.items():
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
