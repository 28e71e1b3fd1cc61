"""The corridor's engine, and the same with effects: tests share them and what is compiled for them."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from sim_adapters.jax.simulator import JaxSimulator
    from sim_adapters.world.world_builder import WorldTemplate


@pytest.fixture(scope="session")
def simulator(template: "WorldTemplate") -> "JaxSimulator":
    from tests.sim_adapters.jax.frame_trace import corridor_engine

    return corridor_engine(template)


@pytest.fixture(scope="session")
def with_effects(simulator: "JaxSimulator") -> "JaxSimulator":
    return simulator.with_effects()
