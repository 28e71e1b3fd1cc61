"""Arrivals alone, and vehicles that enter the corridor."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.inflow.inflow import ENTRANCE_STRIDE, arrive
from surrogate.loop.step import initial_state
from surrogate.loop.world import World
from surrogate.road.traffic_state import TrafficState

NEVER_S = 1e6
INTERVAL_S = 1.0
DEMAND_VEHPS = (0.5, 0.0625)  # exact in binary, so that cumulated demands are as well

WorldMaker = Callable[..., World]
Drive = Callable[[World, int], list[TrafficState]]


@jax.jit
def arrivals(world: World, demand_vehps: jax.Array, num_decisions: jax.Array) -> jax.Array:
    """Return how many vehicles have arrived after each of up to 8000 decisions, [decision, entrance]."""

    def one(state: TrafficState, decision: jax.Array) -> tuple[TrafficState, jax.Array]:
        now_s = decision.astype(jnp.float32) * INTERVAL_S
        demand = jnp.where(decision <= num_decisions, demand_vehps, 0.0)
        queues = arrive(state, world.inflow, demand, world.seed, now_s, INTERVAL_S)
        state = eqx.tree_at(
            lambda s: (s.num_arrived, s.next_arrival, s.cumulated_demand),
            state,
            (queues.num_arrived, queues.next_arrival, queues.cumulated_demand),
        )
        return state, queues.num_arrived

    return jax.lax.scan(one, initial_state(world, 8), jnp.arange(1, 8001, dtype=jnp.int32))[1]


def count_arrivals(
    world: World,
    demand_vehps: tuple[float, float] = DEMAND_VEHPS,
    is_regular: tuple[bool, bool] = (False, False),
    window_s: tuple[float, float] = (0.0, NEVER_S),
    num_decisions: int = 8000,
) -> np.ndarray:
    begin_s, end_s = (jnp.full(2, bound, jnp.float32) for bound in window_s)
    world = eqx.tree_at(
        lambda w: (w.inflow.is_regular, w.inflow.begin_s, w.inflow.end_s),
        world,
        (jnp.asarray(is_regular), begin_s, end_s),
    )
    return np.asarray(arrivals(world, jnp.asarray(demand_vehps, jnp.float32), jnp.asarray(num_decisions)))


@pytest.mark.parametrize("seed", [1, 2, 77])
def test_random_arrivals_are_a_poisson_process_with_the_demand_s_rate(corridor_world: WorldMaker, seed: int) -> None:
    arrived = count_arrivals(corridor_world(seed, NEVER_S))
    expected = 8000.0 * np.asarray(DEMAND_VEHPS)
    assert (np.abs(arrived[-1] - expected) < 4.0 * np.sqrt(expected)).all()
    in_bins = np.diff(arrived[39::40], axis=0)  # of a Poisson process, mean and variance are equal
    dispersion = in_bins.var(axis=0, ddof=1) / in_bins.mean(axis=0)
    assert (np.abs(dispersion - 1.0) < 4.0 * np.sqrt(2.0 / len(in_bins))).all()


def test_the_two_entrances_and_two_seeds_have_arrivals_of_their_own(corridor_world: WorldMaker) -> None:
    one, other = (count_arrivals(corridor_world(seed, NEVER_S), (0.5, 0.5)) for seed in (1, 2))
    assert (one[:, 0] != one[:, 1]).mean() > 0.5
    assert (one[:, 0] != other[:, 0]).mean() > 0.5


def test_regular_arrivals_come_evenly(corridor_world: WorldMaker) -> None:
    arrived = count_arrivals(corridor_world(3, NEVER_S), (0.5, 0.0625), is_regular=(True, False))
    np.testing.assert_array_equal(arrived[:, 0], np.arange(1, 8001) // 2)
    assert len(set(np.diff(np.flatnonzero(np.diff(arrived[:, 1]))))) > 20  # the other entrance is still random


def test_outside_its_window_an_entrance_is_closed(corridor_world: WorldMaker) -> None:
    arrived = count_arrivals(corridor_world(5, NEVER_S), window_s=(600.0, 1800.0))
    assert (arrived[:600] == 0).all()
    assert (arrived[1800:] == arrived[1799]).all()
    expected = 1200.0 * np.asarray(DEMAND_VEHPS)
    assert (np.abs(arrived[-1] - expected) < 4.0 * np.sqrt(expected)).all()


def test_twice_the_demand_brings_the_same_arrivals_in_half_the_time(corridor_world: WorldMaker) -> None:
    world = corridor_world(9, NEVER_S)
    slow, fast = count_arrivals(world, (0.125, 0.0625)), count_arrivals(world, (0.25, 0.125))
    np.testing.assert_array_equal(fast[:4000], slow[1::2])
    assert slow[-1].min() > 300  # and so few that no decision has more of them than it can take


def test_more_arrivals_than_fit_into_one_decision_come_later(corridor_world: WorldMaker) -> None:
    arrived = count_arrivals(corridor_world(4, NEVER_S), (7.0, 0.5), is_regular=(True, True), num_decisions=30)
    assert np.diff(arrived[:, 0]).max() == 4
    assert arrived[29, 0] < 7 * 30
    assert arrived[-1].tolist() == [7 * 30, 15]


def identities(states: list[TrafficState], entrance: int) -> set[int]:
    """Return the arrival numbers of all vehicles of an entrance that were ever on the road."""
    seen = {int(i) for s in states for i in s.vehicles.identity[s.vehicles.vehicle_class >= 0]}
    return {i % ENTRANCE_STRIDE for i in seen if i // ENTRANCE_STRIDE == entrance}


@pytest.fixture(scope="module")
def light_traffic(corridor_world: WorldMaker, drive_on: Drive) -> list[TrafficState]:
    return drive_on(corridor_world(2, NEVER_S, main=900.0, on1=220.0), 700)


@pytest.fixture(scope="module")
def full_entrances(corridor_world: WorldMaker, drive_on: Drive) -> list[TrafficState]:
    """Both entrances get more than they can take for 40 s; then nobody arrives any more."""
    world = corridor_world(6, NEVER_S, main=11_000.0, on1=3600.0)
    world = eqx.tree_at(lambda w: w.inflow.end_s, world, jnp.full(2, 40.0, jnp.float32))
    return drive_on(world, 140)


def test_on_an_empty_road_the_inserted_flow_is_the_demand(light_traffic: list[TrafficState]) -> None:
    expected = 700.0 / 3600.0 * np.asarray([900.0, 220.0])
    last = light_traffic[-1]
    assert (np.abs(last.num_inserted - expected) < 4.0 * np.sqrt(expected)).all()
    waiting = np.stack([state.num_arrived - state.num_inserted for state in light_traffic])
    assert waiting.min() >= 0
    assert waiting.mean() < 0.2  # hardly anybody ever waits
    assert not last.subject_inserted


def test_nobody_is_skipped_where_the_road_is_empty(light_traffic: list[TrafficState]) -> None:
    for entrance in (0, 1):
        assert identities(light_traffic, entrance) == set(range(light_traffic[-1].num_inserted[entrance]))


def test_a_full_entrance_keeps_a_backlog(full_entrances: list[TrafficState]) -> None:
    at_40_s = full_entrances[40]
    expected = 40.0 / 3600.0 * np.asarray([11_000.0, 3600.0])
    assert (np.abs(at_40_s.num_arrived - expected) < 4.0 * np.sqrt(expected)).all()
    assert (at_40_s.num_arrived > at_40_s.num_inserted + 5).all()


def test_the_backlog_enters_as_soon_as_there_is_room(full_entrances: list[TrafficState]) -> None:
    last = full_entrances[-1]
    np.testing.assert_array_equal(last.num_inserted, last.num_arrived)
    assert int(last.num_lost) == 0
    for state in full_entrances:
        assert (state.num_inserted <= state.num_arrived).all()


def test_a_full_entrance_loses_and_doubles_nobody(full_entrances: list[TrafficState]) -> None:
    last = full_entrances[-1]
    for entrance in (0, 1):
        assert identities(full_entrances, entrance) == set(range(last.num_arrived[entrance]))


def test_destinations_are_drawn_with_the_shares_of_the_flows(
    light_traffic: list[TrafficState], full_entrances: list[TrafficState]
) -> None:
    for states in (light_traffic, full_entrances):
        destination = {}
        for state in states:
            there = state.vehicles.vehicle_class >= 0
            destination |= dict(
                zip(state.vehicles.identity[there].tolist(), state.vehicles.destination[there].tolist(), strict=True)
            )
        share = 0.12  # of both inputs' vehicles, 0.13 of 1.083333 veh/s and 0.017333 of 0.144444 veh/s leave early
        leaves_early = np.mean(list(destination.values()))
        assert abs(leaves_early - share) < 4.0 * np.sqrt(share * (1.0 - share) / len(destination))


def test_arrivals_keep_their_destination_and_driver_when_parameters_change(
    corridor_world: WorldMaker, drive_on: Drive, light_traffic: list[TrafficState]
) -> None:
    def drivers(states: list[TrafficState]) -> dict[int, tuple[int, float]]:
        found = {}
        for state in states:
            v = state.vehicles
            for entry in np.flatnonzero(v.vehicle_class >= 0):
                found[int(v.identity[entry])] = int(v.destination[entry]), float(v.speed_factor[entry])
        return found

    changed = drive_on(corridor_world(2, NEVER_S, main=1500.0, on1=220.0, tau=1.9, minGap=4.0), 150)
    before, after = drivers(light_traffic[:151]), drivers(changed)
    common = set(before) & set(after)
    assert len(common) > 30
    assert len(after) > len(common)
    assert all(before[i] == after[i] for i in common)
    on_ramp_before, on_ramp_after = (states[150].num_arrived[1] for states in (light_traffic, changed))
    assert on_ramp_before == on_ramp_after > 3
