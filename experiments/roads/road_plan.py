"""A motorway drawn at random: what lies along it, and how much traffic its scenario believes in."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiments.roads.road import BELIEVED_DRIVER

Element = Literal["on", "off", "weave", "drop"]
LIMITS_KMH = (80.0, 100.0, 120.0, 130.0)
RAMP_LIMITS_KMH = (50.0, 60.0, 80.0)
RAMPS: tuple[Element, ...] = ("on", "off", "weave")
RAMP_CHANCES, DROP_CHANCE = (0.45, 0.3, 0.25), 0.4
DEMAND_SHARES = (0.6, 1.05)  # of the capacity of the section that is loaded most
RAMP_SHARES = (0.12, 0.4)  # inflow of an on-ramp over the capacity of a lane
EXIT_SHARES = (0.06, 0.2)  # of those on the main carriageway who leave
LEAST_MAIN_VEHPH = 500.0
LENGTHS_M: dict[str, tuple[float, float]] = {
    "entry": (80.0, 150.0), "plain": (200.0, 500.0), "on": (150.0, 350.0), "off": (150.0, 300.0),
    "weave": (250.0, 600.0), "drop": (150.0, 350.0), "ramp": (200.0, 350.0),
}  # fmt: skip


@dataclass(frozen=True)
class Section:
    """A stretch of the main carriageway with the same lanes."""

    kind: str  # "entry", "plain", or what it is an element of
    length_m: float  # its length
    lanes: int  # with auxiliary ones
    auxiliary: bool = False  # whether its rightmost lane is an acceleration, deceleration or weaving lane
    on_ramp: str | None = None  # ramp that enters at its begin
    off_ramp: str | None = None  # ramp that leaves at its end


@dataclass(frozen=True)
class RoadPlan:
    """A road to make; all of it follows from a seed."""

    seed: int  # of the drawing
    limit_kmh: float  # of the main carriageway
    ramp_limit_kmh: float  # of ramps
    lanes: int  # at the begin
    elements: tuple[Element, ...]  # along the road
    sections: tuple[Section, ...]  # main carriageway, first to last
    ramp_lengths_m: tuple[float, ...]  # of the ramps in the order of the road
    bends_rad: tuple[float, ...]  # by which each section turns
    marks_acceleration: bool  # whether acceleration lanes carry SUMO's attribute
    drops_left: bool  # whether a lane that ends is the leftmost
    exit_shares: dict[str, float]  # of those on the main carriageway, by ramp
    inputs_vehph: dict[str, float]  # inflow of each entrance, "main" first
    demand_share: float  # most load of a section over its capacity


def draw_plan(seed: int) -> RoadPlan:
    """Draw a road: two to four lanes, one to three ramps in any order, weaving, lane drops, 80 to 130 km/h."""
    rng = np.random.default_rng([seed, 17])
    lanes = int(rng.integers(2, 5))
    elements = _elements(rng, lanes)
    limit_kmh, ramp_limit_kmh = float(rng.choice(LIMITS_KMH)), float(rng.choice(RAMP_LIMITS_KMH))
    sections = _sections(rng, lanes, elements)
    on_ramps = [section.on_ramp for section in sections if section.on_ramp]
    exit_shares = {section.off_ramp: round(rng.uniform(*EXIT_SHARES), 3) for section in sections if section.off_ramp}
    demand_share = float(rng.uniform(*DEMAND_SHARES))
    capacity_vehph = lane_capacity_vehph(limit_kmh)
    ramps_vehph = {name: round(float(rng.uniform(*RAMP_SHARES)) * capacity_vehph, -1) for name in on_ramps}
    main_vehph = max(LEAST_MAIN_VEHPH, _main_inflow(sections, exit_shares, ramps_vehph, demand_share * capacity_vehph))
    return RoadPlan(
        seed=seed,
        limit_kmh=limit_kmh,
        ramp_limit_kmh=min(ramp_limit_kmh, limit_kmh),
        lanes=lanes,
        elements=elements,
        sections=sections,
        ramp_lengths_m=tuple(round(float(rng.uniform(*LENGTHS_M["ramp"])), 1) for _ in (*on_ramps, *exit_shares)),
        bends_rad=tuple(float(rng.uniform(-0.08, 0.08)) for _ in sections),
        marks_acceleration=bool(rng.integers(2)),
        drops_left=bool(rng.integers(2)),
        exit_shares=exit_shares,
        inputs_vehph={"main": round(main_vehph, -1)} | ramps_vehph,
        demand_share=round(demand_share, 3),
    )


def lane_capacity_vehph(limit_kmh: float) -> float:
    """Largest flow of a lane in which all keep IDM's equilibrium gap (Treiber et al. 2000, Eq. 4), believed drivers."""
    tau, least_gap, length, factor = (float(BELIEVED_DRIVER[n]) for n in ("tau", "minGap", "length", "speedFactor"))
    desired_mps = factor * limit_kmh / 3.6
    speed_mps = np.linspace(0.05, 0.98, 200) * desired_mps
    gap_m = (least_gap + tau * speed_mps) / np.sqrt(1.0 - (speed_mps / desired_mps) ** 4)
    return float(np.max(3600.0 * speed_mps / (gap_m + length)))


def _elements(rng: np.random.Generator, lanes: int) -> tuple[Element, ...]:
    drawn: list[Element] = []
    ramps = 0
    wanted = int(rng.integers(1, 4))
    while ramps < wanted:
        kind = RAMPS[int(rng.choice(len(RAMPS), p=RAMP_CHANCES))]
        if ramps + (2 if kind == "weave" else 1) <= 3:
            drawn.append(kind)
            ramps += 2 if kind == "weave" else 1
    if lanes > 2 and rng.uniform() < DROP_CHANCE:
        drawn.insert(int(rng.integers(len(drawn) + 1)), "drop")
    return tuple(drawn)


def _sections(rng: np.random.Generator, lanes: int, elements: tuple[Element, ...]) -> tuple[Section, ...]:
    def length_m(kind: str) -> float:
        return round(float(rng.uniform(*LENGTHS_M[kind])), 1)

    sections = [Section("entry", length_m("entry"), lanes), Section("plain", length_m("plain"), lanes)]
    entered = left = 0
    for element in elements:
        on_ramp = off_ramp = None
        if element in ("on", "weave"):
            entered += 1
            on_ramp = f"on{entered}"
        if element in ("off", "weave"):
            left += 1
            off_ramp = f"off{left}"
        extra = 0 if element == "drop" else 1
        sections.append(Section(element, length_m(element), lanes + extra, extra == 1, on_ramp, off_ramp))
        lanes -= 1 if element == "drop" else 0
        sections.append(Section("plain", length_m("plain"), lanes))
    sections.append(Section("plain", length_m("plain"), lanes))
    return tuple(sections)


def _main_inflow(
    sections: tuple[Section, ...], exit_shares: dict[str, float], ramps_vehph: dict[str, float], lane_vehph: float
) -> float:
    """Return the inflow at which no section is loaded more than this, and one as much."""
    stays, added, most = 1.0, 0.0, np.inf  # flow of a section = stays * main + added
    for section in sections:
        added += ramps_vehph.get(section.on_ramp or "", 0.0)
        most = min(most, (lane_vehph * (section.lanes - section.auxiliary) - added) / stays)
        kept = 1.0 - exit_shares.get(section.off_ramp or "", 0.0)
        stays, added = kept * stays, kept * added
    return float(most)
