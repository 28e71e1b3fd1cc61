"""A contract over both simulators: the same planner in the same situation drives alike, frame by frame.

SUMO runs; the surrogate starts from one of its frames, with the vehicles that the subject vehicle sees there, and
drives on. There are few vehicles, so that all that matters is in that frame.
"""

import functools
import shutil
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout, RunRequest
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.sumo.driver import subject_control
from sim_adapters.sumo.job import SumoRun
from sim_adapters.sumo.simulator import SensorRange, SumoSimulator
from sim_adapters.sumo.surroundings import Surroundings, vehicle_arrays
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.moving import move_on
from surrogate.loop.run_state import RunPlan
from surrogate.loop.step import initial_state, look_up_lane, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import TrafficState, with_changes
from surrogate.subject.registry import SubjectModel
from tests.jit_marked import jit_marked
from tests.places import CORRIDOR

pytestmark = pytest.mark.long

CLOCK = Clock(step_s=0.1, steps_per_decision=10)
PLAN = RunPlan(CLOCK, 0, 5)
LAYOUT = ParameterLayout(("lead",), (("f_lead",),), ("slow",), ("tau",))
# A row of slow vehicles side by side, which cannot be passed; their speeds have no random part.
SLOW = (
    '<vType id="slow" length="4.8" carFollowModel="IDM" accel="1.5" decel="2.5" tau="1.2" minGap="2.0" maxSpeed="14.0"'
    ' speedFactor="1" speedDev="0" lcKeepRight="0" lcSpeedGain="0" lcStrategic="0" lcCooperative="0"/>'
)
FLOW = (
    '<flow id="f_lead" type="slow" route="r_main_e" begin="{begin}" end="{end}" number="9" departLane="best"'
    ' departPos="last" departSpeed="avg"/>'
)
END_S, DEPART_S = 130.0, 20.0
FEW_FRAMES = 6  # after the entry, until every vehicle is in its lane


def scenario_with(folder: Path, leaders_begin_s: float) -> Scenario:
    """Return the corridor with slow vehicles in all lanes as its only traffic."""
    shutil.copytree(CORRIDOR / "scenario", folder / "scenario")
    demand = folder / "scenario/demand.rou.xml"
    lines = [line for line in demand.read_text().splitlines() if "<flow" not in line]
    flow = FLOW.format(begin=leaders_begin_s, end=leaders_begin_s + 6.0)
    # SUMO wants departures in order
    lines = [line.replace('departSpeed="avg"', 'departSpeed="8"') if "<vehicle" in line else line for line in lines]
    place = next(index for index, line in enumerate(lines) if "<vehicle" in line) + (leaders_begin_s > DEPART_S)
    demand.write_text("\n".join([*lines[:1], SLOW, *lines[1:place], flow, *lines[place:]]))
    return read_scenario(folder / "scenario/scenario.sumocfg", "ego", END_S)


def simulator(scenario: Scenario, template: WorldTemplate) -> SumoSimulator:
    return SumoSimulator(
        scenario=scenario,
        layout=LAYOUT,
        fold=lambda frames: np.zeros(1),
        sensor=SensorRange(500.0, 150.0),
        subject_vehicle="ego",
        frame_interval_s=0.5,
        end_s=END_S,
        num_processes=1,
        control=lambda request: subject_control(template, request, CLOCK, PLAN.steps_before_decision),
    )


def run_in_sumo(scenario: Scenario, template: WorldTemplate) -> SumoRun:
    request = RunRequest(tuple(template.base_values().tolist()), 5, DEPART_S)
    with simulator(scenario, template) as engine:
        run = engine.begin(request).result()
    assert isinstance(run, SumoRun), run
    return run


@functools.cache
def stepping() -> Callable[[TrafficState, World], TrafficState]:
    """Return the program of one step."""

    def one_step(state: TrafficState, world: World) -> TrafficState:
        decides = state.step % CLOCK.steps_per_decision == PLAN.steps_before_decision
        state = jax.lax.cond(decides, lambda s: settle_lanes(s, world, CLOCK), lambda s: s, state)
        return move_on(state, world, CLOCK.step_s, 1)

    return jit_marked(one_step)


