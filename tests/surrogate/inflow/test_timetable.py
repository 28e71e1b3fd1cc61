"""Arrivals of flows that come and go, and of single vehicles, in one table."""

import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.inflow.timetable import Schedule, timetable

BEGIN_S, END_S = (100.0, 150.0, 150.0), (200.0, 400.0, 400.0)
REGULAR, RANDOM, PART = 0, 1, 2
RATE_VEHPS = np.asarray([[0.25, 0.375], [0.125, 0.0]], np.float32)  # of each queue's flows
MOST, COPIES = 300, 4
VEHICLES_S = (11.5, 12.0, 170.25, 171.0, 390.0)


def schedule(opens_s: float = 0.0) -> Schedule:
    """Two queues: a regular flow and a random one; part of a regular flow, and single vehicles."""
    num_flows, num_single = 3, len(VEHICLES_S)
    never = num_flows * MOST + num_single * COPIES
    first = [*range(2 * MOST), never]
    second = [*range(2 * MOST, never)]
    second += [never] * (len(first) - len(second))
    columns = [[0] * MOST + [1] * (MOST + 1), [0] * MOST + [1] * (len(first) - MOST)]
    return Schedule(
        begin_s=jnp.asarray(BEGIN_S),
        end_s=jnp.asarray(END_S),
        opens_s=jnp.asarray(opens_s),
        is_regular=jnp.asarray([True, False, True]),
        begins_anywhere=jnp.asarray([False, False, True]),
        queue=jnp.asarray([0, 0, 1]),
        column=jnp.asarray([0, 1, 0]),
        is_mainline=jnp.asarray([True, True, False]),
        num_lanes=jnp.asarray([3, 3, 1]),
        vehicle_s=jnp.asarray(VEHICLES_S, jnp.float32),
        vehicle_number=jnp.arange(num_single),
        vehicle_column=jnp.asarray([(1, 1)] * num_single),
        source=jnp.asarray([first, second]),
        flow=jnp.asarray(columns),
        most_of_flow=MOST,
        most_copies=COPIES,
    )


def times_of(queue: int, flow: int, seed: int = 1, rate: float = 1.0, factor: float = 1.0) -> np.ndarray:
    """Return when the vehicles of one flow of one queue come."""
    table = timetable(schedule(), jnp.asarray(rate * RATE_VEHPS), jnp.full((2, 2), factor), jnp.asarray(seed))
    of_flow = np.asarray(table.flow)[queue][np.asarray(table.place)[queue]]
    time_s = np.asarray(table.time_s)[queue]
    return time_s[(of_flow == flow) & np.isfinite(time_s)]


def test_arrivals_are_in_order_and_the_last_never_comes() -> None:
    table = timetable(schedule(), jnp.asarray(RATE_VEHPS), jnp.ones((2, 2)), jnp.asarray(7))
    time_s = np.asarray(table.time_s)
    for row in time_s:
        assert (np.diff(row[np.isfinite(row)]) >= 0.0).all()
        assert row[-1] == np.inf
    assert (np.sort(np.asarray(table.place), axis=1) == np.arange(time_s.shape[1])).all()  # nobody twice


def test_a_regular_flow_comes_evenly_from_its_begin_on() -> None:
    np.testing.assert_allclose(times_of(0, REGULAR), np.arange(100.0, 200.0, 4.0), atol=1e-4)
    np.testing.assert_allclose(times_of(0, REGULAR, rate=2.0), np.arange(100.0, 200.0, 2.0), atol=1e-4)


def test_part_of_a_regular_flow_comes_evenly_from_anywhere_in_the_first_interval_on() -> None:
    firsts = np.asarray([times_of(1, 0, seed)[0] for seed in range(1, 41)])
    assert (firsts >= 150.0).all()
    assert (firsts < 158.0).all()
    assert abs(firsts.mean() - 154.0) < 4.0 * 8.0 / np.sqrt(12.0 * len(firsts))
    np.testing.assert_allclose(np.diff(times_of(1, 0, 3)), 8.0, atol=1e-3)


def test_a_random_flow_is_a_poisson_process_in_its_window() -> None:
    runs = [times_of(0, RANDOM, seed) for seed in range(1, 41)]
    expected = 0.375 * 250.0
    assert min(run.min() for run in runs) >= 150.0
    assert max(run.max() for run in runs) < 400.0
    numbers = np.asarray([len(run) for run in runs])
    assert abs(numbers.mean() - expected) < 4.0 * np.sqrt(expected / len(runs))
    dispersion = numbers.var(ddof=1) / numbers.mean()
    assert abs(dispersion - 1.0) < 4.0 * np.sqrt(2.0 / len(runs))


def test_more_demand_brings_the_same_arrivals_sooner() -> None:
    slow, fast = times_of(0, RANDOM, 5) - 150.0, times_of(0, RANDOM, 5, rate=2.0) - 150.0
    np.testing.assert_allclose(fast[: len(slow)], 0.5 * slow, rtol=1e-4)
    assert len(fast) > len(slow)


def test_single_vehicles_come_at_their_second() -> None:
    np.testing.assert_array_equal(times_of(1, 1), np.asarray(VEHICLES_S, np.float32))


@pytest.mark.parametrize("factor", [0.0, 0.4, 0.75, 1.3, 2.0, 3.0])
def test_scaled_single_vehicles_stay_or_come_twice_as_in_the_files_for_sumo(factor: float) -> None:
    expected = [
        time_s
        for number, time_s in enumerate(VEHICLES_S)
        for _ in range(int(np.floor(factor * (number + 1) + 0.5) - np.floor(factor * number + 0.5)))
    ]
    np.testing.assert_array_equal(times_of(1, 1, factor=factor), np.asarray(expected, np.float32))


def test_nobody_comes_before_the_scenario_begins() -> None:
    table = timetable(schedule(170.0), jnp.asarray(RATE_VEHPS), jnp.ones((2, 2)), jnp.asarray(2))
    usual = timetable(schedule(), jnp.asarray(RATE_VEHPS), jnp.ones((2, 2)), jnp.asarray(2))
    for queue in (0, 1):
        all_s, late_s = (np.asarray(one.time_s)[queue] for one in (usual, table))
        np.testing.assert_array_equal(late_s[np.isfinite(late_s)], all_s[(all_s >= 170.0) & np.isfinite(all_s)])


def test_without_demand_only_single_vehicles_come() -> None:
    assert len(times_of(0, REGULAR, rate=0.0)) == len(times_of(0, RANDOM, rate=0.0)) == 0
    assert len(times_of(1, 1, rate=0.0)) == len(VEHICLES_S)


def test_seeds_have_random_arrivals_of_their_own() -> None:
    one, other = (times_of(0, RANDOM, seed)[:20] for seed in (1, 2))
    assert (one != other).all()


def test_how_many_have_come_before_a_time() -> None:
    table = timetable(schedule(), jnp.asarray(RATE_VEHPS), jnp.ones((2, 2)), jnp.asarray(1))
    assert int(table.num_until(1, jnp.asarray(12.0))) == 1  # those before it, not the one at it
    assert int(table.num_until(1, jnp.asarray(100.0))) == 2
