"""Collects what lane changing needs to know of each vehicle, of its lane and of the lanes beside it."""

from collections.abc import Callable
from copy import copy
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.car_following.safe_speed import brake_gap_m
from surrogate.lane_change.base import RouteNeed, Side
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.neighbours import Neighbour, entry_ahead, neighbour_at, own_leader, take
from surrogate.road import Road
from surrogate.traffic_state import VehicleArrays
from surrogate.vehicle_class import CarFollowingMix, VehicleClass, select_by_class

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class Place:
    """Where vehicles are: their segments, and the road tables read there. Not a record: lives within one trace.

    Attributes:
        road: the road.
        head: first entry of each row.
        everybody: all vehicles.
        everybodys_edge_start_m: where the edge of each of them begins.
        vehicles: those asked about; all, unless it is a part.
        leader: leader of each of those in its own row.
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
        ends = road.end_position_m
        rows = jnp.arange(road.num_rows, dtype=jnp.int32)
        # entry ahead of each place where a lane ends for somebody, per row: counts the vehicles up to there
        self._end_entry = entry_ahead(
            jnp.broadcast_to(ends, (road.num_rows, ends.shape[0])),
            jnp.broadcast_to(rows[:, None], (road.num_rows, ends.shape[0])),
            vehicles.position_m,
            head,
        ).reshape(-1)

    def part(self, of: Callable[[Any], Any]) -> "Place":
        """Return the place of some of the vehicles.

        Args:
            of: takes their part of arrays, see `surrogate.tiles`.
        """
        some = copy(self)
        some.vehicles, some.leader = of((self.vehicles, self.leader))
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

    def need(self, row: Int[Array, " vehicle"], entry: Int[Array, " vehicle"], space_m: Value) -> RouteNeed:
        """Return what the route needs in `row`, in which `entry` is the vehicle ahead.

        Args:
            row: row asked about.
            entry: entry ahead in that row.
            space_m: length and jam gap of one vehicle.
        """
        end_m = self.on_route(self.road.continuation_end_m, row)
        end = self.on_route(self.road.track_end, row)
        num_ahead = jnp.maximum(entry - take(self._end_entry, row * self.road.end_position_m.shape[0] + end), 0)
        return RouteNeed(
            best_lane_offset=self.on_route(self.road.best_lane_offset, row),
            remaining_m=end_m - self.vehicles.position_m,
            from_edge_m=end_m - self.edge_start_m,
            occupied_m=num_ahead.astype(space_m.dtype) * space_m,
        )


def following_of(vehicle_class: Int[Array, " vehicle"], classes: tuple[VehicleClass, ...]) -> Following:
    """Return the car-following side of vehicles of the given classes."""
    own = CarFollowingMix(tuple(c.car_following for c in classes), vehicle_class)
    return Following(
        own=own,
        lengths_m=tuple(c.length_m for c in classes),
        jam_gap_m=own.field("jam_gap_m"),
        time_gap_s=own.field("time_gap_s"),
        max_acceleration_mps2=own.field("max_acceleration_mps2"),
        max_deceleration_mps2=own.field("max_deceleration_mps2"),
    )


def desired_speed_mps(vehicles: VehicleArrays, classes: tuple[VehicleClass, ...]) -> Value:
    """Return the speed that each vehicle wants where it is."""
    top = select_by_class([c.max_speed_mps for c in classes], vehicles.vehicle_class)
    return jnp.minimum(vehicles.speed_factor * vehicles.speed_limit_mps, top)


def sight_m(vehicles: VehicleArrays, following: Following, step_s: float) -> Value:
    """Return how far beyond the end of the edge each vehicle looks for leaders."""
    braking_m = brake_gap_m(vehicles.speed_mps, following.max_deceleration_mps2, following.time_gap_s, step_s)
    return braking_m + following.jam_gap_m


def is_in_sight(place: Place, leader: Neighbour, sight_m: Value) -> Flag:
    """Return whether a leader exists and lies on the own edge or on one that begins within `sight_m`.

    Source: `MSLaneChanger::getRealLeader`: SUMO looks beyond the end of the edge only as far as the vehicle needs to
    stop, so a leader further on is as good as none.
    """
    edge_start_m = take(place.everybodys_edge_start_m, leader.entry)
    return leader.exists & (edge_start_m - place.vehicles.position_m <= sight_m)


def ego_of(
    place: Place, following: Following, desired_mps: Value, everybodys_desired_mps: Value, sight_m: Value
) -> Ego:
    """Return what each vehicle knows of itself and its own lane."""
    vehicles, leader = place.vehicles, place.leader
    in_sight = is_in_sight(place, leader, sight_m)
    length_m = following.length_m(vehicles.vehicle_class)
    gap_m = leader.position_m - following.length_m(leader.vehicle_class) - vehicles.position_m - following.jam_gap_m
    return Ego(
        speed_mps=vehicles.speed_mps,
        acceleration_mps2=vehicles.acceleration_mps2,
        max_speed_mps=desired_mps,
        speed_limit_mps=vehicles.speed_limit_mps,
        length_m=length_m,
        lane_length_m=place.at_segment(place.road.edge_length_m),
        leader_exists=in_sight,
        leader_gap_m=jnp.where(in_sight, gap_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        leader_max_speed_mps=jnp.where(in_sight, take(everybodys_desired_mps, leader.entry), jnp.inf),
        leader_class=leader.vehicle_class,
        need=place.need(place.row, leader.entry, length_m + following.jam_gap_m),
    )


def entry_beside(place: Place, is_right: bool) -> Int[Array, " vehicle"]:
    """Return the entry ahead of every vehicle in the row on one side."""
    row = jnp.maximum(_row_beside(place, is_right), 0)
    return entry_ahead(place.vehicles.position_m, row, place.everybody.position_m, place.head)


def side_of(
    place: Place,
    following: Following,
    everybodys_desired_mps: Value,
    sight_m: Value,
    entry: Int[Array, " vehicle"],
    is_right: bool,
) -> Side:
    """Return one side of every vehicle, where `entry` is ahead."""
    vehicles, everybody = place.vehicles, place.everybody
    beside = _row_beside(place, is_right)
    is_open = (beside >= 0) & vehicles.is_vehicle
    row = jnp.maximum(beside, 0)
    leader = neighbour_at(entry, row, everybody)
    in_sight = is_in_sight(place, leader, sight_m)
    follower = neighbour_at(jnp.minimum(entry + 1, everybody.row.shape[0] - 1), row, everybody)
    length_m = following.length_m(vehicles.vehicle_class)
    leader_gap_m = leader.position_m - following.length_m(leader.vehicle_class) - vehicles.position_m
    follower_jam_m = following.of(follower.vehicle_class).field("jam_gap_m")
    follower_gap_m = vehicles.position_m - length_m - follower.position_m - follower_jam_m
    return Side(
        is_open=is_open,
        row=row,
        leader_entry=entry,
        leader_exists=in_sight,
        leader_gap_m=jnp.where(in_sight, leader_gap_m - following.jam_gap_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        leader_max_speed_mps=_desired_of(leader, everybodys_desired_mps),
        leader_class=leader.vehicle_class,
        follower_entry=follower.entry,
        follower_exists=follower.exists,
        follower_gap_m=jnp.where(follower.exists, follower_gap_m, jnp.inf),
        follower_speed_mps=follower.speed_mps,
        follower_acceleration_mps2=follower.acceleration_mps2,
        follower_max_speed_mps=_desired_of(follower, everybodys_desired_mps),
        follower_class=follower.vehicle_class,
        need=place.need(row, entry, length_m + following.jam_gap_m),
        leads_elsewhere=place.at_row(place.road.leads_elsewhere, row),
    )


def _row_beside(place: Place, is_right: bool) -> Int[Array, " vehicle"]:
    return place.at_row(place.road.right_row if is_right else place.road.left_row, place.row)


def _desired_of(neighbour: Neighbour, desired_mps: Value) -> Value:
    return jnp.where(neighbour.exists, take(desired_mps, neighbour.entry), jnp.inf)
