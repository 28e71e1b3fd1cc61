"""Vehicles, and what the road's tables say where they are."""

from collections.abc import Callable
from copy import copy
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.road.neighbours import Neighbour, entry_ahead, own_leader, shift_down
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays
from surrogate.xla.gather import take

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

ROW_BITS, OFFSET_BITS, END_BITS = 5, 6, 14  # any offset between so many rows fits
NO_ROW = (1 << ROW_BITS) - 1


class Guide:
    """What the road's integer tables say of a row, read as one word: a read costs more than taking a word apart.

    Attributes:
        best_lane_offset: lane changes to the lane that the route needs, left positive.
        track_end: which end of a track ends the stretch that the route can follow in this row.
        leads_elsewhere: whether the lane goes on to another road than the route's.
        right_row: row on the right; -1 where there is none.
        left_row: row on the left; -1 where there is none.
    """

    def __init__(self, word: Int[Array, " vehicle"]) -> None:
        """Take a word of `guide_table` apart."""
        self.right_row, word = _field(word, ROW_BITS)
        self.left_row, word = _field(word, ROW_BITS)
        self.leads_elsewhere = (word & 1) == 1
        self.best_lane_offset, word = _field(word >> 1, OFFSET_BITS)
        self.best_lane_offset = self.best_lane_offset - (1 << OFFSET_BITS - 1)
        self.track_end = word
        self.right_row, self.left_row = (jnp.where(row == NO_ROW, -1, row) for row in (self.right_row, self.left_row))


def _field(word: Int[Array, "..."], num_bits: int) -> tuple[Int[Array, "..."], Int[Array, "..."]]:
    """Return the lowest bits, and the word without them."""
    return word & ((1 << num_bits) - 1), word >> num_bits


def guide_table(road: Road) -> Int[Array, "destination row segment"]:
    """Return the road's integer tables as one.

    Raises:
        ValueError: the road has more rows, or more ends of tracks, than a word holds.
    """
    if road.num_rows >= NO_ROW or road.end_position_m.shape[0] >= 1 << END_BITS:
        raise ValueError(f"Expected fewer than {NO_ROW} rows and {1 << END_BITS} ends of tracks.")
    word = road.track_end
    word = (word << OFFSET_BITS) + road.best_lane_offset + (1 << OFFSET_BITS - 1)
    word = (word << 1) + road.leads_elsewhere
    for rows in (road.left_row, road.right_row):
        word = (word << ROW_BITS) + jnp.where(rows < 0, NO_ROW, rows)
    return word


class VehiclesOnRoad:
    """Vehicles, their segments, and the road tables read there. Not a record: lives within one trace.

    Attributes:
        road: the road.
        head: first entry of each row.
        everybody: all vehicles.
        everybodys_edge_start_m: where the edge of each of them begins.
        vehicles: those asked about; all, unless it is a part.
        leader: leader of each of those in its own row.
        leader_edge_start_m: where that one's edge begins.
        segment: segment of each of those.
        row: its row, a valid one also where the entry is empty.
        edge_start_m: where its edge begins.
    """

    def __init__(self, vehicles: VehicleArrays, road: Road, head: Int[Array, " row_plus_one"]) -> None:
        """Look up the segment of every vehicle once."""
        self.road = road
        self.head = head
        self.everybody = self.vehicles = vehicles
        self.leader = own_leader(vehicles)
        self.segment = road.segment_at(vehicles.position_m)
        self.row = jnp.minimum(vehicles.row, road.num_rows - 1)
        self.everybodys_edge_start_m = self.edge_start_m = take(road.edge_start_m, self.segment)
        self.leader_edge_start_m = shift_down(self.edge_start_m, 0.0)
        self._row_and_class = vehicles.row + (vehicles.vehicle_class << ROW_BITS)
        self._guide = guide_table(road)
        ends = road.end_position_m
        rows = jnp.arange(road.num_rows, dtype=jnp.int32)
        # entry ahead of each point at which a lane ends for somebody, per row: counts the vehicles up to there
        self._end_entry = entry_ahead(
            jnp.broadcast_to(ends, (road.num_rows, ends.shape[0])),
            jnp.broadcast_to(rows[:, None], (road.num_rows, ends.shape[0])),
            vehicles.position_m,
            head,
        ).reshape(-1)

    def part(self, of: Callable[[Any], Any]) -> "VehiclesOnRoad":
        """The same for some of the vehicles.

        Args:
            of: takes their part of arrays, see `surrogate.xla.tiles`.
        """
        some = copy(self)
        some.vehicles, some.leader, some.leader_edge_start_m = of(
            (self.vehicles, self.leader, self.leader_edge_start_m)
        )
        some.segment, some.row, some.edge_start_m = of((self.segment, self.row, self.edge_start_m))
        return some

    def at_row(self, table: Array, row: Int[Array, " vehicle"]) -> Array:
        """Return a (row, segment) table at the given row and the own segment."""
        return take(table.reshape(-1), row * self.road.num_segments + self.segment)

    def at_segment(self, table: Array) -> Array:
        """Return a (segment) table at the own segment."""
        return take(table, self.segment)

    def on_route(self, table: Array, row: Int[Array, " vehicle"]) -> Array:
        """Return a (destination, row, segment) table for the own destination at the given row."""
        route = self.vehicles.destination * (self.road.num_rows * self.road.num_segments) + self.segment
        return take(table.reshape(-1), route + row * self.road.num_segments)

    def guide(self, row: Int[Array, " vehicle"]) -> Guide:
        """What the integer tables say of a row for the own destination."""
        return Guide(self.on_route(self._guide, row))

    def num_ahead(
        self, row: Int[Array, " vehicle"], end: Int[Array, " vehicle"], entry: Int[Array, " vehicle"]
    ) -> Value:
        """Number of vehicles of a row, from `entry` on, before one of the ends of tracks."""
        last = take(self._end_entry, row * self.road.end_position_m.shape[0] + end)
        return jnp.maximum(entry - last, 0).astype(jnp.float32)

    def neighbour(self, entry: Int[Array, " vehicle"], row: Int[Array, " vehicle"]) -> Neighbour:
        """Return the vehicle at `entry`, which counts only if it is a vehicle of `row`."""
        everybody, both = self.everybody, take(self._row_and_class, entry)
        vehicle_class = both >> ROW_BITS
        return Neighbour(
            entry=entry,
            exists=(vehicle_class >= 0) & (both & NO_ROW == row),
            position_m=take(everybody.position_m, entry),
            speed_mps=take(everybody.speed_mps, entry),
            acceleration_mps2=take(everybody.acceleration_mps2, entry),
            vehicle_class=vehicle_class,
        )
