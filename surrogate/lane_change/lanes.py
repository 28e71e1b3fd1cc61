"""The lanes that a vehicle may be in after a decision: who is ahead there, and whether its route can be followed."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.gap_acceptance import Following
from surrogate.lane_change.vehicles_on_road import Guide, VehiclesOnRoad
from surrogate.road.neighbours import entry_ahead
from surrogate.vehicle.lane_change_model import RouteNeed
from surrogate.xla.materialise import materialise

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class LaneBeside(eqx.Module):
    """A lane beside each vehicle."""

    is_open: Flag  # whether there is one
    row: Int[Array, " vehicle"]  # its row; any valid row where there is none
    entry_ahead: Int[Array, " vehicle"]  # entry ahead in that row
    need: RouteNeed  # what the route demands there
    leads_elsewhere: Flag  # whether it goes on to another road than the route's


class Lanes(eqx.Module):
    """The lanes of each vehicle."""

    need: RouteNeed  # what the route demands in its own lane
    right: LaneBeside  # the lane on the right
    left: LaneBeside  # the lane on the left


def lanes_of(on_road: VehiclesOnRoad, following: Following) -> Lanes:
    """Return the lanes of each vehicle.

    Args:
        on_road: the vehicles and where they are.
        following: their car-following models.
    """
    guide = on_road.guide(on_road.row)
    space_m = following.length_m(on_road.vehicles.vehicle_class) + following.jam_gap_m
    rows = materialise((guide.right_row, guide.left_row))
    entries = materialise(tuple(_entry_ahead(on_road, jnp.maximum(row, 0)) for row in rows))
    right, left = (_lane_beside(on_road, row, entry, space_m) for row, entry in zip(rows, entries, strict=True))
    own_entry = on_road.leader.entry
    return Lanes(_need(on_road, guide, on_road.row, own_entry, space_m), right, left)


def _entry_ahead(on_road: VehiclesOnRoad, row: Int[Array, " vehicle"]) -> Int[Array, " vehicle"]:
    return entry_ahead(on_road.vehicles.position_m, row, on_road.everybody.position_m, on_road.head)


def _lane_beside(
    on_road: VehiclesOnRoad, row: Int[Array, " vehicle"], entry: Int[Array, " vehicle"], space_m: Value
) -> LaneBeside:
    """Return the lane in a row, -1 where there is none."""
    is_open = (row >= 0) & on_road.vehicles.is_vehicle
    row = jnp.maximum(row, 0)
    guide = on_road.guide(row)
    return LaneBeside(is_open, row, entry, _need(on_road, guide, row, entry, space_m), guide.leads_elsewhere)


def _need(
    on_road: VehiclesOnRoad, guide: Guide, row: Int[Array, " vehicle"], entry: Int[Array, " vehicle"], space_m: Value
) -> RouteNeed:
    """What the route needs in `row`, in which `entry` is the vehicle ahead and each takes `space_m`."""
    end_m = on_road.on_route(on_road.road.continuation_end_m, row)
    return RouteNeed(
        best_lane_offset=guide.best_lane_offset,
        remaining_m=end_m - on_road.vehicles.position_m,
        from_edge_m=end_m - on_road.edge_start_m,
        occupied_m=on_road.num_ahead(row, guide.track_end, entry) * space_m,
    )
