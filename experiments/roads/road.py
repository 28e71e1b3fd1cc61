"""The roads on which field cases are made: network, routes, inflows, and the scenario that engineers believe in."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import sumolib

HERE = Path(__file__).parent
BELIEVED_DRIVER = {
    "vClass": "passenger", "length": "4.8", "carFollowModel": "IDM", "accel": "1.4", "decel": "2.0", "tau": "1.1",
    "minGap": "2.0", "delta": "4", "speedFactor": "0.97", "speedDev": "0.07", "lcStrategic": "3.0",
    "lcSpeedGain": "1.0", "lcAssertive": "1.3", "lcCooperative": "0.3", "lcCooperativeSpeed": "0.3",
    "lcKeepRight": "0.1",
}  # fmt: skip
SUBJECT = {
    "vClass": "passenger", "length": "4.8", "carFollowModel": "IDM", "accel": "1.5", "decel": "2.0", "tau": "1.5",
    "minGap": "2.0", "maxSpeed": "20.0", "speedFactor": "1", "speedDev": "0", "lcKeepRight": "0", "lcSpeedGain": "5",
    "lcSpeedGainRight": "0.5", "lcAssertive": "1.3",
}  # fmt: skip


@dataclass(frozen=True)
class Flow:
    """Vehicles with one route."""

    id: str  # in demand.rou.xml
    entrance: str  # the input that it belongs to
    share: float  # of that input
    edges: tuple[str, ...]  # route


@dataclass(frozen=True)
class LanePlace:
    """Where a lane lies on the subject vehicle's route."""

    begin_m: float  # distance of its begin from the route's begin
    from_left: int  # 0 = leftmost
    number: int  # 1 = rightmost
    edge: str  # edge, or the one before it inside a junction


@dataclass(frozen=True)
class Road:
    """A road."""

    name: str  # of the road
    net_file: Path  # SUMO network
    ego_edges: tuple[str, ...]  # route of the subject vehicle; the first one is the entry
    flows: tuple[Flow, ...]  # background traffic
    inputs_vehph: dict[str, float]  # inflows of the scenario
    local_edges: tuple[str, ...]  # edges on which an effect may have its place
    edges_before_ramp: tuple[str, ...]  # those of them upstream of the on-ramp
    warmup_s: float = 300.0  # before the first drive
    duration_s: float = 720.0  # of a run
    lane_width_m: float = 3.75  # the same everywhere
    subject_mps: float = 20.0  # at most driven by the subject vehicle

    @property
    def subject(self) -> dict[str, str]:
        """Attributes of the subject vehicle's vType."""
        return SUBJECT | {"maxSpeed": f"{self.subject_mps}"}

    @cached_property
    def net(self) -> sumolib.net.Net:
        """The network, with junctions' lanes."""
        return sumolib.net.readNet(str(self.net_file), withInternal=True)

    @cached_property
    def places(self) -> dict[str, LanePlace]:
        """Return the places of the lanes along the subject vehicle's route."""
        places: dict[str, LanePlace] = {}
        begin_m = 0.0
        for number, name in enumerate(self.ego_edges):
            edge = self.net.getEdge(name)
            lanes = edge.getLanes()
            for index, lane in enumerate(lanes):
                places[lane.getID()] = LanePlace(begin_m, len(lanes) - 1 - index, index + 1, name)
            begin_m += edge.getLength()
            if number + 1 == len(self.ego_edges):
                continue
            inside_m = 0.0
            for links in edge.getOutgoing().get(self.net.getEdge(self.ego_edges[number + 1]), []):
                inside = self.net.getLane(links.getViaLaneID()) if links.getViaLaneID() else None
                if inside is not None:
                    index = links.getFromLane().getIndex()
                    places[inside.getID()] = LanePlace(begin_m, len(lanes) - 1 - index, index + 1, name)
                    inside_m = max(inside_m, inside.getLength())
            begin_m += inside_m
        return places

    @cached_property
    def bends(self) -> tuple[np.ndarray, np.ndarray]:
        """Return places along the route and the road's heading in rad there."""
        places: list[float] = []
        headings: list[float] = []
        for name in self.ego_edges:
            lane = self.net.getEdge(name).getLanes()[-1]
            shape = np.asarray(lane.getShape())
            steps = np.diff(shape, axis=0)
            along = np.cumsum(np.hypot(*steps.T))
            middles = (along - 0.5 * np.hypot(*steps.T)) * lane.getLength() / along[-1]
            places += list(self.places[lane.getID()].begin_m + middles)
            headings += list(np.arctan2(steps[:, 1], steps[:, 0]))
        return np.asarray(places), np.unwrap(headings)

    def place_m(self, edge: str) -> tuple[float, float]:
        """Return begin and end of an edge, from the end of the entry edge on."""
        entry_m = self.net.getEdge(self.ego_edges[0]).getLength()
        begin_m = self.places[f"{edge}_0"].begin_m - entry_m
        return round(begin_m, 1), round(begin_m + self.net.getEdge(edge).getLength(), 1)

    def lanes_of(self, edge: str) -> tuple[str, ...]:
        """Return the lanes of an edge, rightmost first."""
        return tuple(lane.getID() for lane in self.net.getEdge(edge).getLanes())

    def limit_mps(self, edge: str) -> float:
        """Return the legal limit."""
        return float(self.net.getEdge(edge).getSpeed())


def _edges(names: str) -> tuple[str, ...]:
    return tuple(names.split())


ROADS: dict[str, Road] = {
    "corridor": Road(
        "corridor",
        HERE.parent / "cases" / "corridor" / "scenario" / "net.net.xml",
        _edges("in0 m0 m1 m2 m3 m4 m5 m6 m7 m8"),
        (
            Flow("f_main_o1", "main", 0.12, _edges("in0 m0 m1 m2 m3 m4 m5 m6 off1")),
            Flow("f_main_e", "main", 0.88, _edges("in0 m0 m1 m2 m3 m4 m5 m6 m7 m8")),
            Flow("f_on1_o1", "on1", 0.12, _edges("in1 on1 m3 m4 m5 m6 off1")),
            Flow("f_on1_e", "on1", 0.88, _edges("in1 on1 m3 m4 m5 m6 m7 m8")),
        ),
        {"main": 3900.0, "on1": 520.0},
        _edges("m1 m2 m4 m5 m7"),
        _edges("m1 m2"),
    ),
    "two_lane": Road(
        "two_lane",
        HERE / "two_lane" / "net.net.xml",
        _edges("in0 m0 m1 m2 m3 m4 m5 m6 m7"),
        (
            Flow("f_main_o1", "main", 0.15, _edges("in0 m0 m1 off1")),
            Flow("f_main_e", "main", 0.85, _edges("in0 m0 m1 m2 m3 m4 m5 m6 m7")),
            Flow("f_on1_e", "on1", 1.0, _edges("in1 on1 m3 m4 m5 m6 m7")),
        ),
        {"main": 2700.0, "on1": 420.0},
        _edges("m2 m4 m5 m6"),
        _edges("m2"),
    ),
}
