"""Random traffic makes random moves; lists of vehicles, sorted anew, say what the arrays must look like."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.road.reorder import Moves, Order, new_order, rearrange
from surrogate.road.traffic_state import EMPTY, HEAD, VehicleArrays, empty_vehicles

CAPACITY = 44
NUM_ROWS = 4
ENTRANT_ROWS = np.asarray([[2, 0], [3, 1]])  # of two entrances with two lanes; each row once
NOBODY = np.iinfo(np.int32).max


@dataclass
class Vehicle:
    identity: int
    row: int
    position_m: float


@dataclass
class Scene:
    """Vehicles by row, downstream first, and what they are about to do."""

    rows: list[list[Vehicle]]
    leaves: dict[int, bool]
    target_row: dict[int, int]
    entrants: list[list[Vehicle]]
    enters: np.ndarray
    rank: np.ndarray

    @property
    def head(self) -> np.ndarray:
        return np.cumsum([0] + [1 + len(row) for row in self.rows])

    def ahead(self, row: int, position_m: float) -> int:
        """Return the entry of the last vehicle of a row ahead of a position, or that of the row's head."""
        return int(self.head[row]) + sum(vehicle.position_m > position_m for vehicle in self.rows[row])

    def entry_of(self) -> dict[int, int]:
        return {v.identity: int(self.head[r]) + 1 + i for r, row in enumerate(self.rows) for i, v in enumerate(row)}


def random_scene(rng: np.random.Generator, num_vehicles: int) -> Scene:
    positions = rng.choice(4000, num_vehicles, replace=False) * 0.5 - 300.0  # all distinct
    row_of = rng.choice(NUM_ROWS, num_vehicles, p=rng.dirichlet(np.ones(NUM_ROWS)))
    vehicles = [Vehicle(1000 + i, int(row_of[i]), float(positions[i])) for i in range(num_vehicles)]
    rows = [sorted((v for v in vehicles if v.row == r), key=lambda v: -v.position_m) for r in range(NUM_ROWS)]
    busy = rng.choice([0.1, 0.5, 0.9])
    leaves = {v.identity: bool(rng.random() < 0.2) for v in vehicles}
    target = {
        v.identity: int((v.row + rng.integers(1, NUM_ROWS)) % NUM_ROWS)
        for v in vehicles
        if not leaves[v.identity] and rng.random() < busy
    }
    entrants, number = [], 0
    for lanes in ENTRANT_ROWS:
        entrants.append([])
        for row in lanes:
            entrants[-1].append(Vehicle(5000 + number, int(row), float(rng.uniform(-300.0, 1700.0)) + 0.137))
            number += 1
    rank = np.stack([rng.permutation(2) for _ in ENTRANT_ROWS])
    return Scene(rows, leaves, target, entrants, rng.random((2, 2)) < 0.7, rank)


def as_arrays(scene: Scene) -> tuple[VehicleArrays, VehicleArrays, Moves]:
    head, entry_of = scene.head, scene.entry_of()
    vehicles = _columns(empty_vehicles(NUM_ROWS, CAPACITY))
    vehicles["row"][:] = NUM_ROWS
    vehicles["position_m"][:] = -np.inf
    vehicles["vehicle_class"][:] = EMPTY
    for row, entry in enumerate(head[:-1]):
        vehicles["row"][entry], vehicles["position_m"][entry], vehicles["vehicle_class"][entry] = row, np.inf, HEAD
    leaves, changes, ahead = np.zeros(CAPACITY, bool), np.zeros(CAPACITY, bool), np.zeros(CAPACITY, np.int32)
    for vehicle in (v for row in scene.rows for v in row):
        entry = entry_of[vehicle.identity]
        leaves[entry] = scene.leaves[vehicle.identity]
        changes[entry] = vehicle.identity in scene.target_row
        target = scene.target_row.get(vehicle.identity, vehicle.row)
        ahead[entry] = scene.ahead(target, vehicle.position_m) if changes[entry] else 7  # ignored where nobody changes
        for name, value in properties(vehicle).items():
            vehicles[name][entry] = value
    newcomers = _columns(empty_vehicles(1, ENTRANT_ROWS.size))
    for place, vehicle in enumerate(v for lanes in scene.entrants for v in lanes):
        for name, value in properties(vehicle).items():
            newcomers[name][place] = value
    entrant_ahead = [[scene.ahead(v.row, v.position_m) for v in lanes] for lanes in scene.entrants]
    moves = Moves(
        leaves_road=jnp.asarray(leaves),
        changes_row=jnp.asarray(changes),
        entry_ahead=jnp.asarray(ahead),
        entrant_ahead=jnp.asarray(entrant_ahead, jnp.int32),
        entrant_enters=jnp.asarray(scene.enters),
        entrant_rank=jnp.asarray(scene.rank, jnp.int32),
    )
    return _arrays(vehicles), _arrays(newcomers), moves


