"""The corridor's engine, and the same with effects: tests share them and what is compiled for them."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from sim_adapters.jax.simulator import JaxSimulator
    from sim_adapters.world.world_builder import WorldTemplate


@pytest.fixture(scope="module", autouse=True)
def _as_users_do(programs_as_users_do: None) -> None:
    """Many of these tests compare bits, and share programs with the others."""


@pytest.fixture(scope="session")
def simulator(template: "WorldTemplate") -> "JaxSimulator":
    from tests.sim_adapters.jax.frame_trace import corridor_engine

    return corridor_engine(template)


@pytest.fixture(scope="session")
def with_effects(simulator: "JaxSimulator") -> "JaxSimulator":
    return simulator.with_effects()
