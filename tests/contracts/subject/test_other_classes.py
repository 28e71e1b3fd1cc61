"""The subject vehicle's driver among what else may be there: other classes, effects, lane changes that take time."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import ParameterLayout, RunRequest
from sim_adapters.scenario.scenario import read_scenario
from sim_adapters.sumo.driver import subject_control
from sim_adapters.sumo.surroundings import Surroundings, vehicle_arrays
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.effects.apply import NUM_CLASSES_OF_EFFECTS, with_memories
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import EFFECTS
from surrogate.effects.settings import Effects, settings_table
from surrogate.inflow.inflow import subject_identity
from surrogate.loop.moving import move_on
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import TrafficState, with_changes
from surrogate.subject.following import SubjectFollowing
from surrogate.subject.registry import SubjectModel
from surrogate.vehicle.lane_change_model import STAY
from tests.jit_marked import jit_marked
from tests.places import CORRIDOR

LAYOUT = ParameterLayout(("main",), (("f_main_o1", "f_main_e"),), ("car",), ("tau",))
DEPART_S, SEED, OWN_ROW = 1e6, 6, 1


def template_of(model: str, vtype_of_others: str = "car") -> WorldTemplate:
    scenario = read_scenario(CORRIDOR / "scenario/scenario.sumocfg", "ego", 720.0)
    for flow in scenario.flows[:1]:
        object.__setattr__(flow, "vtype", vtype_of_others)
    return build_template(scenario, LAYOUT, SubjectModel(model))


def world_of(template: WorldTemplate, effects: dict[str, EffectSetting]) -> World:
    values = jnp.asarray(template.base_values(), jnp.float32)
    table = Effects(jnp.asarray(settings_table(effects), jnp.float32)) if effects else None
    return template.world(values, jnp.asarray(SEED), jnp.asarray(DEPART_S, jnp.float32), table)


def test_others_of_the_subject_vehicle_s_vtype_are_not_taken_for_it() -> None:
    scenario = read_scenario(CORRIDOR / "scenario/scenario.sumocfg", "ego", 720.0)
    own_vtype = scenario.demand.subject_vtype
    template = template_of("planner", own_vtype)
    assert template.class_names[-1] == own_vtype
    assert own_vtype in template.class_names[:-1]
    request = RunRequest(tuple(template.base_values().tolist()), SEED, DEPART_S)
    control = subject_control(template, request, Clock(0.1, 10), 2)
    assert control is not None
    assert control.class_of_vtype[own_vtype] == template.class_names.index(own_vtype) < len(control.classes) - 1


@pytest.mark.parametrize("model", ["planner", "w99-vissim"])
def test_effects_add_classes_before_that_of_the_subject_vehicle(model: str) -> None:
    template = template_of(model)
    plain, full = (world_of(template, {e.name: EffectSetting(s) for e in EFFECTS[:n]}) for n, s in ((0, 0), (99, 0.1)))
    assert len(full.classes) == len(plain.classes) + NUM_CLASSES_OF_EFFECTS
    for world in (plain, full):
        assert world.subject.vehicle_class == world.subject_class == len(world.classes) - 1
        is_own = [isinstance(one.car_following, SubjectFollowing) for one in world.classes]
        assert is_own == [False] * (len(is_own) - 1) + [True]
    own, vtype = (world_of(template_of(name), {}).classes[-1].car_following for name in (model, "vtype"))
    assert own.draws_once_per_driver == (model == "w99-vissim")
    assert not own.habit_fields  # no effect makes a driver of a human kind of it
    np.testing.assert_allclose(own.max_deceleration_mps2, vtype.max_deceleration_mps2)


def test_both_simulators_key_its_random_numbers_alike() -> None:
    template = template_of("w99-sumo128")
    request = RunRequest(tuple(template.base_values().tolist()), SEED, DEPART_S)
    control = subject_control(template, request, Clock(0.1, 10), 2)
    assert control is not None
    assert control.seed == SEED
    assert control.identity == subject_identity(len(template.lane_row))


@pytest.mark.long
@pytest.mark.parametrize("has_effects", [False, True])
def test_a_planned_acceleration_goes_on_while_a_lane_change_takes_its_time(has_effects: bool) -> None:
    clock = Clock(0.1, 10, 4.0)
    world = world_of(template_of("planner"), {e.name: EffectSetting(e.weak) for e in EFFECTS} if has_effects else {})

    def advance(state: TrafficState, world: World) -> TrafficState:
        return move_on(settle_lanes(state, world, clock), world, clock.step_s, clock.steps_per_decision)

    # behind a slow vehicle, with nobody beside; the road's own traffic is far behind
    around = Surroundings(
        row=np.asarray([OWN_ROW, OWN_ROW]),
        position_m=np.asarray([500.0, 560.0]),
        speed_mps=np.asarray([18.0, 7.0]),
        acceleration_mps2=np.zeros(2),
        vehicle_class=np.asarray([world.subject_class, 0]),
        subject=0,
        speed_factor=1.0,
    )
    arrays, head, _ = vehicle_arrays(around, world.road.num_rows)
    vehicles = jax.tree.map(jnp.asarray, arrays)
    is_slow = vehicles.vehicle_class == 0
    vehicles = with_changes(vehicles, speed_factor=jnp.where(is_slow, 0.3, vehicles.speed_factor))
    if world.effects is not None:
        vehicles = with_memories(world.effects, vehicles, world.seed)
    state = initial_state(world, vehicles.row.shape[0], clock)
    state = eqx.tree_at(lambda s: (s.vehicles, s.head), state, (vehicles, jnp.asarray(head)), is_leaf=_is_none)
    program = jit_marked(advance).lower(state, world).compile()  # one: it refuses another type
    rows, num_changing = [], 0
    for _ in range(14):
        state = program(state, world)
        (entry,) = np.flatnonzero(world.is_subject(state.vehicles))
        assert state.manoeuvres is not None
        num_changing += int(state.manoeuvres.direction[entry]) != STAY
        rows.append(int(state.vehicles.row[entry]))
        assert np.isfinite(state.vehicles.own_advice_mps2[entry])
    assert num_changing >= 3
    assert rows[0] == OWN_ROW
    assert rows[-1] != OWN_ROW
    assert float(state.vehicles.speed_mps[entry]) > 15.0
    assert int(state.num_collisions) == 0


def _is_none(leaf: object) -> bool:
    return leaf is None
