"""What is measured in SUMO through frames is what SUMO itself says of the same run.

SUMO is run twice with the same seed: once by the engine, which sees a frame of the vehicles around the subject vehicle
every 0.5 s, and once alone, with SUMO's own outputs of every vehicle at every step of 0.1 s.
"""

import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sumolib

from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.interface import RunOutcome, RunRequest, Status
from sim_adapters.scenario.scenario_writer import write_scenario
from sim_adapters.sumo.job import SumoRun
from surrogate.road.perception import PerceptionFrame

pytestmark = pytest.mark.long

CHANGES = {"main": 2400.0, "on1": 900.0, "tau": 1.2, "speedFactor": 1.1, "speedDev": 0.2, "lcSpeedGain": 2.0}
SEED, DEPART_S, END_S = 3, 120.0, 300.0
RANGE_M, LENGTH_M = 150.0, 4.8


@dataclass(frozen=True)
class Observed:
    """The run as the engine saw it."""

    run: SumoRun
    frames: PerceptionFrame
    outcome: RunOutcome
    tally: dict[str, float]


@dataclass(frozen=True)
class Stated:
    """The run as SUMO states it.

    Attributes:
        vehicles: every vehicle on the carriageway at every step; offset_m is counted from the subject vehicle.
        changes: lane changes, their place counted along the route.
        leaders: what is ahead of the subject vehicle at every step.
        trip: the subject vehicle's trip.
        edges: begin, end and number of lanes of the edges of the route.
    """

    vehicles: pd.DataFrame
    changes: pd.DataFrame
    leaders: pd.DataFrame
    trip: dict[str, float]
    edges: list[tuple[float, float, int]]


def read_lanes(folder: Path) -> tuple[dict[str, float], list[tuple[float, float, int]]]:
    """Return where each lane begins along the subject vehicle's route, and the edges of the route."""
    net = sumolib.net.readNet(str(folder / "net.net.xml"), withInternal=True)
    routes = {route.get("id"): route.get("edges") for route in ET.parse(folder / "demand.rou.xml").iter("route")}
    edges = [net.getEdge(name) for name in routes["r_ego"].split()]
    begins, stretches, begin_m = {}, [], 0.0
    for edge, following in pairwise([*edges, None]):
        end_m = begin_m + edge.getLength()
        crossing_m = 0.0
        for lane in edge.getLanes():
            begins[lane.getID()] = begin_m
            for connection in lane.getOutgoing():
                begins[connection.getViaLaneID()] = end_m  # what lies on a junction belongs to the edge before it
                if connection.getTo() is following:
                    crossing_m = max(crossing_m, net.getLane(connection.getViaLaneID()).getLength())
        stretches.append((begin_m, end_m + crossing_m, len(edge.getLanes())))
        begin_m = end_m + crossing_m
    return begins, stretches


@pytest.fixture(scope="module")
def request_made(problem: CalibrationProblem) -> RunRequest:
    values = dict(zip(problem.layout.names, problem.template.base_values().tolist(), strict=True))
    assert set(CHANGES) <= set(values)
    return RunRequest(tuple((values | CHANGES).values()), SEED, DEPART_S)


@pytest.fixture(scope="module")
def both(
    problem: CalibrationProblem,
    request_made: RunRequest,
    corridor_folder: Path,
    start_sumo: Callable[..., subprocess.Popen],
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Observed, Stated]:
    """Both runs are made at the same time."""
    folder = tmp_path_factory.mktemp("plain")
    written = write_scenario(problem.scenario, problem.layout, request_made.values, DEPART_S, "ego", folder)
    alone = start_sumo(
        END_S,
        "ego",
        folder / "leaders.csv",
        *("-c", written.config, "--seed", str(SEED), "--precision", "6"),
        *("--fcd-output", folder / "fcd.csv", "--device.fcd.begin", str(DEPART_S)),
        *("--fcd-output.attributes", "id,lane,pos,speed"),
        *("--lanechange-output", folder / "changes.xml", "--tripinfo-output", folder / "trips.xml"),
    )
    with sumo_engine(problem, num_processes=1) as engine:
        run = engine.begin(request_made).result()
        assert isinstance(run, SumoRun), run
        outcome, frames = engine.outcome_of(request_made, run), engine.frames_of(run)
    tally = dict(zip(problem.tally_names, outcome.observed, strict=True))
    assert alone.wait() == 0
    return Observed(run, frames, outcome, tally), stated(folder, corridor_folder / "scenario")


