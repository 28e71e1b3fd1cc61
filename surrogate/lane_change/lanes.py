"""The lanes that a vehicle may be in after a decision: who is ahead there, and whether its route can be followed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.gap_acceptance import Following
from surrogate.lane_change.place import Guide, Place
from surrogate.road.neighbours import entry_ahead
from surrogate.vehicle.lane_change_model import RouteNeed
from surrogate.xla.materialise import materialise

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class LaneBeside(eqx.Module):
    """A lane beside each vehicle.

    Attributes:
        is_open: whether there is one.
        row: its row; any valid row where there is none.
        entry_ahead: entry ahead in that row.
        need: what the route demands there.
        leads_elsewhere: whether it goes on to another road than the route's.
    """

    is_open: Flag
    row: Int[Array, " vehicle"]
    entry_ahead: Int[Array, " vehicle"]
    need: RouteNeed
    leads_elsewhere: Flag


class Lanes(eqx.Module):
    """The lanes of each vehicle.

    Attributes:
        need: what the route demands in its own lane.
        right: the lane on the right.
        left: the lane on the left.
    """

    need: RouteNeed
    right: LaneBeside
    left: LaneBeside


def lanes_of(place: Place, following: Following) -> Lanes:
    """Return the lanes of each vehicle.

    Args:
        place: the vehicles and where they are.
        following: their car-following models.
    """
    guide = place.guide(place.row)
    space_m = following.length_m(place.vehicles.vehicle_class) + following.jam_gap_m
    rows = materialise((guide.right_row, guide.left_row))
    entries = materialise(tuple(_entry_ahead(place, jnp.maximum(row, 0)) for row in rows))
    right, left = (_lane_beside(place, row, entry, space_m) for row, entry in zip(rows, entries, strict=True))
    own_entry = place.leader.entry
    return Lanes(_need(place, guide, place.row, own_entry, space_m), right, left)


def _entry_ahead(place: Place, row: Int[Array, " vehicle"]) -> Int[Array, " vehicle"]:
    return entry_ahead(place.vehicles.position_m, row, place.everybody.position_m, place.head)


def _lane_beside(
    place: Place, row: Int[Array, " vehicle"], entry: Int[Array, " vehicle"], space_m: Value
) -> LaneBeside:
    """Return the lane in a row, -1 where there is none."""
    is_open = (row >= 0) & place.vehicles.is_vehicle
    row = jnp.maximum(row, 0)
    guide = place.guide(row)
    return LaneBeside(is_open, row, entry, _need(place, guide, row, entry, space_m), guide.leads_elsewhere)


def _need(
    place: Place, guide: Guide, row: Int[Array, " vehicle"], entry: Int[Array, " vehicle"], space_m: Value
) -> RouteNeed:
    """Return what the route needs in `row`, in which `entry` is the vehicle ahead and each takes `space_m`."""
    end_m = place.on_route(place.road.continuation_end_m, row)
    return RouteNeed(
        best_lane_offset=guide.best_lane_offset,
        remaining_m=end_m - place.vehicles.position_m,
        from_edge_m=end_m - place.edge_start_m,
        occupied_m=place.num_ahead(row, guide.track_end, entry) * space_m,
    )
