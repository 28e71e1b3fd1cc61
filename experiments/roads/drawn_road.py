"""A drawn road as SUMO's network, by netconvert, and as a road on which cases are made."""

import math
import subprocess
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import sumolib
from pyproj import Geod

from experiments.roads.road import ROADS, Flow, Road
from experiments.roads.road_plan import RoadPlan, Section, draw_plan

DRAWN = "drawn-"  # names of drawn roads: this and the seed
ORIGIN_DEG = (11.5, 48.1)  # longitude and latitude of the first node
LANE_WIDTH_M = 3.75
RAMP_ANGLE_RAD = 0.12
SUBJECT_SHARE = 0.8  # of the limit that the subject vehicle drives: 20 m/s at 90 km/h, as on the known roads
WARMUP_S, DEPARTURES_S, STEP_S = 300.0, 100.0, 10.0
SLOWEST_MPS = 8.0  # mean speed of a drive that is still recorded whole
KMH_PER_MPS = 3.6


@cache
def find_road(name: str) -> Road:
    """Return a known road by its name, or the drawn one of a seed.

    Raises:
        ValueError: there is no such road.
        FileNotFoundError: netconvert is not installed.
    """
    if name in ROADS:
        return ROADS[name]
    seed = name.removeprefix(DRAWN)
    if seed == name or not seed.isdecimal():
        raise ValueError(f"road: expected {', '.join(ROADS)} or {DRAWN}SEED, got {name!r}.")
    plan = draw_plan(int(seed))
    return road_of(plan, write_network(plan, Path(_networks().name) / name))


def drawn_roads(number: int, seed: int) -> tuple[str, ...]:
    """Return the names of so many roads drawn at random, each with an on-ramp: effects are put into those."""
    rng = np.random.default_rng([seed, 29])
    names: list[str] = []
    while len(names) < number:
        road = int(rng.integers(2**31))
        if len(draw_plan(road).inputs_vehph) > 1:
            names.append(f"{DRAWN}{road}")
    return tuple(names)


@cache
def _networks() -> tempfile.TemporaryDirectory[str]:
    """Folder of drawn networks; it goes with the process."""
    return tempfile.TemporaryDirectory(prefix="drawn_roads_")