def stated(folder: Path, scenario: Path) -> Stated:
    begins, edges = read_lanes(scenario)
    vehicles = pd.read_csv(folder / "fcd.csv", sep=";").dropna(subset=["vehicle_id"])
    vehicles.columns = [name.split("_")[-1] for name in vehicles.columns]  # time, id, lane, pos, speed
    vehicles["step"] = (vehicles["time"] * 10).round().astype(int)
    vehicles["place_m"] = vehicles["lane"].map(begins) + vehicles["pos"]
    vehicles = vehicles.dropna(subset=["place_m"])
    ego_m = vehicles[vehicles["id"] == "ego"].set_index("step")["place_m"]
    vehicles = vehicles[vehicles["step"].isin(ego_m.index)]
    vehicles = vehicles.assign(offset_m=vehicles["place_m"] - vehicles["step"].map(ego_m))

    changes = pd.DataFrame([change.attrib for change in ET.parse(folder / "changes.xml").getroot()])
    changes["step"] = (changes["time"].astype(float) * 10).round().astype(int)
    changes["place_m"] = changes["to"].map(begins) + changes["pos"].astype(float)
    changes["offset_m"] = changes["place_m"] - changes["step"].map(ego_m)
    changes["dir"] = changes["dir"].astype(int)
    (trip,) = (trip for trip in ET.parse(folder / "trips.xml").getroot() if trip.get("id") == "ego")
    numbers = {name: float(trip.get(name, "nan")) for name in ("duration", "routeLength", "depart", "arrival")}
    return Stated(vehicles, changes, pd.read_csv(folder / "leaders.csv", sep=";"), numbers, edges)


@pytest.fixture(scope="module")
def observed(both: tuple[Observed, Stated]) -> Observed:
    return both[0]


@pytest.fixture(scope="module")
def sumo(both: tuple[Observed, Stated]) -> Stated:
    return both[1]


def in_range(sumo: Stated) -> pd.DataFrame:
    return sumo.vehicles[sumo.vehicles["offset_m"].abs() <= RANGE_M]


def test_the_run_is_worth_measuring(observed: Observed, sumo: Stated):
    assert observed.outcome.status is Status.OK
    assert observed.outcome.num_teleports == observed.outcome.num_collisions == 0
    assert sumo.trip["arrival"] < END_S
    assert observed.outcome.subject_left
    assert observed.tally["cut_ins"] >= 3
    assert observed.tally["overtakes"] >= 5


def test_both_runs_are_the_same_run(observed: Observed, sumo: Stated):
    """Places are written with 1e-6 m; the network states lengths of lanes with 0.01 m."""
    at_frames = in_range(sumo)
    at_frames = at_frames[at_frames["step"] % 5 == 0]
    frames = observed.frames
    assert len(at_frames) == int(frames.object_valid.sum())
    seen_m = (frames.object_offset_m + frames.subject_position_m[:, None])[frames.object_valid]
    np.testing.assert_allclose(np.sort(seen_m), np.sort(at_frames["place_m"]), atol=0.01)
    np.testing.assert_allclose(
        np.sort(frames.object_speed_mps[frames.object_valid]), np.sort(at_frames["speed"]), atol=1e-5
    )


def test_travel_time_and_speed_of_the_subject_vehicle(observed: Observed, sumo: Stated, problem: CalibrationProblem):
    """The first frame comes up to 0.5 s after the departure, the last one up to 0.5 s before the arrival."""
    travel_s = problem.measures["subject_travel_time_s"].value(observed.tally).value
    assert -1.0 <= travel_s - sumo.trip["duration"] <= 1e-3
    speed = problem.measures["subject_speed_mps"].value(observed.tally).value
    assert speed == pytest.approx(sumo.trip["routeLength"] / sumo.trip["duration"], rel=0.005)


def test_speed_density_and_volume_of_the_traffic(observed: Observed, sumo: Stated, problem: CalibrationProblem):
    """Every fifth step is seen: vehicles come and go in the range by less than 1 % of those in it."""
    near = in_range(sumo)
    ego_m = sumo.vehicles.loc[sumo.vehicles["id"] == "ego", "place_m"].to_numpy()
    lane_m = 0.0
    for begin_m, end_m, num_lanes in sumo.edges:
        seen_m = np.minimum(ego_m + RANGE_M, end_m) - np.maximum(ego_m - RANGE_M, begin_m)
        lane_m += num_lanes * np.maximum(seen_m, 0.0).sum()
    expected = {
        "traffic_speed_mps": near["speed"].mean(),
        "traffic_density_vehpkm": 1000 * len(near) / lane_m,
        "traffic_volume_vehph": 3600 * near["speed"].sum() / lane_m,
    }
    for name, value in expected.items():
        assert problem.measures[name].value(observed.tally).value == pytest.approx(value, rel=0.01), name