def properties(vehicle: Vehicle) -> dict[str, float]:
    """Return what distinguishes a vehicle, so that a field left behind would show."""
    return {
        "position_m": vehicle.position_m,
        "row": vehicle.row,
        "identity": vehicle.identity,
        "vehicle_class": vehicle.identity % 3,
        "speed_mps": 0.01 * vehicle.identity,
        "gain_left_memory": -0.5 * vehicle.identity,
        "track": vehicle.identity - 900,
    }


def _columns(vehicles: VehicleArrays) -> dict[str, np.ndarray]:
    return {name: np.array(leaf) for name, leaf in vars(vehicles).items() if name != "personal"}


def _arrays(fields: dict[str, np.ndarray]) -> VehicleArrays:
    """Return the vehicles, with a memory of an effect that tells whose it is."""
    personal = {"an_effect": {"of_whom": jnp.asarray(2.5 * fields["identity"], jnp.float32)}}
    return VehicleArrays(**{name: jnp.asarray(leaf) for name, leaf in fields.items()}, personal=personal)


def expected(scene: Scene) -> tuple[list[list[Vehicle]], set[int], np.ndarray, int]:
    """Return the rows afterwards, who changed row, which newcomers entered, and how many found the arrays full."""
    entry_of, taken = scene.entry_of(), {}
    for identity in sorted(scene.target_row, key=entry_of.__getitem__):
        vehicle = next(v for row in scene.rows for v in row if v.identity == identity)
        gap = scene.ahead(scene.target_row[identity], vehicle.position_m)
        taken.setdefault(gap, identity)
    moved = set(taken.values())
    room = CAPACITY - int(scene.head[-1])
    entered, num_lost = np.zeros((2, 2), bool), 0
    fits = np.zeros((2, 2), bool)
    for place in range(4):
        e, lane = divmod(place, 2)
        if scene.enters[e, lane]:
            fits[e, lane] = room > 0
            num_lost += room <= 0
            room -= 1
    for e in range(2):
        for lane in np.argsort(scene.rank[e]):
            newcomer = scene.entrants[e][lane]
            if not scene.enters[e, lane]:
                continue
            if not fits[e, lane] or scene.ahead(newcomer.row, newcomer.position_m) in taken:
                break
            entered[e, lane] = True
    rows: list[list[Vehicle]] = [[] for _ in range(NUM_ROWS)]
    for vehicle in (v for row in scene.rows for v in row if not scene.leaves[v.identity]):
        row = scene.target_row[vehicle.identity] if vehicle.identity in moved else vehicle.row
        rows[row].append(Vehicle(vehicle.identity, row, vehicle.position_m))
    for e, lane in np.argwhere(entered):
        rows[scene.entrants[e][lane].row].append(scene.entrants[e][lane])
    return [sorted(row, key=lambda v: -v.position_m) for row in rows], moved, entered, num_lost


@jax.jit
def carried_out(
    vehicles: VehicleArrays, newcomers: VehicleArrays, moves: Moves, head: jax.Array, target_row: jax.Array
) -> tuple[Order, VehicleArrays]:
    order = new_order(moves, vehicles, head)
    row = jnp.where(order.has_moved, target_row, vehicles.row)
    changed = VehicleArrays(**(vars(vehicles) | {"row": row}))
    return order, rearrange(changed, newcomers, order)


