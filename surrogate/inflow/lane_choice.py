"""Which of those who ask may try to enter which lane: what is left of SUMO's departLane beside `Inflow.serves`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.inflow.asking import Asking
from surrogate.inflow.departure import DepartureRules, Lane
from surrogate.inflow.inflow import Inflow
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.vehicle_class import VehicleClass, select_by_class
from surrogate.xla.gather import take

KEYS_PER_STEP = 64  # of random numbers of a vehicle that waits
Candidate = Float[Array, "entrance lane"]


class OnLane(NamedTuple):
    """Who is on each lane."""

    vehicles: VehicleArrays
    row: Int[Array, "entrance lane"]
    start_m: Candidate
    end_m: Candidate
    limit_mps: Candidate
    is_occupied: Bool[Array, "entrance lane"]
    last: Int[Array, "entrance lane"]

    def room_m(self) -> Candidate:
        """Return how far the last vehicle is from the lane's begin."""
        last_m = take(self.vehicles.position_m, self.last)
        return jnp.where(self.is_occupied, last_m, self.end_m) - self.start_m

    def mean_mps(self) -> Candidate:
        """Return the mean speed of the vehicles on the lane; 0 where there are none."""
        position_m = self.vehicles.position_m
        is_there = (self.vehicles.row == self.row[..., None]) & self.vehicles.is_vehicle
        is_there &= (position_m > self.start_m[..., None]) & (position_m <= self.end_m[..., None])
        total = jnp.sum(jnp.where(is_there, self.vehicles.speed_mps, 0.0), axis=-1)
        return total / jnp.maximum(jnp.sum(is_there, axis=-1), 1)


def lane_preferences(
    on_lane: OnLane,
    inflow: Inflow,
    rules: DepartureRules,
    classes: tuple[VehicleClass, ...],
    asking: Asking,
    vehicle_class: Int[Array, "entrance asking"],
    destination: Int[Array, "entrance asking"],
    speed_factor: Float[Array, "entrance asking"],
) -> Float[Array, "entrance asking lane"]:
    """Return how much each likes each lane; -inf where he may not enter it, or is not there."""
    num_entrances = inflow.lane_row.shape[0]
    serves = inflow.serves[jnp.arange(num_entrances)[:, None], destination] & (inflow.lane_row >= 0)[:, None]
    serves &= asking.is_there[..., None]
    if rules.has_probable_lanes:
        tops, vehicles, limit = [c.max_speed_mps for c in classes], on_lane.vehicles, on_lane.limit_mps
        last_top = select_by_class(tops, take(vehicles.vehicle_class, on_lane.last))
        last_wants = jnp.minimum(take(vehicles.speed_factor, on_lane.last) * limit, last_top)
        last_wants = jnp.where(on_lane.is_occupied, last_wants, 0.0)
        wants = jnp.minimum(speed_factor * limit[:, :1], select_by_class(tops, vehicle_class))
        is_too_slow = wants_less_than_someone_right(wants, last_wants, serves)
        serves &= ~(is_too_slow & (rules.lane == Lane.PROBABLE)[:, None, None])
    return jnp.where(serves, on_lane.room_m()[:, None], -jnp.inf)


def wants_less_than_someone_right(
    wants: Float[Array, "entrance asking"],
    last_wants: Float[Array, "entrance lane"],
    serves: Bool[Array, "entrance asking lane"],
) -> Bool[Array, "entrance asking lane"]:
    """Return on which lanes a vehicle would be slower than the last one on a lane further right wants to be.

    Source: `MSEdge::getProbableLane`, SUMO 1.28: such lanes are not for him with departLane "best_prob".
    """
    others = jnp.where(serves, last_wants[:, None], 0.0)
    highest = jax.lax.cummax(others, axis=2)
    further_right = jnp.concatenate([jnp.zeros_like(highest[..., :1]), highest[..., :-1]], axis=2)
    return wants[..., None] < further_right


def first_of_each_lane(preference: Float[Array, "entrance asking lane"]) -> Int[Array, "entrance lane"]:
    """Return who takes each lane, -1 where nobody does, if each in turn takes what he likes best of what is left.

    Ties go to the right, as in SUMO. Nobody waits for one who wants another lane (`MSEdge::insertVehicle`).
    """
    chosen = jnp.full(preference[:, 0].shape, -1, jnp.int32)
    lanes = jnp.arange(preference.shape[2])
    for number in range(preference.shape[1]):
        own = jnp.where(chosen < 0, preference[:, number], -jnp.inf)
        takes = (lanes == jnp.argmax(own, axis=1)[:, None]) & (own > -jnp.inf)
        chosen = jnp.where(takes, number, chosen)
    return chosen
