"""A scenario on its way to files, with what effects change: vTypes wherever they stand, and parts of them."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sim_adapters.scenario.demand_elements import DEFAULT_VTYPE, members_of
from sim_adapters.scenario.plain_form import MOVERS
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import attribute_values

MIX = "vTypeDistribution"


@dataclass
class Draft:
    """A scenario on its way to files."""

    scenario: Scenario  # what it is made from
    # elements of route and additional files, vTypes among them, in the order in which SUMO reads them
    elements: list[ET.Element]
    seed: int  # of the run
    rates_vehps: Mapping[str, float]
    processing: dict[str, str] = field(default_factory=dict)  # options of the configuration

    @property
    def background(self) -> tuple[str, ...]:
        """The vTypes of background traffic."""
        return tuple(dict.fromkeys(flow.vtype for flow in self.scenario.flows))

    def vtypes(self, names: Sequence[str]) -> list[ET.Element]:
        """Return the elements of vTypes, those within distributions, too; SUMO's own one gets an element."""
        found = [one for element in self.elements for one in element.iter("vType") if one.get("id") in names]
        if DEFAULT_VTYPE in names and all(one.get("id") != DEFAULT_VTYPE for one in found):
            found.insert(0, ET.Element("vType", id=DEFAULT_VTYPE))
            self.elements.insert(0, found[0])
        return found

    def number(self, vtype: ET.Element, attribute: str) -> float:
        """Return an attribute, SUMO's default included."""
        model = self.scenario.model_of(vtype.get("id", ""))
        return attribute_values(dict(vtype.attrib), model)[attribute]

    def divide(self, vtype: ET.Element, parts: Sequence[tuple[float, ET.Element]]) -> None:
        """Replace a vType by several, each with its share of the vehicles."""
        name, own_share = vtype.get("id", ""), float(vtype.get("probability") or 1.0)
        shares = {f"{name}-{number}": float(share) for number, (share, _) in enumerate(parts)}
        for (part_name, share), (_, part) in zip(shares.items(), parts, strict=True):
            part.set("id", part_name)
            part.set("probability", repr(share))
        self._name_parts_in_lists(name, shares)
        mix = next((element for element in self.elements if element.tag == MIX and vtype in list(element)), None)
        if mix is None:
            together = ET.Element(MIX, id=name)
            together.extend(part for _, part in parts)
            place = self.elements.index(vtype)
            self.elements[place] = together
        else:
            within = list(mix).index(vtype)
            mix.remove(vtype)
            for offset, (_, part) in enumerate(parts):
                part.set("probability", repr(own_share * float(part.get("probability", ""))))
                mix.insert(within + offset, part)
            if all(element.get("type") != name for element in self.elements if element.tag in MOVERS):
                return
            together, place = ET.Element(MIX, id=name), self.elements.index(mix)
            _set_list(together, shares)
            self.elements.insert(place + 1, together)
        together.tail = "\n"

    def _name_parts_in_lists(self, name: str, shares: Mapping[str, float]) -> None:
        """Name the parts of a vType in distributions that name it."""
        own = {
            one.get("id"): float(one.get("probability") or 1.0) for each in self.elements for one in each.iter("vType")
        }
        for mix in (element for element in self.elements if element.tag == MIX):
            listed = [
                (member, share)
                for member, share, inner in members_of(mix, "vType", lambda one: own.get(one, 1.0))
                if inner is None
            ]
            if name not in dict(listed):
                continue
            expanded: dict[str, float] = {}
            for member, share in listed:
                parts = shares if member == name else {member: 1.0}
                expanded |= {part: share * within for part, within in parts.items()}
            _set_list(mix, expanded)


def _set_list(mix: ET.Element, shares: Mapping[str, float]) -> None:
    mix.set("vTypes", " ".join(shares))
    mix.set("probabilities", " ".join(repr(share) for share in shares.values()))