def run(scene: Scene) -> tuple[Order, dict[str, np.ndarray]]:
    vehicles, newcomers, moves = as_arrays(scene)
    target_row, entry_of = np.asarray(vehicles.row).copy(), scene.entry_of()
    for identity, row in scene.target_row.items():
        target_row[entry_of[identity]] = row
    order, arranged = carried_out(vehicles, newcomers, moves, jnp.asarray(scene.head, jnp.int32), target_row)
    assert arranged.personal is not None
    np.testing.assert_array_equal(arranged.personal["an_effect"]["of_whom"], 2.5 * np.asarray(arranged.identity))
    return order, _columns(arranged)


SCENES = [
    (seed, num_vehicles) for num_vehicles in (0, 1, 9, 25, CAPACITY - NUM_ROWS - 2, CAPACITY - NUM_ROWS)
    for seed in range(25)
]  # fmt: skip


@pytest.mark.parametrize("num_vehicles", sorted({number for _, number in SCENES}))
def test_random_moves_give_the_rows_that_sorting_would_give(num_vehicles: int) -> None:
    for seed in (seed for seed, number in SCENES if number == num_vehicles):
        scene = random_scene(np.random.default_rng(seed), num_vehicles)
        order, arranged = run(scene)
        rows, moved, entered, num_lost = expected(scene)
        head = np.cumsum([0] + [1 + len(row) for row in rows])
        np.testing.assert_array_equal(np.asarray(order.head), head)
        np.testing.assert_array_equal(np.asarray(order.has_entered), entered)
        assert int(order.num_lost) == num_lost
        assert {i for i, entry in scene.entry_of().items() if bool(order.has_moved[entry])} == moved
        for number, row in enumerate(rows):
            assert arranged["vehicle_class"][head[number]] == HEAD
            assert arranged["position_m"][head[number]] == np.inf
            assert arranged["row"][head[number]] == number
            for place, vehicle in enumerate(row, start=int(head[number]) + 1):
                found = {name: arranged[name][place] for name in properties(vehicle)}
                np.testing.assert_allclose(list(found.values()), list(properties(vehicle).values()), rtol=1e-6)
        assert (arranged["vehicle_class"][head[-1] :] == EMPTY).all()
        assert (arranged["row"][head[-1] :] == NUM_ROWS).all()
        assert (arranged["position_m"][head[-1] :] == -np.inf).all()


def test_nobody_is_lost_or_doubled_and_every_row_stays_sorted() -> None:
    seen_waiting = seen_lost = False
    for seed, num_vehicles in SCENES:
        scene = random_scene(np.random.default_rng(1000 + seed), num_vehicles)
        order, arranged = run(scene)
        is_vehicle = arranged["vehicle_class"] >= 0
        there = arranged["identity"][is_vehicle].tolist()
        before = {v.identity for row in scene.rows for v in row if not scene.leaves[v.identity]}
        entered = {v.identity for e, lanes in enumerate(scene.entrants) for lane, v in enumerate(lanes)
                   if bool(order.has_entered[e, lane])}  # fmt: skip
        assert len(there) == len(set(there))
        assert set(there) == before | entered
        key = np.stack([arranged["row"][is_vehicle], -arranged["position_m"][is_vehicle]], axis=1)
        assert (np.lexsort((key[:, 1], key[:, 0])) == np.arange(len(key))).all()
        seen_lost |= int(order.num_lost) > 0
        seen_waiting |= bool((scene.enters & ~np.asarray(order.has_entered)).any())
    assert seen_waiting
    assert seen_lost


def test_the_new_entry_of_each_old_one_is_where_its_vehicle_is_now() -> None:
    for seed in range(20):
        scene = random_scene(np.random.default_rng(seed), 25)
        order, arranged = run(scene)
        for identity, entry in scene.entry_of().items():
            if not scene.leaves[identity] and not bool(order.has_moved[entry]):
                assert arranged["identity"][int(order.new_entry[entry])] == identity
