"""SUMO's vehicles beyond the sensors' range follow by another vType."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jaxcalib.errors import CaseError
from jaxcalib.problem.engines import sumo_engine, surrogate_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import RunOutcome, RunRequest
from sim_adapters.sumo.distant import DistantTypes, TypeSwitch
from tests.copies import copy_corridor

ALIKE = 'id="far" vClass="passenger" length="4.8" carFollowModel="IDM" accel="2.6" decel="4.5" tau="1.0" minGap="2.5" '
ALIKE += 'delta="4" speedFactor="1.0" speedDev="0.1"'
CAREFUL = ALIKE.replace('tau="1.0"', 'tau="3.0"')
TYPES = DistantTypes({"car": "far"}, ahead_m=100.0, behind_m=60.0, steps_per_decision=10, first_step=2)
NUM_RUNS = 4  # of the surrogate
START_M = {"a_0": (0, 0.0, True), "b_0": (1, 1000.0, True)}


class FakeSumo:
    """Vehicles at places, with types that can be set."""

    constants = SimpleNamespace(VAR_LANE_ID=1, VAR_LANEPOSITION=2, CMD_GET_VEHICLE_VARIABLE=3)

    def __init__(self, place_m: dict[str, float], vtype: dict[str, str]) -> None:
        self.place_m, self.vtype, self.vehicle = place_m, vtype, self
        self.subscribed: list[str] = []

    def subscribeContext(self, name: str, kind: int, radius_m: float, names: tuple[int, ...]) -> None:  # noqa: N802
        self.subscribed.append(name)

    def getContextSubscriptionResults(self, name: str) -> dict[str, dict[int, object]]:  # noqa: N802
        lane = {
            key: ("b_0", place - 1000.0) if place >= 1000.0 else ("a_0", place) for key, place in self.place_m.items()
        }
        return {key: {1: lane[key][0], 2: lane[key][1]} for key in self.place_m}

    def getIDList(self) -> tuple[str, ...]:  # noqa: N802
        return tuple(self.place_m)

    def getTypeID(self, name: str) -> str:  # noqa: N802
        return self.vtype[name]

    def setType(self, name: str, vtype: str) -> None:  # noqa: N802
        self.vtype[name] = vtype


def test_types_follow_the_distance_at_decisions() -> None:
    place_m = {"near": 1090.0, "ahead": 1101.0, "behind": 939.0, "van": 500.0}
    sumo = FakeSumo(place_m, {"near": "car", "ahead": "car", "behind": "car", "van": "van"})
    switch = TypeSwitch(sumo, TYPES, "ego", 200.0, START_M)
    switch.departed(("near", "ahead", "behind", "van"))
    switch.before_step(1)
    assert set(sumo.vtype.values()) == {"car", "van"}  # no decision yet
    switch.before_step(2)
    assert [sumo.vtype[name] for name in ("near", "ahead", "behind", "van")] == ["far", "far", "far", "van"]

    place_m["ego"], sumo.vtype["ego"] = 1000.0, "car"
    switch.departed(("ego",))
    assert sumo.subscribed == ["ego"]
    switch.before_step(12)
    assert [sumo.vtype[name] for name in ("near", "ahead", "behind", "ego")] == ["car", "far", "far", "car"]
    place_m |= {"ego": 1002.0, "behind": 941.0}  # one has come into range ahead, one has fallen out of it behind
    switch.before_step(22)
    assert [sumo.vtype[name] for name in ("near", "ahead", "behind", "ego")] == ["car", "car", "far", "car"]
    del place_m["ahead"]  # it has left the road
    place_m["near"] = 1103.0
    switch.before_step(32)
    assert [sumo.vtype[name] for name in ("near", "ahead", "behind")] == ["far", "car", "far"]


def problem_with(far: str | None, folder: Path) -> CalibrationProblem:
    """Return the corridor, in which distant vehicles may be of a vType of their own."""
    copy_corridor(folder, "d01", "d02")
    case, demand = folder / "case.toml", folder / "scenario/demand.rou.xml"
    if far is not None:
        case.write_text(case.read_text().replace("[behaviour]", '[behaviour]\ndistant_vtypes = { car = "far" }'))
        demand.write_text(demand.read_text().replace("<vType id=", f"<vType {far}/>\n<vType id=", 1))
    return read_problem(folder)


def in_sumo(problem: CalibrationProblem) -> RunOutcome:
    values = tuple(problem.template.base_values().tolist())
    with sumo_engine(problem, 1) as sumo:
        return sumo.run([RunRequest(values, 3, problem.case.drives[0].depart_s)])[0]


@pytest.mark.long
def test_distant_vehicles_drive_as_they_are_told_in_both_simulators(tmp_path: Path) -> None:
    plain = problem_with(None, tmp_path / "plain")
    alike = problem_with(ALIKE, tmp_path / "alike")
    careful = problem_with(CAREFUL, tmp_path / "careful")
    one, same, other = in_sumo(plain), in_sumo(alike), in_sumo(careful)
    assert one.observed is not None
    np.testing.assert_array_equal(one.observed, same.observed)  # to the bit: to change over disturbs nobody
    assert one.num_vehicle_steps == same.num_vehicle_steps
    # time gaps of 3 s leave no room for the traffic: it waits at the entrances, and drives for longer
    assert other.num_inserted.sum() < 0.9 * other.num_arrived.sum()
    assert any("distant_vtypes" in line for line in careful.warnings())

    values = tuple(careful.template.base_values().tolist())
    requests = [RunRequest(values, seed, careful.case.drives[0].depart_s) for seed in range(NUM_RUNS)]
    told = surrogate_engine(careful, runs_per_device=NUM_RUNS).run(requests)
    inserted, arrived = (np.sum([getattr(run, name) for run in told]) for name in ("num_inserted", "num_arrived"))
    assert inserted / arrived == pytest.approx(other.num_inserted.sum() / other.num_arrived.sum(), abs=0.08)
    steps = np.mean([run.num_vehicle_steps for run in told])
    assert steps == pytest.approx(other.num_vehicle_steps, rel=0.15)
    assert steps > 1.2 * one.num_vehicle_steps


def test_a_distant_vtype_that_cannot_be_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CaseError, match="length"):
        problem_with(ALIKE.replace("4.8", "7.1"), tmp_path / "longer")
