"""More or fewer vehicles in a file of SUMO's: rates of flows, and single vehicles left out or doubled."""

import math
import random
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path

from sim_adapters.scenario.demand_elements import HOURLY, NEVER_S, has_rate, rate_of
from sim_adapters.scenario.demand_file import vehicles_id
from sim_adapters.scenario.demand_windows import Windows, id_at
from sim_adapters.scenario.times import read_time_s

MOST_PROBABILITY = 1.0  # of a flow's vehicle in a second; SUMO takes no more
COPY = ".copy"


def scale_flow(element: ET.Element, factor: float) -> None:
    """Multiply a flow's rate, in whichever attribute it stands."""
    factor = float(factor)  # NumPy's numbers write their type as well
    period = (element.get("period") or "").strip()
    exponential = re.fullmatch(r"exp\(([^)]*)\)", period)
    hourly = next((key for key in HOURLY if element.get(key)), None)
    probability = element.get("probability")
    if element.get("number") and (exponential or period or hourly or probability or element.get("poisson")):
        element.set("number", str(round(float(element.get("number", "0")) * factor)))
    if exponential:
        element.set("period", f"exp({float(exponential.group(1)) * factor!r})")
    elif element.get("poisson"):
        element.set("poisson", repr(float(element.get("poisson", "0")) * factor))
    elif period:
        element.set("period", repr(float(period) / max(factor, 1e-9)))
    elif hourly:
        element.set(hourly, repr(float(element.get(hourly, "0")) * factor))
    elif probability:
        rate = float(probability) * factor
        if rate > MOST_PROBABILITY:  # one chance per second is not enough; random arrivals have no such bound
            del element.attrib["probability"]
            element.set("period", f"exp({rate!r})")
        else:
            element.set("probability", repr(rate))
    elif element.get("number"):
        element.set("number", str(round(float(element.get("number", "0")) * factor)))


def draw_phase(file: Path, element: ET.Element, seed: int) -> None:
    """Let a flow whose vehicles come at equal intervals begin anywhere within the first of them.

    Whom a drive meets on a road with little traffic depends on that phase, and the phase at the drive's time on each
    digit of the inflow: hours after its begin no log tells it.

    Args:
        file: where it stands, for messages.
        element: the flow; others than those at equal intervals, and one that would end before, stay as they are.
        seed: of the run.

    Raises:
        ScenarioError: a rate or time of the flow cannot be read.
    """
    rate = rate_of(file, element, 0.0, NEVER_S) if element.get("end") or has_rate(element) else None
    if rate is None or not rate.is_regular or rate.vehps <= 0.0:
        return
    shift_s = random.Random(f"{seed} {element.get('id')}").random() / rate.vehps
    if rate.begin_s + shift_s >= rate.end_s:
        return
    element.set("begin", repr(rate.begin_s + shift_s))
    if not has_rate(element):  # the window stretches a number of vehicles to its rate
        element.set("end", repr(rate.end_s + shift_s))


def scale_vehicles(
    elements: Sequence[ET.Element],
    factors: Mapping[str, float],
    entrance_of: Mapping[str, str],
    windows: Windows,
    counted: dict[str, int],
) -> list[ET.Element]:
    """Elements with single vehicles left out or doubled, evenly over those that enter at one edge.

    Vehicle k is there as often as `floor(f (k + 1) + 1/2) - floor(f k + 1/2)`: a factor of 1 leaves all as they are,
    and who stays with a factor stays with every larger one that is near it.

    Args:
        elements: of a file.
        factors: factor of each flow; single vehicles are the flow `vehicles_id` of their edge.
        entrance_of: edge at which each single vehicle enters, by id; others stay.
        windows: windows of time that cut flows.
        counted: how many have entered at each edge in the files before; those of this one are added.
    """
    scaled = []
    for element in elements:
        edge = entrance_of.get(element.get("id", "")) if element.tag in ("vehicle", "trip") else None
        if edge is None:
            scaled.append(element)
            continue
        depart_s = read_time_s(element.get("depart")) or 0.0  # triggered ones depart when somebody comes for them
        factor = factors.get(id_at(vehicles_id(edge), windows, depart_s), 1.0)
        number = counted.get(edge, 0)
        counted[edge] = number + 1
        copies = math.floor(factor * (number + 1) + 0.5) - math.floor(factor * number + 0.5)
        for copy in range(copies):
            scaled.append(_copy_of(element, copy) if copy else element)
    return scaled


def _copy_of(element: ET.Element, copy: int) -> ET.Element:
    """A vehicle like another, which departs with it, or as soon after as there is room."""
    twin = deepcopy(element)
    twin.set("id", f"{element.get('id', '')}{COPY}{copy}")
    depart_s = read_time_s(element.get("depart"))
    if depart_s is not None:
        twin.set("depart", repr(depart_s))
    return twin
