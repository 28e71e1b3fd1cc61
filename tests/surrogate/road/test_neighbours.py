import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.road.neighbours import entry_ahead, neighbour_at, own_leader
from surrogate.road.traffic_state import EMPTY, HEAD, VehicleArrays, empty_vehicles
from surrogate.xla.gather import take

CAPACITY = 61
NUM_ROWS = 4
jitted_entry_ahead = jax.jit(entry_ahead)


def random_rows(rng: np.random.Generator) -> list[np.ndarray]:
    """Return the positions of the vehicles of each row, downstream first; often some rows are empty."""
    counts = rng.integers(0, 14, NUM_ROWS) * (rng.random(NUM_ROWS) < 0.7)
    return [np.sort(rng.uniform(-400.0, 2500.0, count).astype(np.float32))[::-1] for count in counts]


def laid_out(rows: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of all entries, and the first entry of each row and behind the last."""
    entries, head = [], []
    for row in rows:
        head.append(len(entries))
        entries += [np.inf, *row]
    head.append(len(entries))
    return np.asarray(entries + [-np.inf] * (CAPACITY - len(entries)), np.float32), np.asarray(head, np.int32)


def searched(rows: list[np.ndarray], row: int, position: float) -> int:
    """Return the answer of a search through all vehicles of a row."""
    ahead = [place for place, other in enumerate(rows[row]) if other > position]
    return int(laid_out(rows)[1][row]) + (1 + max(ahead) if ahead else 0)


@pytest.mark.parametrize("seed", range(20))
def test_the_entry_ahead_is_that_of_a_search_through_the_whole_row(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = random_rows(rng)
    sorted_position, head = laid_out(rows)
    row = rng.integers(0, NUM_ROWS, 200).astype(np.int32)
    position = rng.uniform(-600.0, 2700.0, 200).astype(np.float32)
    vehicles = np.concatenate(rows)
    if len(vehicles):  # level with somebody in the own or in another row: he is not ahead
        position[::3] = rng.choice(vehicles, len(position[::3]))
    found = jitted_entry_ahead(position, row, sorted_position, head)
    expected = [searched(rows, r, p) for r, p in zip(row, position, strict=True)]
    np.testing.assert_array_equal(np.asarray(found), expected)


def test_in_an_empty_row_the_row_s_head_lies_ahead() -> None:
    rows = [np.zeros(0, np.float32), np.asarray([70.0, 30.0], np.float32)] + [np.zeros(0, np.float32)] * 2
    sorted_position, head = laid_out(rows)
    found = jitted_entry_ahead(
        np.asarray([-1e9, 50.0, 1e9, 0.0], np.float32), np.asarray([0, 0, 2, 3], np.int32), sorted_position, head
    )
    np.testing.assert_array_equal(np.asarray(found), [0, 0, head[2], head[3]])


def test_a_full_row_that_fills_the_whole_array_is_searched_to_its_end() -> None:
    rows = [np.zeros(0, np.float32)] * 3 + [np.arange(CAPACITY - NUM_ROWS, 0.0, -1.0, dtype=np.float32)]
    sorted_position, head = laid_out(rows)
    assert head[-1] == CAPACITY
    position = np.asarray([0.5, 1.0, 1.5, CAPACITY - NUM_ROWS - 0.5, 5000.0], np.float32)
    found = jitted_entry_ahead(position, np.full(5, 3, np.int32), sorted_position, head)
    np.testing.assert_array_equal(np.asarray(found), [searched(rows, 3, p) for p in position])
    assert int(found[0]) == CAPACITY - 1


@pytest.fixture
def vehicles_and_rows() -> tuple[VehicleArrays, list[np.ndarray], np.ndarray]:
    rows = random_rows(np.random.default_rng(4))
    rows[2] = np.zeros(0, np.float32)
    assert sum(len(row) > 1 for row in rows) >= 2
    position, head = laid_out(rows)
    row = np.searchsorted(head, np.arange(CAPACITY), side="right") - 1
    kind = np.where(np.isin(np.arange(CAPACITY), head[:-1]), HEAD, np.where(row < NUM_ROWS, 1, EMPTY))
    vehicles = empty_vehicles(NUM_ROWS, CAPACITY)
    changes = {
        "position_m": jnp.asarray(position),
        "speed_mps": jnp.asarray(np.where(kind == 1, 0.01 * position + 7.0, 0.0), jnp.float32),
        "row": jnp.asarray(row, jnp.int32),
        "vehicle_class": jnp.asarray(kind, jnp.int32),
    }
    fields = {name: getattr(vehicles, name) for name in VehicleArrays.__dataclass_fields__}
    return VehicleArrays(**(fields | changes)), rows, head


def test_the_own_leader_is_the_next_vehicle_downstream_of_the_same_row(
    vehicles_and_rows: tuple[VehicleArrays, list[np.ndarray], np.ndarray],
) -> None:
    vehicles, rows, head = vehicles_and_rows
    leader = own_leader(vehicles)
    for number, row in enumerate(rows):
        for place, _ in enumerate(row):
            entry = int(head[number]) + 1 + place
            assert bool(leader.exists[entry]) == (place > 0)
            if place > 0:
                assert float(leader.position_m[entry]) == row[place - 1]
                assert float(leader.speed_mps[entry]) == pytest.approx(0.01 * row[place - 1] + 7.0, rel=1e-6)


def test_a_neighbour_counts_only_in_the_row_asked_about(
    vehicles_and_rows: tuple[VehicleArrays, list[np.ndarray], np.ndarray],
) -> None:
    vehicles, _, head = vehicles_and_rows
    entry = jnp.arange(CAPACITY, dtype=jnp.int32)
    for row in range(NUM_ROWS):
        neighbour = neighbour_at(entry, jnp.full(CAPACITY, row, jnp.int32), vehicles)
        there = [head[row] < e < head[row + 1] for e in range(CAPACITY)]
        np.testing.assert_array_equal(np.asarray(neighbour.exists), there)


class TestTake:
    """One flat array or many, the values are those of plain indexing."""

    VALUES = np.arange(24.0).reshape(4, 6) ** 1.5
    INDEX = np.asarray([[5, 0, 3], [1, 1, 2], [4, 5, 0], [2, 3, 3]])

    def test_batches_of_values_and_places(self) -> None:
        values, index = jnp.asarray(self.VALUES), jnp.asarray(self.INDEX)
        rows = np.arange(4)[:, None]
        np.testing.assert_array_equal(jax.vmap(take)(values, index), values[rows, index])
        np.testing.assert_array_equal(jax.vmap(take, in_axes=(0, None))(values, index[1]), values[:, index[1]])
        np.testing.assert_array_equal(jax.vmap(take, in_axes=(None, 0))(values[2], index), values[2][index])

    def test_batches_of_batches(self) -> None:
        values = jnp.asarray(np.stack([self.VALUES, -self.VALUES, 2.0 * self.VALUES]))
        index = jnp.asarray(np.stack([self.INDEX, 5 - self.INDEX, self.INDEX[::-1]]))
        expected = np.take_along_axis(np.asarray(values), np.asarray(index), axis=2)
        np.testing.assert_array_equal(jax.vmap(jax.vmap(take))(values, index), expected)

    def test_a_last_axis_travels_along(self) -> None:
        table = jnp.asarray(np.arange(48.0).reshape(4, 6, 2))
        found = jax.vmap(take)(table, jnp.asarray(self.INDEX))
        np.testing.assert_array_equal(found, np.asarray(table)[np.arange(4)[:, None], self.INDEX])
