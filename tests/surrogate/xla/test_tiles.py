import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surrogate.effects.settings import Effects, EffectSetting, settings_table
from surrogate.lane_change import negotiation
from surrogate.loop.moving import move_on
from surrogate.loop.step import settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import TrafficState
from surrogate.xla import tiles
from surrogate.xla.tiles import Chosen, Tile, all_tiles, for_each_tile, over_tiles, tiles_for
from tests.jit_marked import jit_marked

CLOCK = Clock(step_s=0.1, steps_per_decision=10)
# One, two, three and four tiles, full and with a rest. Each length is a program of its own, so they are few.
LENGTHS = st.sampled_from([1, 2, 63, 223, 224, 225, 448, 449, 673, 700])


@functools.cache
def squares(num_entries: int) -> tuple[jax.Array, Callable[[int], jax.Array]]:
    """Return values, and what squares them in so many tiles."""
    values = jnp.arange(num_entries) * 0.7 + 1.3

    def square(num_tiles: jax.Array | int) -> jax.Array:
        return over_tiles(lambda tile: {"square": tile(values) ** 2}, num_tiles, num_entries)["square"]

    return values, jax.jit(square)


@functools.cache
def counts(num_entries: int) -> jax.Array:
    """Return in how many of its tiles each entry is new."""

    def count(tile: Tile, counted: jax.Array) -> jax.Array:
        return tile.write(counted, tile(counted) + tile.is_new)

    nothing = jnp.zeros((num_entries,), jnp.int32)
    return jax.jit(lambda: for_each_tile(count, all_tiles(num_entries), num_entries, nothing))()


@settings(max_examples=25, deadline=None)
@given(LENGTHS, st.integers(0, 700))
def test_tile_by_tile_gives_what_the_whole_gives_as_far_as_there_are_vehicles(num_entries: int, num_in_use: int):
    values, square = squares(num_entries)
    num_tiles = int(tiles_for(jnp.asarray(min(num_in_use, num_entries)), num_entries))
    found = square(num_tiles)
    if all_tiles(num_entries) == 1:  # is always worked through
        num_tiles = 1
    covered = min(num_tiles * tiles.tile_size(num_entries), num_entries)
    assert covered >= min(num_in_use, num_entries)
    np.testing.assert_allclose(found[:covered], values[:covered] ** 2, rtol=1e-6)
    assert (np.asarray(found[covered:]) == 0.0).all()


@settings(max_examples=25, deadline=None)
@given(LENGTHS)
def test_each_entry_is_new_in_one_tile(num_entries: int):
    assert (np.asarray(counts(num_entries)) == 1).all()


def test_chosen_entries_of_each_array():
    entry = jnp.asarray([5, 0, 2])
    picked = Chosen(entry)({"a": jnp.arange(7) * 1.5, "b": jnp.arange(7, 14)})
    assert picked["a"].tolist() == [7.5, 0.0, 3.0]
    assert picked["b"].tolist() == [12, 7, 9]


@pytest.mark.long
@pytest.mark.parametrize("mix", [None, {"multi_anticipation": EffectSetting(0.6)}], ids=["baseline", "effects"])
def test_a_run_is_the_same_whatever_the_tiles(
    mix: dict[str, EffectSetting] | None,
    corridor_world: Callable[..., World],
    drive_on: Callable[[World, int], list[TrafficState]],
    monkeypatch: pytest.MonkeyPatch,
):
    """Small tiles, and only those that hold vehicles, against one tile of all entries.

    One effect asks who is before a vehicle's leader, who may be in the tile before.
    """
    effects = None if mix is None else Effects(jnp.asarray(settings_table(mix), jnp.float32))
    world = corridor_world(19, 60.0, effects, main=3300.0, on1=620.0)
    state = drive_on(world, 130)[-1]
    num_entries = state.vehicles.row.shape[0]

    def on(state: TrafficState, world: World, num_tiles: jax.Array | int) -> TrafficState:
        settled = settle_lanes(state, world, CLOCK, num_tiles)
        return move_on(settled, world, CLOCK.step_s, CLOCK.steps_per_decision, num_tiles)

    monkeypatch.setattr(tiles, "LARGEST_TILE", num_entries)
    monkeypatch.setattr(negotiation, "URGENT_TILE", num_entries)
    of_whole = jit_marked(lambda state, world: on(state, world, 1))(state, world)
    monkeypatch.setattr(tiles, "LARGEST_TILE", 48)
    monkeypatch.setattr(negotiation, "URGENT_TILE", 2)
    in_use = state.head[-1] + world.inflow.lane_row.size
    assert int(tiles_for(in_use, num_entries)) < all_tiles(num_entries)
    num_tiles = tiles_for(in_use, num_entries)
    of_tiles = jit_marked(lambda state, world: on(state, world, num_tiles))(state, world)

    def without_nobodys_memories(state: TrafficState) -> TrafficState:
        kept = jax.tree.map(lambda leaf: leaf[: int(state.head[-1])], state.vehicles.personal)
        return eqx.tree_at(lambda s: s.vehicles.personal, state, kept, is_leaf=lambda leaf: leaf is None)

    asked = np.asarray(of_whole.vehicles.own_advice_mps2)[: int(of_whole.head[-1])]
    assert np.isfinite(asked).sum() > 2  # those who negotiate fill more than one tile
    whole, tiled = (without_nobodys_memories(state) for state in (of_whole, of_tiles))
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(tiled), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-4)


def test_a_traced_number_of_steps_needs_a_bound(
    corridor_world: Callable[..., World], drive_on: Callable[[World, int], list[TrafficState]]
):
    world = corridor_world(7, 60.0)
    state = drive_on(world, 40)[-1]
    with pytest.raises(ValueError, match="most_steps"):
        jax.jit(lambda steps: move_on(state, world, CLOCK.step_s, steps))(3)
    up_to_8 = jit_marked(lambda state, world, steps: move_on(state, world, CLOCK.step_s, steps, most_steps=8))
    few = up_to_8(state, world, 3)
    same = jit_marked(lambda state, world: move_on(state, world, CLOCK.step_s, 3))(state, world)
    assert int(few.step) == int(same.step) == int(state.step) + 3
    np.testing.assert_allclose(few.vehicles.position_m, same.vehicles.position_m, rtol=1e-6)