def run_in_surrogate(run: SumoRun, template: WorldTemplate, first: int) -> np.ndarray:
    """Return time, position, speed and row of the subject vehicle at each frame of SUMO from number `first` on."""
    times = np.unique(run.time_s)
    now = run.time_s == times[first]
    values = jnp.asarray(template.base_values(), jnp.float32)
    world = template.world(values, jnp.asarray(5), jnp.asarray(1e6))
    around = Surroundings(
        row=run.row[now],
        position_m=run.position_m[now],
        speed_mps=run.speed_mps[now],
        acceleration_mps2=run.acceleration_mps2[now],
        vehicle_class=np.where(run.vehicle[now] == -1, world.subject_class, 0),
        subject=int(np.flatnonzero(run.vehicle[now] == -1)[0]),
        speed_factor=1.0,
    )
    arrays, head, _ = vehicle_arrays(around, world.road.num_rows)
    vehicles = jax.tree.map(jnp.asarray, arrays)
    destination = template.flow_destination[0, 0]
    vehicles = with_changes(
        vehicles, destination=jnp.where(vehicles.vehicle_class == world.subject_class, 0, destination).astype(jnp.int32)
    )
    vehicles = look_up_lane(vehicles, VehiclesOnRoad(vehicles, world.road, jnp.asarray(head)))
    state = initial_state(world, vehicles.row.shape[0])
    # SUMO stamps a frame with the beginning of the step at whose end it is taken
    step = round(times[first] / CLOCK.step_s) + 1
    state = TrafficState(
        **{
            name: getattr(state, name)
            for name in TrafficState.__dataclass_fields__
            if name not in ("vehicles", "head", "step", "next_arrival")
        },
        vehicles=vehicles,
        head=jnp.asarray(head),
        step=jnp.asarray(step, jnp.int32),
        next_arrival=jnp.full_like(state.next_arrival, jnp.inf),
    )
    rows, one_step = [], stepping()
    for time in times[first:]:
        while int(state.step) < round(time / CLOCK.step_s) + 1:
            state = one_step(state, world)
        entry = int(np.argmax(np.asarray(state.vehicles.vehicle_class) == world.subject_class))
        own = state.vehicles
        rows.append([time, own.position_m[entry], own.speed_mps[entry], own.row[entry]])
    return np.asarray(rows, float)


def drive_of(run: SumoRun, first: int) -> np.ndarray:
    is_subject = run.vehicle == -1
    columns = (run.time_s, run.position_m, run.speed_mps, run.row)
    return np.stack([column[is_subject] for column in columns], axis=1)[first:]


# The planner's runs differ by the rounding of SUMO's output and of 32-bit numbers. A car-following model leaves lane
# changes to the simulators: they may fall one decision apart, which is 1 s at a difference in speed of 1 m/s.
TOLERANCES = {"planner": (0.02, 0.02), "aovrv": (1.0, 0.3)}


@pytest.mark.parametrize(
    ("name", "situation"),
    [("planner", "free road"), ("planner", "behind slow vehicles"), ("aovrv", "behind slow vehicles")],
)
def test_the_same_driver_drives_alike_in_both(name: str, situation: str, tmp_path: Path) -> None:
    # slow vehicles that enter later stay behind; those that enter before hold the subject vehicle up
    begin_s = DEPART_S + 10.0 if situation == "free road" else DEPART_S - 13.0
    scenario = scenario_with(tmp_path, begin_s)
    template = build_template(scenario, LAYOUT, SubjectModel(name))
    run = run_in_sumo(scenario, template)
    sumo, surrogate = drive_of(run, FEW_FRAMES), run_in_surrogate(run, template, FEW_FRAMES)
    is_held_up = sumo[-1, 2] < 15.0
    assert len(sumo) > 200
    assert is_held_up == (situation == "behind slow vehicles")
    position_m, speed_mps = TOLERANCES[name]
    np.testing.assert_allclose(surrogate[:, 1], sumo[:, 1], atol=position_m)
    np.testing.assert_allclose(surrogate[:, 2], sumo[:, 2], atol=speed_mps)
    if name == "planner":
        assert np.mean(surrogate[:, 3] == sumo[:, 3]) > 0.97  # a change is told one step later in SUMO


def test_a_vehicle_that_sumo_drives_is_not_touched(tmp_path: Path) -> None:
    """With the vType as the driver there is nothing to send to SUMO, so its runs are the bits that they always were."""
    template = build_template(scenario_with(tmp_path, DEPART_S + 10.0), LAYOUT)
    request = RunRequest(tuple(template.base_values().tolist()), 5, DEPART_S)
    assert subject_control(template, request, CLOCK, PLAN.steps_before_decision) is None
