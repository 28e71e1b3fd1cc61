"""Flows cut at the times at which their demand may change, so that each window of time has a factor of its own."""

import xml.etree.ElementTree as ET
from bisect import bisect_right
from collections.abc import Iterable, Mapping
from copy import deepcopy
from pathlib import Path

from sim_adapters.scenario.demand_elements import NEVER_S, has_rate, rate_of
from sim_adapters.units import SECONDS_PER_HOUR

Windows = Mapping[str, tuple[float, ...]]  # begin of each window, in s, rising, by id of the flow that they cut


def window_id(flow: str, begin_s: float) -> str:
    """Name of the part of a flow, or of an input, that comes in the window which begins at a time."""
    return f"{flow}@{begin_s:g}"


def id_at(flow: str, windows: Windows, time_s: float) -> str:
    """Name of the part of a flow that comes at a time; the flow's own where nothing cuts it.

    What comes before the first window belongs to it.
    """
    begins_s = windows.get(flow, ())
    return window_id(flow, begins_s[max(bisect_right(begins_s, time_s) - 1, 0)]) if begins_s else flow


def parts_in_windows(flow: str, windows: Windows, known: Iterable[str]) -> tuple[str, ...]:
    """Those parts of a flow that a scenario has, in order; the flow itself where nothing cuts it."""
    there = set(known)
    begins_s = windows.get(flow, ())
    names = [window_id(flow, begin_s) for begin_s in begins_s] if begins_s else [flow]
    return tuple(name for name in names if name in there)


def cut_flows(file: Path, elements: Iterable[ET.Element], windows: Windows) -> list[ET.Element]:
    """The elements of a file with each flow that windows cut replaced by its parts.

    A part brings vehicles as its flow does; one that brings them evenly begins anew with its window.

    Args:
        file: where they stand, for messages.
        elements: of the file.
        windows: by flow.

    Raises:
        ScenarioError: a rate or time of a flow cannot be read.
    """
    cut = []
    for element in elements:
        begins_s = windows.get(element.get("id", ""), ()) if element.tag == "flow" else ()
        cut += _parts(file, element, begins_s) if begins_s else [element]
    return cut


def _parts(file: Path, element: ET.Element, begins_s: tuple[float, ...]) -> list[ET.Element]:
    whole = rate_of(file, element, 0.0, NEVER_S)
    parts = []
    for begin_s, until_s in zip(begins_s, (*begins_s[1:], NEVER_S), strict=True):
        first_s = whole.begin_s if begin_s == begins_s[0] else max(whole.begin_s, begin_s)
        last_s = min(whole.end_s, until_s)
        if last_s <= first_s:
            continue
        part = deepcopy(element)
        part.set("id", window_id(element.get("id", ""), begin_s))
        part.set("begin", repr(first_s))
        part.attrib.pop("end", None)
        if last_s < NEVER_S:
            part.set("end", repr(last_s))
        if part.attrib.pop("number", None) is not None and not has_rate(part):
            part.set("vehsPerHour", repr(whole.vehps * SECONDS_PER_HOUR))
        parts.append(part)
    return parts
