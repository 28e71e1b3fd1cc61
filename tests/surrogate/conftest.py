"""The corridor as a world of the surrogate, and one compiled decision of it that the tests share."""

from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.effects.settings import Effects
from surrogate.loop.moving import move_on
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import TrafficState

CAPACITY = 288
CLOCK = Clock(step_s=0.1, steps_per_decision=10)


@pytest.fixture(scope="session")
def corridor_folder() -> Path:
    return Path(__file__).resolve().parents[2] / "experiments/cases/corridor"


@pytest.fixture(scope="session")
def corridor(corridor_folder: Path) -> Scenario:
    return read_scenario(corridor_folder / "scenario/scenario.sumocfg", corridor_folder, "ego", 720.0)


@pytest.fixture(scope="session")
def layout() -> ParameterLayout:
    return ParameterLayout(
        input_ids=("main", "on1"),
        input_flows=(("f_main_o1", "f_main_e"), ("f_on1_o1", "f_on1_e")),
        vtypes=("car",),
        attributes=("tau", "minGap", "accel", "speedFactor", "lcStrategic"),
    )


@pytest.fixture(scope="session")
def template(corridor: Scenario, layout: ParameterLayout) -> WorldTemplate:
    return build_template(corridor, layout)


@pytest.fixture(scope="session")
def corridor_world(template: WorldTemplate) -> Callable[..., World]:
    """Return a function that makes a world of the corridor from named parameters; the others are the scenario's."""

    def make(seed: int, depart_s: float, effects: Effects | None = None, **changes: float) -> World:
        values = dict(zip(template.layout.names, template.base_values(), strict=True))
        assert not set(changes) - set(values)
        vector = jnp.asarray(list((values | changes).values()), jnp.float32)
        return template.world(vector, jnp.asarray(seed, jnp.int32), jnp.asarray(depart_s, jnp.float32), effects)

    return make


@pytest.fixture(scope="session")
def drive_on() -> Callable[[World, int], list[TrafficState]]:
    """Return a function that runs a world from the empty road and keeps the state after every decision interval."""

    def advance(state: TrafficState, world: World) -> TrafficState:
        return move_on(settle_lanes(state, world, CLOCK), world, CLOCK.step_s, CLOCK.steps_per_decision)

    decide = jax.jit(advance)
    begin = jax.jit(lambda world: initial_state(world, CAPACITY))

    def run(world: World, num_decisions: int) -> list[TrafficState]:
        states = [begin(world)]
        for _ in range(num_decisions):
            states.append(decide(states[-1], world))
        return [jax.device_get(state) for state in states]

    return run
