"""Where a run is observed that stands for a recorded drive: the same for both simulators."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.interface import NO_DRIVE
from sim_adapters.world.recorded_parts import WHOLE_M, RecordedParts, parts_of, parts_table
from surrogate.loop.recorded_parts import is_recorded

FIRST_M, LAST_M, TWO_M = ((-np.inf, 700.0),), ((1500.0, np.inf),), ((250.0, 600.0), (900.0, 1800.0))
RECORDED = tuple(map(RecordedParts, (FIRST_M, WHOLE_M, LAST_M, TWO_M)))


@pytest.mark.parametrize(
    ("drive", "parts_m"), [(0, FIRST_M), (1, WHOLE_M), (2, LAST_M), (3, TWO_M), (NO_DRIVE, WHOLE_M)]
)
def test_traced_numbers_are_observed_in_the_same_parts(drive: int, parts_m: tuple[tuple[float, float], ...]):
    assert parts_of(RECORDED, drive) == parts_m
    table = jax.jit(lambda number: parts_table(RECORDED, number))(drive)
    positions_m = np.asarray([-5.0, 249.0, 251.0, 601.0, 750.0, 901.0, 1499.0, 1501.0, 2900.0])
    expected = [any(begin <= here <= end for begin, end in parts_m) for here in positions_m]
    assert [bool(is_recorded(table, jnp.asarray(here))) for here in positions_m] == expected


def test_each_of_several_subject_vehicles_has_its_own():
    table = parts_table(RECORDED, jnp.asarray([2, NO_DRIVE, 0]))
    assert table is not None
    np.testing.assert_array_equal(is_recorded(table, jnp.asarray([800.0, 800.0, 800.0])), [False, True, False])


def test_whole_logs_cost_nothing():
    assert parts_table((RecordedParts(),), jnp.asarray(0)) is None
    assert parts_table((), jnp.asarray(NO_DRIVE)) is None
    assert parts_of((), 3) == WHOLE_M
