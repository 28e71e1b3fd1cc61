"""SUMO's elements in the one form that reader and writer know, where SUMO takes several that mean the same."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from sim_adapters.scenario.demand_elements import is_number_alone
from sim_adapters.scenario.times import read_time_s

MOVERS = ("flow", "vehicle", "trip")
NESTED_MODEL = "carFollowing-"  # an element of a vType with a model's parameters, as before SUMO 1.0
DAY_S = 86_400.0  # over which SUMO spreads a flow's number where nothing says an end


def plain_elements(elements: Iterable[ET.Element], begin_s: float, end_s: float | None) -> list[ET.Element]:
    """Return the elements of a file, altered where they stand in another form.

    Flows within an `<interval>` stand by themselves, with its times. A model's parameters in an element of its own are
    attributes of the vType: they would hide those that are set there. A flow that says a number alone says until when.

    Args:
        elements: of a file.
        begin_s: begin of the simulation.
        end_s: end that the configuration states; None where it states none.
    """
    plain: list[ET.Element] = []
    for element in elements:
        movers = [child for child in element if child.tag in MOVERS] if element.tag == "interval" else []
        for mover in movers:
            for attribute in ("begin", "end"):
                if mover.tag == "flow" and attribute in element.attrib:
                    mover.attrib.setdefault(attribute, element.attrib[attribute])
            element.remove(mover)
        plain += [*movers, element] if len(element) or not movers else movers
    for element in plain:
        for vtype in element.iter("vType"):
            _take_in_model(vtype)
        if element.tag == "flow" and is_number_alone(element) and not element.get("end"):
            first_s = read_time_s(element.get("begin")) if element.get("begin") else begin_s
            if first_s is not None:
                element.set("end", repr(first_s + DAY_S if end_s is None else end_s))
    return plain


def _take_in_model(vtype: ET.Element) -> None:
    """Move a nested model's parameters, which count, to the vType's attributes."""
    for child in [child for child in vtype if child.tag.startswith(NESTED_MODEL)]:
        vtype.attrib.setdefault("carFollowModel", child.tag.removeprefix(NESTED_MODEL))
        vtype.attrib.update(child.attrib)
        vtype.remove(child)
