"""The subject vehicle where SUMO scales all demand: once, as in the logs, neither doubled nor left out."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from copy import deepcopy

from sim_adapters.scenario.scenario import Scenario

UNSCALED = ".unscaled"


def subject_vtypes(scenario: Scenario) -> tuple[str, ...]:
    """Return the names that the subject vehicle's vType may have in written files."""
    vtype = scenario.demand.subject_vtype
    return vtype, vtype + UNSCALED


def unscaled_vtype(scenario: Scenario, roots: Iterable[ET.Element]) -> ET.Element | None:
    """Return a vType for the subject vehicle alone, of which SUMO takes one; None where its own does.

    SUMO multiplies its option `scale` with that of the vType.

    Args:
        scenario: as it was read.
        roots: of its route and additional files.
    """
    name, scale = scenario.demand.subject_vtype, scenario.configuration.scale
    own = float(scenario.demand.vtypes[name].get("scale") or 1.0)
    if scale * own == 1.0 or scale == 0.0:
        return None
    found = (one for root in roots for one in root.iter("vType") if one.get("id") == name)
    vtype = deepcopy(next(found, ET.Element("vType")))
    vtype.attrib.pop("probability", None)
    vtype.set("id", name + UNSCALED)
    vtype.set("scale", repr(1.0 / scale))
    return vtype
