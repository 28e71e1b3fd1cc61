"""Collects what lane changing needs to know of each vehicle, of its lane and of the lanes beside it."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.car_following.safe_speed import brake_gap_m
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.lane_change.lanes import LaneBeside
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.road.neighbours import Neighbour, shift_down
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.lane_change_model import RouteNeed, Side
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


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


class Wanted(eqx.Module):
    """Speeds that vehicles want where they are."""

    own_mps: Value  # of those asked about
    leader_mps: Value  # of the leader of each of those
    everybodys_mps: Float[Array, " everybody"]  # of all

    @classmethod
    def of(cls, desired_mps: Value) -> "Wanted":
        """Return the record of all vehicles."""
        return cls(desired_mps, shift_down(desired_mps, 0.0), desired_mps)

    def part(self, of: Callable[[Any], Any]) -> "Wanted":
        """Return that of some vehicles; see `VehiclesOnRoad.part`."""
        own_mps, leader_mps = of((self.own_mps, self.leader_mps))
        return Wanted(own_mps, leader_mps, self.everybodys_mps)


def sight_m(vehicles: VehicleArrays, following: Following, step_s: float) -> Value:
    """Distance beyond the end of the edge up to which each vehicle looks for leaders."""
    braking_m = brake_gap_m(vehicles.speed_mps, following.max_deceleration_mps2, following.time_gap_s, step_s)
    return braking_m + following.jam_gap_m


def is_in_sight(on_road: VehiclesOnRoad, leader: Neighbour, edge_start_m: Value, sight_m: Value) -> Flag:
    """Whether a leader exists and lies on the own edge or on one that begins within `sight_m`.

    Source: `MSLaneChanger::getRealLeader`: SUMO looks beyond the end of the edge only as far as the vehicle needs to
    stop, so a leader further on is as good as none.
    """
    return leader.exists & (edge_start_m - on_road.vehicles.position_m <= sight_m)


def ego_of(on_road: VehiclesOnRoad, following: Following, wanted: Wanted, need: RouteNeed, sight_m: Value) -> Ego:
    """Own state and own lane of each vehicle."""
    vehicles, leader = on_road.vehicles, on_road.leader
    in_sight = is_in_sight(on_road, leader, on_road.leader_edge_start_m, sight_m)
    gap_m = leader.position_m - following.length_m(leader.vehicle_class) - vehicles.position_m - following.jam_gap_m
    return Ego(
        speed_mps=vehicles.speed_mps,
        acceleration_mps2=vehicles.acceleration_mps2,
        max_speed_mps=wanted.own_mps,
        speed_limit_mps=vehicles.speed_limit_mps,
        length_m=following.length_m(vehicles.vehicle_class),
        lane_length_m=on_road.at_segment(on_road.road.edge_length_m),
        leader_exists=in_sight,
        leader_gap_m=jnp.where(in_sight, gap_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        leader_max_speed_mps=jnp.where(in_sight, wanted.leader_mps, jnp.inf),
        leader_class=leader.vehicle_class,
        need=need,
    )


def side_of(on_road: VehiclesOnRoad, following: Following, wanted: Wanted, sight_m: Value, lane: LaneBeside) -> Side:
    """Return one side of every vehicle."""
    vehicles, entry = on_road.vehicles, lane.entry_ahead
    leader = on_road.neighbour(entry, lane.row)
    in_sight = is_in_sight(on_road, leader, take(on_road.everybodys_edge_start_m, entry), sight_m)
    follower = on_road.neighbour(jnp.minimum(entry + 1, on_road.everybody.row.shape[0] - 1), lane.row)
    length_m = following.length_m(vehicles.vehicle_class)
    leader_gap_m = leader.position_m - following.length_m(leader.vehicle_class) - vehicles.position_m
    follower_jam_m = following.of(follower.vehicle_class).field("jam_gap_m")
    follower_gap_m = vehicles.position_m - length_m - follower.position_m - follower_jam_m
    return Side(
        is_open=lane.is_open,
        row=lane.row,
        leader_entry=entry,
        leader_exists=in_sight,
        leader_gap_m=jnp.where(in_sight, leader_gap_m - following.jam_gap_m, jnp.inf),
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        leader_max_speed_mps=_wanted_by(leader, wanted),
        leader_class=leader.vehicle_class,
        follower_entry=follower.entry,
        follower_exists=follower.exists,
        follower_gap_m=jnp.where(follower.exists, follower_gap_m, jnp.inf),
        follower_speed_mps=follower.speed_mps,
        follower_acceleration_mps2=follower.acceleration_mps2,
        follower_max_speed_mps=_wanted_by(follower, wanted),
        follower_class=follower.vehicle_class,
        need=lane.need,
        leads_elsewhere=lane.leads_elsewhere,
    )


def _wanted_by(neighbour: Neighbour, wanted: Wanted) -> Value:
    return jnp.where(neighbour.exists, take(wanted.everybodys_mps, neighbour.entry), jnp.inf)
