"""Reads single elements of SUMO's demand: distributions, rates of flows, and how vehicles depart."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from sim_adapters.errors import ScenarioError
from sim_adapters.scenario.times import read_time_s
from sim_adapters.units import vehps_from_vehph

DEFAULT_VTYPE = "DEFAULT_VEHTYPE"  # SUMO's, of vehicles without a type
HOURLY = ("vehsPerHour", "perHour")
NEVER_S = 1e9


@dataclass(frozen=True)
class Departure:
    """How vehicles depart, in SUMO's words."""

    # departLane
    lane: str = "best_prob"  # SUMO 1.28's where nothing is said
    position: str = "base"  # departPos
    speed: str = "avg"  # departSpeed


@dataclass(frozen=True)
class Rate:
    """How many vehicles a flow brings."""

    vehps: float  # vehicles per second
    is_regular: bool  # whether they come evenly instead of at random
    begin_s: float  # when it begins
    end_s: float  # when it ends


def departure_of(element: ET.Element, options: Mapping[str, str]) -> Departure:
    """How the vehicles of a flow, vehicle or trip depart; `options` are those of the configuration."""
    usual = Departure()
    return Departure(
        lane=element.get("departLane", options.get("default.departlane", usual.lane)),
        position=element.get("departPos", usual.position),
        speed=element.get("departSpeed", options.get("default.departspeed", usual.speed)),
    )


def rate_of(file: Path, element: ET.Element, begin_s: float, end_s: float) -> Rate:
    """Rate and window of a flow.

    Args:
        file: where it stands, for messages.
        element: the flow.
        begin_s: begin of the simulation.
        end_s: its end, for flows that do not say when they end.

    Raises:
        ScenarioError: SUMO would not know how many vehicles come.
    """
    name = element.get("id", "")
    begin_s = time_of(file, element, "begin", begin_s)
    number = element.get("number")
    until_s = time_of(file, element, "end", NEVER_S if number else end_s)
    period = (element.get("period") or "").strip()
    hourly = next((element.get(key, "").strip() for key in HOURLY if element.get(key)), "")
    random = re.fullmatch(r"exp\(([^)]*)\)", period)
    if hourly.startswith("exp"):
        raise ScenarioError(file, f"flow '{name}': vehsPerHour: expected a number; SUMO knows exp(...) in period only.")
    if random:
        rate, is_regular = number_of(file, element, "period", random.group(1)), False
    elif element.get("poisson"):
        rate, is_regular = number_of(file, element, "poisson", element.get("poisson", "")), False
    elif period:
        rate, is_regular = 1.0 / max(number_of(file, element, "period", period), 1e-9), True
    elif hourly:
        rate, is_regular = vehps_from_vehph(number_of(file, element, "vehsPerHour", hourly)), True
    elif element.get("probability"):
        # one chance per second: at the rates of a road this is a Poisson stream
        rate, is_regular = number_of(file, element, "probability", element.get("probability", "")), False
    elif number:
        until_s = until_s if until_s < NEVER_S else end_s
        if until_s <= begin_s:
            raise ScenarioError(file, f"flow '{name}': expected an end after its begin, {begin_s:g} s.")
        return Rate(number_of(file, element, "number", number) / (until_s - begin_s), True, begin_s, until_s)
    else:
        raise ScenarioError(file, f"flow '{name}': expected period, vehsPerHour, probability or number.")
    if number and rate > 0.0:
        until_s = min(until_s, begin_s + number_of(file, element, "number", number) / rate)
    return Rate(rate, is_regular, begin_s, until_s)


def has_rate(element: ET.Element) -> bool:
    """Return whether a flow says how many vehicles come in a time."""
    return any(element.get(key) for key in ("period", "probability", "poisson", *HOURLY))


def is_number_alone(element: ET.Element) -> bool:
    """Return whether a flow says how many vehicles come, and not in which time."""
    return bool(element.get("number")) and not has_rate(element)


def members_of(
    element: ET.Element, tag: str, own_share: Callable[[str], float] = lambda _: 1.0
) -> list[tuple[str, float, ET.Element | None]]:
    """Members of a distribution: their ids, their probabilities, and their elements where they stand inside it.

    `own_share` is the probability of a member that stands elsewhere, where the distribution states none.
    """
    inner = [
        (child.get("id") or child.get("refId") or "", float(child.get("probability") or 1.0), child)
        for child in element
        if child.tag == tag
    ]
    names = (element.get(f"{tag}s") or "").replace(",", " ").split()
    shares = [float(text) for text in (element.get("probabilities") or "").replace(",", " ").split()]
    shares += [own_share(name) for name in names[len(shares) :]]
    return [*inner, *((name, share, None) for name, share in zip(names, shares, strict=False))]


def time_of(file: Path, element: ET.Element, attribute: str, otherwise_s: float) -> float:
    """A time of an element in seconds.

    Raises:
        ScenarioError: it is none.
    """
    text = element.get(attribute)
    seconds = otherwise_s if text is None else read_time_s(text)
    if seconds is None or not seconds >= 0.0:
        raise _expected(file, element, attribute, text or "", "a time")
    return seconds


def number_of(file: Path, element: ET.Element, attribute: str, text: str) -> float:
    """A number of an element.

    Raises:
        ScenarioError: it is none.
    """
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not 0.0 <= number < NEVER_S:
        raise _expected(file, element, attribute, text, "a number")
    return number


def _expected(file: Path, element: ET.Element, attribute: str, text: str, what: str) -> ScenarioError:
    name = element.get("id", "")
    return ScenarioError(file, f"<{element.tag}> '{name}': {attribute}: expected {what} >= 0, got '{text}'.")


def attribute_of(file: Path, element: ET.Element, attribute: str) -> str:
    """An attribute that must be there.

    Raises:
        ScenarioError: it is not.
    """
    value = element.get(attribute)
    if not value:
        raise ScenarioError(file, f"<{element.tag}> '{element.get('id', '')}': expected attribute '{attribute}'.")
    return value