def test_headway_and_gap_of_the_subject_vehicle(observed: Observed, sumo: Stated, problem: CalibrationProblem):
    """SUMO's own leader at every step; headways change slowly against 0.5 s."""
    leaders = sumo.leaders
    spacing_m = leaders["gap_m"] + LENGTH_M
    follows = (spacing_m <= RANGE_M) & (leaders["speed_mps"] > 2.0) & (spacing_m < 6.0 * leaders["speed_mps"])
    headway = problem.measures["subject_time_headway_s"].value(observed.tally)
    assert headway.num_observations == pytest.approx(follows.sum() / 5, abs=3)
    expected = (spacing_m / leaders["speed_mps"])[follows].mean()
    assert headway.value == pytest.approx(expected, rel=0.01)
    gap = problem.measures["subject_time_gap_s"].value(observed.tally).value
    assert gap == pytest.approx((leaders["gap_m"] / leaders["speed_mps"])[follows].mean(), rel=0.01)


def seen_changes(sumo: Stated) -> pd.DataFrame:
    """Return the lane changes of vehicles that are in range in the frames before and after.

    A frame shows where a vehicle is after the step's lane changes, so the change of step 5 k + 1 to 5 k + 5 is the one
    between frames k and k + 1. Two changes of a vehicle between two frames are one.
    """
    near = in_range(sumo)
    seen = set(zip(near["id"], near["step"], strict=True))
    after = -(-sumo.changes["step"] // 5) * 5
    is_seen = [
        (name, step - 5) in seen and (name, step) in seen for name, step in zip(sumo.changes["id"], after, strict=True)
    ]
    changes = sumo.changes.assign(frame=after)[is_seen]
    net = changes.groupby(["id", "frame"], as_index=False)["dir"].sum()
    return net[net["dir"] != 0]


def test_lane_changes(observed: Observed, sumo: Stated):
    changes = seen_changes(sumo)
    by_ego = changes["id"] == "ego"
    assert (~by_ego).sum() >= 20
    assert by_ego.sum() >= 1
    assert observed.tally["subject_lane_changes"] == by_ego.sum()
    assert observed.tally["subject_lane_changes_left"] == (changes[by_ego]["dir"] > 0).sum()
    assert observed.tally["background_lane_changes"] == (~by_ego).sum()
    assert observed.tally["background_lane_changes_left"] == (changes[~by_ego]["dir"] > 0).sum()
    # Lost are the changes of vehicles that have only just come from the ramp or into the range, and those that are
    # taken back within 0.5 s: SUMO lets vehicles change lane at every step.
    at_once = sumo.changes[(sumo.changes["offset_m"].abs() <= RANGE_M) & (sumo.changes["id"] != "ego")]
    assert 0.8 * len(at_once) <= observed.tally["background_lane_changes"] <= len(at_once)


def test_cut_ins(observed: Observed, sumo: Stated):
    """A vehicle that changes lane and is the subject vehicle's leader in the next frame, but was not before."""
    changes = seen_changes(sumo)
    leader = dict(zip((sumo.leaders["time_s"] * 10).round().astype(int), sumo.leaders["leader"], strict=True))
    by_ego = set(changes.loc[changes["id"] == "ego", "frame"])
    others = changes[changes["id"] != "ego"]
    expected = [
        (name, frame)
        for name, frame in zip(others["id"], others["frame"], strict=True)
        if leader.get(frame) == name != leader.get(frame - 5) and frame not in by_ego
    ]
    assert observed.tally["cut_ins"] == len(expected)


def test_overtaking(observed: Observed, sumo: Stated):
    """Offsets from the subject vehicle that change sign from frame to frame."""
    at_frames = in_range(sumo)
    at_frames = at_frames[(at_frames["step"] % 5 == 0) & (at_frames["id"] != "ego")].sort_values(["id", "step"])
    follows_on = (at_frames["id"] == at_frames["id"].shift()) & (at_frames["step"] == at_frames["step"].shift() + 5)
    was_behind, is_behind = at_frames["offset_m"].shift() < 0, at_frames["offset_m"] < 0
    assert observed.tally["overtaken"] == (follows_on & was_behind & ~is_behind).sum()
    assert observed.tally["overtakes"] == (follows_on & ~was_behind & is_behind).sum()
