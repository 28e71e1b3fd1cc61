"""Which drive a run stands for, and where it is observed: the same for both simulators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.world.drive_choice import choose, chosen
from sim_adapters.world.recorded_parts import WHOLE_M, RecordedParts, parts_of, parts_table
from surrogate.loop.recorded_parts import is_recorded

DEPARTS_S = (300.0, 320.0, 300.0, 300.0)
FIRST_M, LAST_M, TWO_M = ((-np.inf, 700.0),), ((1500.0, np.inf),), ((250.0, 600.0), (900.0, 1800.0))
RECORDED = tuple(map(RecordedParts, DEPARTS_S, (FIRST_M, WHOLE_M, LAST_M, TWO_M)))


def test_traced_values_choose_alike():
    of_seed = jax.jit(lambda depart_s, seed: chosen(jnp.asarray(DEPARTS_S), depart_s, seed))
    for seed in (*range(40), 2**31 - 1, 7_000_003):
        for depart_s in (300.0, 320.0):
            drive, is_there = of_seed(depart_s, seed)
            assert (int(drive), bool(is_there)) == (choose(DEPARTS_S, depart_s, seed), True)
    assert choose(DEPARTS_S, 310.0, 1) is None
    assert not bool(of_seed(310.0, 1)[1])


@pytest.mark.parametrize("step", [1, 2, 3, 4, 6, 12, 100])
def test_seeds_in_steps_do_not_all_choose_the_same(step: int):
    """By chance each of three has 100 of 300 runs, with a standard deviation of 8."""
    counts = np.bincount([choose(DEPARTS_S, 300.0, 11 + step * number) or 0 for number in range(300)], minlength=4)
    assert counts[1] == 0
    assert np.all(np.abs(counts[[0, 2, 3]] - 100) < 40)


def test_traced_values_are_observed_in_the_same_parts():
    table_of = jax.jit(lambda depart_s, seed: parts_table(RECORDED, depart_s, seed))
    positions_m = np.asarray([-5.0, 249.0, 251.0, 601.0, 750.0, 901.0, 1499.0, 1501.0, 2900.0])
    seen = set()
    for seed in range(12):
        for depart_s in (300.0, 320.0, 999.0):
            parts_m = parts_of(RECORDED, depart_s, seed)
            table = table_of(depart_s, seed)
            expected = [any(begin <= here <= end for begin, end in parts_m) for here in positions_m]
            found = [bool(is_recorded(table, jnp.asarray(here))) for here in positions_m]
            assert found == expected
            seen.add(parts_m)
    assert seen == {FIRST_M, LAST_M, TWO_M, WHOLE_M}
    assert parts_of(RECORDED, 999.0, 3) == WHOLE_M


def test_each_of_several_subject_vehicles_has_its_own():
    table = parts_table(RECORDED[:2], jnp.asarray([300.0, 320.0]), jnp.asarray(5))
    assert table is not None
    np.testing.assert_array_equal(is_recorded(table, jnp.asarray([800.0, 800.0])), [False, True])


def test_whole_logs_cost_nothing():
    assert parts_table((RecordedParts(300.0),), jnp.asarray(300.0), jnp.asarray(1)) is None
    assert parts_table((), jnp.asarray(300.0), jnp.asarray(1)) is None