def write_network(plan: RoadPlan, folder: Path) -> Path:
    """Write a plan as netconvert's plain files and have the network made.

    Raises:
        FileNotFoundError: netconvert is not installed.
        RuntimeError: netconvert refused the files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, root in zip(("nod", "edg", "con"), _plain_files(plan), strict=True):
        ET.indent(root)
        (folder / f"plain.{name}.xml").write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
    network = folder / "net.net.xml"
    command = [
        sumolib.checkBinary("netconvert"), "-n", "plain.nod.xml", "-e", "plain.edg.xml", "-x", "plain.con.xml",
        "-o", network.name, "--proj.utm", "--no-turnarounds", "--offset.disable-normalization", "false",
    ]  # fmt: skip
    try:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise FileNotFoundError("netconvert is missing: pip install 'jaxcalib[studies]'.") from error
    if done.returncode:
        raise RuntimeError(f"netconvert on the road of seed {plan.seed}: {done.stderr.strip().splitlines()[-1]}")
    return network


def road_of(plan: RoadPlan, network: Path) -> Road:
    """Return the road on which cases are made."""
    edges = [_edge(number) for number in range(len(plan.sections))]
    length_m = sum(section.length_m for section in plan.sections)
    slow_s = length_m / SLOWEST_MPS
    first_on = next((n for n, section in enumerate(plan.sections) if section.on_ramp), len(edges))
    inner = range(1, len(edges) - 1)
    return Road(
        name=f"{DRAWN}{plan.seed}",
        net_file=network,
        ego_edges=tuple(edges),
        flows=tuple(_flows(plan, edges)),
        inputs_vehph=plan.inputs_vehph,
        local_edges=tuple(edges[n] for n in inner if plan.sections[n].on_ramp is None),
        edges_before_ramp=tuple(edges[n] for n in inner if n < max(first_on, 2)),
        warmup_s=WARMUP_S,
        duration_s=STEP_S * math.ceil((WARMUP_S + DEPARTURES_S + slow_s) / STEP_S),
        lane_width_m=LANE_WIDTH_M,
        subject_mps=round(SUBJECT_SHARE * plan.limit_kmh / KMH_PER_MPS, 2),
    )


def _edge(number: int) -> str:
    return f"m{number}"


def _flows(plan: RoadPlan, edges: list[str]) -> Iterator[Flow]:
    for entrance in plan.inputs_vehph:
        begin = 0 if entrance == "main" else next(n for n, s in enumerate(plan.sections) if s.on_ramp == entrance)
        before = () if entrance == "main" else (entrance,)
        stays = 1.0
        for number in range(begin, len(edges)):
            ramp = plan.sections[number].off_ramp
            if ramp:
                leaves = (*before, *edges[begin : number + 1], ramp)
                yield Flow(f"f_{entrance}_{ramp}", entrance, stays * plan.exit_shares[ramp], leaves)
                stays *= 1.0 - plan.exit_shares[ramp]
        yield Flow(f"f_{entrance}_end", entrance, stays, (*before, *edges[begin:]))


def _plain_files(plan: RoadPlan) -> tuple[ET.Element, ET.Element, ET.Element]:
    nodes, edges, connections = ET.Element("nodes"), ET.Element("edges"), ET.Element("connections")
    geod, heading_rad, ramp = Geod(ellps="WGS84"), math.radians(70.0), 0
    place_deg = ORIGIN_DEG

    def moved(from_deg: tuple[float, float], heading: float, length_m: float) -> tuple[float, float]:
        longitude, latitude, _ = geod.fwd(*from_deg, math.degrees(heading), length_m)
        return longitude, latitude

    def node(name: str, at_deg: tuple[float, float]) -> None:
        ET.SubElement(nodes, "node", id=name, x=f"{at_deg[0]:.7f}", y=f"{at_deg[1]:.7f}", type="priority")

    def ramp_edge(name: str, begin: str, end: str) -> None:
        own = {"id": name, "from": begin, "to": end, "priority": "5", "numLanes": "1", "spreadType": "right"}
        speed = {"speed": f"{plan.ramp_limit_kmh / KMH_PER_MPS:.2f}", "width": f"{LANE_WIDTH_M}"}
        ET.SubElement(edges, "edge", own | speed)

    node("n0", place_deg)
    for number, (section, bend_rad) in enumerate(zip(plan.sections, plan.bends_rad, strict=True)):
        begin_deg = place_deg
        heading_rad += bend_rad
        place_deg = moved(place_deg, heading_rad, section.length_m)
        node(f"n{number + 1}", place_deg)
        own = {"id": _edge(number), "from": f"n{number}", "to": f"n{number + 1}", "priority": "10"}
        lanes = {"numLanes": f"{section.lanes}", "speed": f"{plan.limit_kmh / KMH_PER_MPS:.2f}"}
        edge = ET.SubElement(edges, "edge", own | lanes | {"width": f"{LANE_WIDTH_M}", "spreadType": "right"})
        if section.on_ramp:
            if plan.marks_acceleration:
                ET.SubElement(edge, "lane", index="0", acceleration="1")
            node(
                f"b_{section.on_ramp}",
                moved(begin_deg, heading_rad + math.pi - RAMP_ANGLE_RAD, plan.ramp_lengths_m[ramp]),
            )
            ramp_edge(section.on_ramp, f"b_{section.on_ramp}", f"n{number}")
            ramp += 1
        if section.off_ramp:
            node(f"e_{section.off_ramp}", moved(place_deg, heading_rad + RAMP_ANGLE_RAD, plan.ramp_lengths_m[ramp]))
            ramp_edge(section.off_ramp, f"n{number + 1}", f"e_{section.off_ramp}")
            ramp += 1
    for number, (this, following) in enumerate(zip(plan.sections, plan.sections[1:], strict=False)):
        for begin, own_lane, end, lane in _links(number, this, following, plan.drops_left):
            own = {"from": begin, "to": end, "fromLane": f"{own_lane}", "toLane": f"{lane}"}
            ET.SubElement(connections, "connection", own)
    return nodes, edges, connections


def _links(number: int, this: Section, following: Section, drops_left: bool) -> Iterator[tuple[str, int, str, int]]:
    """Yield from which lane of which edge to which lane one gets: main lanes side by side, auxiliary ones by ramps."""
    here, there = _edge(number), _edge(number + 1)
    first = int(this.auxiliary)
    if this.off_ramp:
        yield here, 0, this.off_ramp, 0
    if this.kind == "drop" and not drops_left:
        first = 1
    if following.on_ramp:
        yield following.on_ramp, 0, there, 0
    into = int(following.auxiliary)
    for lane in range(following.lanes - into):
        yield here, first + lane, there, into + lane
