"""What of roads and vehicles the surrogate does not read at all, named so that nobody takes it for followed."""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

from sim_adapters.scenario.finding import WITHOUT, Finding, Level

# Attributes of flows and vehicles, and the values with which they change nothing.
ATTRIBUTES = {
    "speedFactor": (), "arrivalPos": ("max",), "arrivalSpeed": ("current",), "arrivalLane": ("current",),
    "insertionChecks": ("all",),
}  # fmt: skip
CHANGES = ("changeLeft", "changeRight")
EVERYBODY = "all"


def road_findings(file: Path, root: ET.Element, edges: Collection[str], vclasses: Collection[str]) -> list[Finding]:
    """Findings on limits for some vehicle classes, and on forbidden lane changes.

    Args:
        file: the network, for messages.
        root: its root.
        edges: those on which there is traffic.
        vclasses: SUMO's classes of the traffic.
    """
    limits = {
        kind.get("id"): [one.get("vClass", "") for one in kind.iter("restriction") if one.get("vClass") in vclasses]
        for kind in root.iter("type")
    }
    by_class: Counter[str] = Counter()
    forbidden: Counter[str] = Counter()
    for edge in root.iter("edge"):
        if edge.get("id") not in edges:
            continue
        by_class.update(limits.get(edge.get("type"), ()))
        for lane in edge.iter("lane"):
            forbidden.update(name for name in CHANGES if _is_forbidden(lane.get(name), vclasses))
    findings = [
        Finding(Level.APPROXIMATED, file.name, f"<restriction> of vClass '{vclass}'",
                "a limit of its own: the surrogate takes that of the lane; SUMO runs with it", count)
        for vclass, count in by_class.items()
    ]  # fmt: skip
    return findings + [
        Finding(Level.APPROXIMATED, file.name, f"attribute '{name}' of <lane>", WITHOUT, count)
        for name, count in forbidden.items()
    ]


def _is_forbidden(allowed: str | None, vclasses: Collection[str]) -> bool:
    return allowed is not None and EVERYBODY not in allowed.split() and not set(vclasses) <= set(allowed.split())


def mover_findings(movers: Iterable[tuple[Path, ET.Element]]) -> list[Finding]:
    """Findings on stops and attributes of flows and vehicles; the first of a kind stands for all in its file."""
    first: dict[tuple[str, str], str] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for file, element in movers:
        kinds = ["<stop>"] if element.find(".//stop") is not None else []
        kinds += [name for name, usual in ATTRIBUTES.items() if element.get(name, "") not in ("", *usual)]
        for kind in kinds:
            first.setdefault((file.name, kind), f"{element.tag} '{element.get('id', '')}'")
            counts[file.name, kind] += 1
    return [
        Finding(Level.APPROXIMATED, file, first[file, kind], f"{kind}: {WITHOUT}", count)
        for (file, kind), count in counts.items()
    ]
