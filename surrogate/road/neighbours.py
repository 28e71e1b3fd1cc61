"""Who is where: leaders and followers in the own and the adjacent rows.

In the own row the leader is the entry before; in another row a binary search over the sorted positions finds it. That
is exact, keeps no pointers that could go stale, and costs a gather per halving (2 ns each on one core, measured).
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.road.traffic_state import HEAD, VehicleArrays
from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise


def entry_ahead(
    position_m: Float[Array, "..."],
    row: Int[Array, "..."],
    sorted_position_m: Float[Array, " vehicle"],
    head: Int[Array, " row_plus_one"],
) -> Int[Array, "..."]:
    """Return the last entry of `row` that lies ahead of `position_m`; the row's head if no vehicle does.

    Args:
        position_m: where to look from.
        row: row to look in, 0 <= row < number of rows.
        sorted_position_m: positions of all entries, sorted by (row, -position).
        head: first entry of each row and the first entry behind the last row.
    """
    first, end = take(head, row), take(head, row + 1)
    entry = first
    num_halvings = int(sorted_position_m.shape[0] - 1).bit_length()
    for halving in range(num_halvings - 1, -1, -1):
        further = entry + (1 << halving)
        # a row's end may be the end of the arrays
        is_ahead = (further < end) & (take(sorted_position_m, jnp.minimum(further, end - 1)) > position_m)
        # each halving in a loop of its own: fused, they are one chain of loads that wait for each other
        entry = materialise(jnp.where(is_ahead, further, entry))
    return entry


class Neighbour(eqx.Module):
    """One neighbour of each vehicle: a leader or a follower in some row."""

    entry: Int[Array, " vehicle"]  # index into the vehicle arrays
    exists: Bool[Array, " vehicle"]  # whether there is one
    position_m: Float[Array, " vehicle"]  # its front bumper; +inf or anything where it does not exist
    speed_mps: Float[Array, " vehicle"]
    acceleration_mps2: Float[Array, " vehicle"]  # its acceleration in the last step
    vehicle_class: Int[Array, " vehicle"]


def neighbour_at(entry: Int[Array, " vehicle"], row: Int[Array, " vehicle"], vehicles: VehicleArrays) -> Neighbour:
    """Return the vehicle at `entry`, which counts only if it is a vehicle of `row`."""
    vehicle_class = take(vehicles.vehicle_class, entry)
    return Neighbour(
        entry=entry,
        exists=(vehicle_class >= 0) & (take(vehicles.row, entry) == row),
        position_m=take(vehicles.position_m, entry),
        speed_mps=take(vehicles.speed_mps, entry),
        acceleration_mps2=take(vehicles.acceleration_mps2, entry),
        vehicle_class=vehicle_class,
    )


def leader_at(entry: Int[Array, " vehicle"], vehicles: VehicleArrays) -> Neighbour:
    """Return the vehicle at `entry`, whatever its row; it counts if it is one."""
    return neighbour_at(entry, take(vehicles.row, entry), vehicles)


def shift_down(values: Array, first: Array | float) -> Array:
    """Return the value of the entry before each entry, `first` for the very first."""
    return jnp.concatenate([jnp.full((1,), first, values.dtype), values[:-1]])


def shift_up(values: Array, last: float) -> Array:
    """Return the value of the entry after each entry, `last` for the very last."""
    return jnp.concatenate([values[1:], jnp.full((1,), last, values.dtype)])


def as_neighbours(vehicles: VehicleArrays) -> Neighbour:
    """Return each vehicle as others see it."""
    return Neighbour(
        entry=jnp.arange(vehicles.row.shape[0], dtype=jnp.int32),
        exists=vehicles.is_vehicle,
        position_m=vehicles.position_m,
        speed_mps=vehicles.speed_mps,
        acceleration_mps2=vehicles.acceleration_mps2,
        vehicle_class=vehicles.vehicle_class,
    )


def nobody() -> Neighbour:
    """Return a neighbour that does not exist."""
    return Neighbour(
        entry=jnp.zeros((), jnp.int32),
        exists=jnp.zeros((), bool),
        position_m=jnp.full((), jnp.inf, jnp.float32),
        speed_mps=jnp.zeros((), jnp.float32),
        acceleration_mps2=jnp.zeros((), jnp.float32),
        vehicle_class=jnp.full((), HEAD, jnp.int32),
    )


def own_leader(vehicles: VehicleArrays) -> Neighbour:
    """Return the leader of each vehicle in its own row: the entry before it, for each row begins with a head."""
    return jax.tree.map(shift_down, as_neighbours(vehicles), nobody())


def second_leader(leader: Neighbour) -> Neighbour:
    """Return the leader of each vehicle's leader in its own row, given the leaders of all."""
    before = jax.tree.map(shift_down, leader, nobody())
    # behind a head, what is before belongs to another row
    return dataclasses.replace(before, exists=leader.exists & before.exists)
