"""Who enters now: the first in each queue, on the lane with most room, as close behind its last vehicle as is safe.

Source for the rules: SUMO's departLane="best" (the lane with most room before its last vehicle), departPos="last"
(behind that vehicle, no closer than its secure gap) and departSpeed="avg" (mean speed on the lane),
`MSEdge::getFreeLane`, `MSLane::lastInsertion`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.effects.apply import true_newcomers
from surrogate.effects.base import Newcomers
from surrogate.effects.settings import Effects
from surrogate.inflow.inflow import ENTRANCE_STRIDE, Inflow, Queues, SubjectPlan, subject_identity
from surrogate.inflow.newcomers import Entrants, behind_last_m, choose_lanes, new_vehicles, speed_factors
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.neighbours import entry_ahead
from surrogate.road.road import Road
from surrogate.road.traffic_state import TrafficState
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take


def entrants(
    state: TrafficState,
    queues: Queues,
    road: Road,
    inflow: Inflow,
    classes: tuple[VehicleClass, ...],
    subject: SubjectPlan,
    seed: Int[Array, ""],
    now_s: Float[Array, ""],
    step_s: float,
    effects: Effects | None = None,
) -> Entrants:
    """Return who may enter now: each in the queue on the lane with most room of those that serve it and are left."""
    vehicles = state.vehicles
    num_entrances, num_lanes = inflow.lane_row.shape
    rank = jnp.broadcast_to(jnp.arange(num_lanes, dtype=jnp.int32), (num_entrances, num_lanes))
    waits_subject, which_subject = subject.waiting(state.subject_inserted, now_s)
    at_subject_entrance = jnp.arange(num_entrances) == subject.entrance
    subject_first = (at_subject_entrance & waits_subject)[:, None]
    is_subject = subject_first & (rank == 0)
    arrival = state.num_inserted[:, None] + rank - subject_first
    is_waiting = (arrival < queues.num_arrived[:, None]) | is_subject

    entrance = jnp.broadcast_to(jnp.arange(num_entrances, dtype=jnp.int32)[:, None], rank.shape)
    subject_key = subject_identity(num_entrances) + which_subject
    identity = jnp.where(is_subject, subject_key, entrance * ENTRANCE_STRIDE + arrival)
    flow = _draw(inflow.flow_share, seed, identity, Purpose.FLOW)
    vehicle_class = jnp.take_along_axis(inflow.flow_class, flow, axis=1)
    vehicle_class = jnp.where(is_subject, subject.vehicle_class, vehicle_class)
    destination = jnp.take_along_axis(inflow.flow_destination, flow, axis=1)
    destination = jnp.where(is_subject, subject.destination, destination)
    speed_factor = speed_factors(classes, vehicle_class, seed, identity)
    if effects is not None:
        true = true_newcomers(effects, Newcomers(identity, vehicle_class, speed_factor, is_subject), classes, seed)
        vehicle_class, speed_factor = true.vehicle_class, true.speed_factor

    lane_start_m = jnp.broadcast_to(inflow.start_m[:, None], rank.shape)
    lane_end_m = jnp.broadcast_to(inflow.end_m[:, None], rank.shape)
    lane_row = jnp.maximum(inflow.lane_row, 0)
    lane_last = entry_ahead(lane_start_m, lane_row, vehicles.position_m, state.head)
    lane_last_m = take(vehicles.position_m, lane_last)
    is_occupied = (take(vehicles.vehicle_class, lane_last) >= 0) & (lane_last_m <= lane_end_m)
    room_m = jnp.where(is_occupied, lane_last_m, lane_end_m) - lane_start_m
    lane, is_served = choose_lanes(room_m, inflow, destination)

    row = jnp.take_along_axis(lane_row, lane, axis=1)
    last = jnp.take_along_axis(lane_last, lane, axis=1)
    start_m, end_m = lane_start_m, lane_end_m
    last_class, last_m, last_mps = (
        take(values, last) for values in (vehicles.vehicle_class, vehicles.position_m, vehicles.speed_mps)
    )
    has_last = last_class >= 0

    # where and how fast
    limit = take(road.speed_limit_mps.reshape(-1), row * road.num_segments + road.segment_at(start_m))
    top = select_by_class([c.max_speed_mps for c in classes], vehicle_class)
    desired_mps = jnp.minimum(speed_factor * limit, top)
    speed = jnp.minimum(desired_mps, jnp.where(has_last & (last_m <= end_m), last_mps, limit))
    model = CarFollowingMix(tuple(c.car_following for c in classes), vehicle_class)
    position = behind_last_m(vehicles, last, end_m, classes, model, speed, step_s)
    enters = is_waiting & is_served & (position >= start_m)
    enters = jnp.cumsum(~enters, axis=1) == 0  # nobody overtakes in the queue

    newcomers = new_vehicles(
        position, speed, row, vehicle_class, destination, identity, speed_factor, limit,
        vehicles.track.shape[1:], seed, effects,
    )  # fmt: skip
    return Entrants(newcomers, last, enters, rank, is_subject)


def _draw(
    cumulated: Float[Array, "entrance option"],
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
    purpose: Purpose,
) -> Int[Array, "entrance lane"]:
    chance = uniform(seed, identity, 0, purpose)
    # the last share is 1 but for rounding: compare with all but the last, so that rounding cannot run off the end
    return jnp.sum(chance[:, :, None] > cumulated[:, None, :-1], axis=2).astype(jnp.int32)
