"""Works through the vehicle arrays tile by tile, only as far as there are vehicles.

The arrays have room for the densest run of a batch, and are half empty while the road fills up. A tile's intermediate
results fit into a processor's cache, whatever the length of the arrays. Measured on one core for 8 runs of 1,500 places
that hold 800 vehicles: see `experiments/results/performance.md`.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise, on_processors

Tree = TypeVar("Tree")
Carry = TypeVar("Carry")
LARGEST_TILE = 224  # entries; of smaller tiles, the loops cost more than the empty rest of the last tile


class Tile:
    """Consecutive entries. Not a record: lives within one trace.

    Attributes:
        number: which one.
        size: how many entries.
        is_everything: whether there is only this one tile.
        start: the first.
        is_new: which of them are in no tile before.
        is_first: which of them is the first of these.
    """

    def __init__(self, number: Int[Array, ""] | int, num_entries: int, size: int | None = None) -> None:
        """Find its place.

        Args:
            number: which tile.
            num_entries: length of the arrays.
            size: entries of a tile; the usual number unless given.
        """
        self.number = jnp.asarray(number, jnp.int32)
        self.size = tile_size(num_entries) if size is None else size
        self.is_everything = self.size == num_entries
        self.start = jnp.minimum(number * self.size, num_entries - self.size)
        # the last tile ends with the arrays, so it may begin within the one before
        entry = jnp.arange(self.size, dtype=jnp.int32) + self.start
        self.is_new = entry >= number * self.size
        self.is_first = entry == number * self.size

    def __call__(self, values: Tree) -> Tree:
        """Return the tile's part of each array."""
        if self.is_everything:
            return values
        return jax.tree.map(lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, self.start, self.size), values)

    def write(self, values: Tree, news: Tree) -> Tree:
        """Return the arrays with the tile's part replaced."""
        if self.is_everything:
            return news
        return jax.tree.map(lambda old, new: jax.lax.dynamic_update_slice_in_dim(old, new, self.start, 0), values, news)


class Chosen:
    """Entries picked one by one. Not a record: lives within one trace."""

    def __init__(self, entry: Int[Array, " chosen"]) -> None:
        """Keep the entries."""
        self.entry = entry

    def __call__(self, values: Tree) -> Tree:
        """Return the entries of each array."""
        return jax.tree.map(lambda leaf: take(leaf, self.entry), values)


def tile_size(num_entries: int) -> int:
    """Return the size of the tiles of arrays of a length: all the same, so that little of the last is empty.

    An accelerator works on whole arrays at once: tiles of 448 and of 800 took 1.3 times as long for 8192 runs of 1600
    places on an H200.
    """
    largest = LARGEST_TILE if on_processors() else num_entries
    return -(-num_entries // -(-num_entries // largest))


def all_tiles(num_entries: int) -> int:
    """Return how many tiles cover arrays of a length."""
    return -(-num_entries // tile_size(num_entries))


def tiles_for(num_in_use: Int[Array, ""], num_entries: int, size: int | None = None) -> Int[Array, ""]:
    """Return how many tiles hold the first entries.

    Args:
        num_in_use: entries that may be in use.
        num_entries: length of the arrays.
        size: entries of a tile; the usual number unless given.
    """
    size = tile_size(num_entries) if size is None else size
    return jnp.minimum(-(-num_in_use // size), -(-num_entries // size))


@jax.custom_batching.custom_vmap
def most_of_batch(number: Int[Array, ""]) -> Int[Array, ""]:
    """Return the largest of the numbers that the runs of a batch have: one for all, as loops over tiles need it."""
    return number


@most_of_batch.def_vmap
def _most_of_many(axis_size: int, in_batched: list[bool], number: Array) -> tuple[Array, bool]:
    del axis_size
    return (jnp.max(number) if in_batched[0] else number), False


def for_each_tile(
    function: Callable[[Tile, Carry], Carry],
    num_tiles: Int[Array, ""] | int,
    num_entries: int,
    carry: Carry,
    size: int | None = None,
) -> Carry:
    """Return what becomes of a carry tile after tile.

    Args:
        function: from a tile and the carry to the next carry.
        num_tiles: tiles to work through, the same in all runs of a batch; at least one if there is only one.
        num_entries: length of the arrays.
        carry: what the first tile gets.
        size: entries of a tile; the usual number unless given.
    """

    def one(number: Int[Array, ""] | int, carry: Carry) -> Carry:
        return function(Tile(number, num_entries, size), carry)

    if (tile_size(num_entries) if size is None else size) == num_entries:
        return materialise(one(0, carry))
    # a function of its own: a loop's batching looks at it several times, and does the work once
    body = jax.jit(one)
    return jax.lax.fori_loop(jnp.int32(0), num_tiles, body, carry)


def over_tiles(
    function: Callable[[Tile], Any], num_tiles: Int[Array, ""] | int, num_entries: int, size: int | None = None
) -> Any:
    """Return what a function gives for each entry, worked out tile by tile; 0 for entries beyond the tiles.

    Args:
        function: from a tile to arrays of its entries.
        num_tiles: tiles to work through, the same in all runs of a batch; at least one if there is only one.
        num_entries: length of the arrays.
        size: entries of a tile; the usual number unless given.
    """
    if (tile_size(num_entries) if size is None else size) == num_entries:
        return materialise(function(Tile(0, num_entries, size)))
    of_tile = jax.jit(lambda number: function(Tile(number, num_entries, size)))  # traced once for shapes and loop
    shapes = jax.eval_shape(of_tile, jax.ShapeDtypeStruct((), jnp.int32))
    nothing = jax.tree.map(lambda one: jnp.zeros((num_entries, *one.shape[1:]), one.dtype), shapes)

    def fill(tile: Tile, filled: Any) -> Any:
        return tile.write(filled, of_tile(tile.number))

    return for_each_tile(fill, num_tiles, num_entries, nothing, size)
