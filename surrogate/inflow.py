"""Vehicles that enter: random arrivals, the queue before a full entrance, and the place where each may enter.

Arrivals are a Poisson process in *demand*: the k-th vehicle of an entrance arrives when its cumulated demand reaches
the sum of k exponential numbers. So a change of the demand moves arrivals in time but never exchanges the vehicles:
arrival k keeps its destination and its driver under every parameter set.

Source for the rules of entering: SUMO's departLane="best" (the lane with most room before its last vehicle),
departPos="last" (behind that vehicle, no closer than its secure gap) and departSpeed="avg" (mean speed on the lane),
`MSEdge::getFreeLane`, `MSLane::lastInsertion`.
"""

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import ndtri
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import true_arrival, true_newcomers, with_memories
from surrogate.effects.base import Arrivals, Newcomers
from surrogate.effects.settings import Effects
from surrogate.keyed_random import Purpose, exponential, uniform
from surrogate.neighbours import entry_ahead, take
from surrogate.road import Road
from surrogate.traffic_state import UNSEEN, TrafficState, VehicleArrays
from surrogate.vehicle_class import CarFollowingMix, VehicleClass, select_by_class

ARRIVALS_PER_DECISION = 4  # at most this many join a queue per decision; the rest come at the next one
ENTRANCE_STRIDE = 1 << 20  # identity = entrance * stride + arrival number
SMALLEST_GAP_M = 0.1  # SUMO's POSITION_EPS
SPEED_FACTOR_BOUNDS = (0.2, 2.0)  # SUMO's defaults for normc


def subject_identity(num_entrances: int) -> int:
    """Return what keys the first subject vehicle's random numbers; those of further ones follow."""
    return num_entrances * ENTRANCE_STRIDE


class Inflow(eqx.Module):
    """Where and as what vehicles enter.

    Attributes:
        lane_row: rows of each entrance's lanes, from the right; -1 beyond the last.
        start_m: where the entrance's first edge begins.
        end_m: where it ends; newcomers are placed on it.
        serves: whether a lane of the entrance is among the best for a destination (SUMO's departLane="best").
        is_regular: whether vehicles arrive evenly instead of at random.
        flow_share: cumulated shares of the flows of each entrance; 1 from the last flow on.
        flow_destination: destination of each flow.
        flow_class: vehicle class of each flow.
        begin_s: when the entrance opens.
        end_s: when it closes.
    """

    lane_row: Int[Array, "entrance lane"]
    start_m: Float[Array, " entrance"]
    end_m: Float[Array, " entrance"]
    serves: Bool[Array, "entrance destination lane"]
    is_regular: Bool[Array, " entrance"]
    flow_share: Float[Array, "entrance flow"]
    flow_destination: Int[Array, "entrance flow"]
    flow_class: Int[Array, "entrance flow"]
    begin_s: Float[Array, " entrance"]
    end_s: Float[Array, " entrance"]

    @property
    def num_entrances(self) -> int:
        """Number of entrances."""
        return self.start_m.shape[0]


class SubjectPlan(eqx.Module):
    """When and where the subject vehicle enters.

    Attributes:
        depart_s: when it enters, or as soon after as there is room. Several subject vehicles have a time each, in
            order.
        entrance: index of its entrance.
        destination: index of its destination.
        vehicle_class: its class; a number of the trace, not a leaf.
    """

    depart_s: Float[Array, "*subject"]
    entrance: int = eqx.field(static=True)
    destination: int = eqx.field(static=True)
    vehicle_class: int = eqx.field(static=True)

    @property
    def num_subjects(self) -> int:
        """How many subject vehicles there are; 0 where there is one, of which arrays then have no axis."""
        return self.depart_s.shape[0] if self.depart_s.ndim else 0

    def waiting(self, inserted: Bool[Array, "*subject"], now_s: Float[Array, ""]) -> tuple[Array, Array | int]:
        """Return whether one waits to enter, and which.

        Args:
            inserted: which are on the road, or were.
            now_s: time.
        """
        waits = ~inserted & (now_s >= self.depart_s)
        if not self.num_subjects:
            return waits, 0
        return jnp.any(waits), jnp.argmax(waits).astype(jnp.int32)


class Queues(eqx.Module):
    """The queues after the arrivals of one decision."""

    num_arrived: Int[Array, " entrance"]
    next_arrival: Float[Array, " entrance"]
    cumulated_demand: Float[Array, " entrance"]


def arrive(
    state: TrafficState,
    inflow: Inflow,
    demand_vehps: Float[Array, " entrance"],
    seed: Int[Array, ""],
    now_s: Float[Array, ""],
    interval_s: float,
    effects: Effects | None = None,
    mainline: int = 0,
) -> Queues:
    """Return the queues after `interval_s` more of demand.

    Args:
        state: the road before.
        inflow: where vehicles enter.
        demand_vehps: demand of each entrance.
        seed: seed of the run.
        now_s: time.
        interval_s: time since the last call.
        effects: what the baseline lacks; None for the baseline.
        mainline: entrance of the subject vehicle.
    """
    draws = ArrivalDraws(inflow, demand_vehps, seed, effects, mainline)
    is_open = (now_s > inflow.begin_s) & (now_s <= inflow.end_s)
    demand = state.cumulated_demand + jnp.where(is_open, demand_vehps * interval_s, 0.0)
    num_arrived, threshold = state.num_arrived, state.next_arrival
    for _ in range(ARRIVALS_PER_DECISION):
        has_come = demand >= threshold
        num_arrived = num_arrived + has_come
        threshold = threshold + jnp.where(has_come, draws.demand_to(num_arrived), 0.0)
    return Queues(num_arrived, threshold, demand)


class ArrivalDraws(eqx.Module):
    """How far apart vehicles arrive.

    Attributes:
        inflow: where vehicles enter.
        demand_vehps: demand of each entrance.
        seed: seed of the run.
        effects: what the baseline lacks; None for the baseline.
        mainline: entrance of the subject vehicle.
    """

    inflow: Inflow
    demand_vehps: Float[Array, " entrance"]
    seed: Int[Array, ""]
    effects: Effects | None
    mainline: int = eqx.field(static=True)

    def demand_to(self, arrival: Int[Array, " entrance"]) -> Float[Array, " entrance"]:
        """Return the demand [veh] between arrival number `arrival` - 1 and `arrival`."""
        entrance = jnp.arange(self.inflow.num_entrances, dtype=jnp.int32)
        gap = exponential(self.seed, entrance * ENTRANCE_STRIDE + arrival, 0, Purpose.ARRIVAL)
        if self.effects is not None:
            num_lanes = jnp.sum(self.inflow.lane_row >= 0, axis=1, dtype=jnp.int32)
            is_mainline = entrance == self.mainline
            gap = true_arrival(
                self.effects, gap, Arrivals(arrival, num_lanes, self.demand_vehps, is_mainline, self.seed)
            )
        return jnp.where(self.inflow.is_regular, 1.0, gap)


class Entrants(eqx.Module):
    """Candidates to enter at one decision, one per lane of each entrance.

    Attributes:
        vehicles: the candidates.
        entry_ahead: entry behind which each goes.
        enters: whether there is one and it has room.
        rank: place in the queue.
        is_subject: whether it is the subject vehicle.
    """

    vehicles: VehicleArrays
    entry_ahead: Int[Array, "entrance lane"]
    enters: Bool[Array, "entrance lane"]
    rank: Int[Array, "entrance lane"]
    is_subject: Bool[Array, "entrance lane"]


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
    speed_factor = _speed_factor(classes, vehicle_class, seed, identity)
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
    lane, is_served = _choose_lanes(room_m, inflow, destination)

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
    models_ahead = CarFollowingMix(model.models, last_class)
    needed_m = model.secure_gap_m(speed, last_mps, models_ahead.field("max_deceleration_mps2"), step_s)
    needed_m = needed_m + model.field("jam_gap_m") + SMALLEST_GAP_M
    rear_m = last_m - select_by_class([c.length_m for c in classes], last_class)
    latest_m = end_m - SMALLEST_GAP_M
    position = jnp.where(has_last, jnp.minimum(latest_m, rear_m - needed_m), latest_m)
    enters = is_waiting & is_served & (position >= start_m)
    enters = jnp.cumsum(~enters, axis=1) == 0  # nobody overtakes in the queue

    zero = jnp.zeros((num_entrances * num_lanes,), jnp.float32)
    newcomers = VehicleArrays(
        position_m=position.reshape(-1),
        speed_mps=speed.reshape(-1),
        acceleration_mps2=zero,
        row=row.reshape(-1),
        vehicle_class=vehicle_class.reshape(-1),
        destination=destination.reshape(-1),
        identity=identity.reshape(-1),
        track=jnp.full((row.size, *vehicles.track.shape[1:]), UNSEEN, jnp.int32),
        speed_factor=speed_factor.reshape(-1),
        gain_left_memory=zero,
        gain_right_memory=zero,
        keep_right_memory=zero,
        look_ahead_speed_mps=zero,
        own_advice_mps2=jnp.full_like(zero, jnp.inf),
        asked_advice_mps2=jnp.full_like(zero, jnp.inf),
        speed_limit_mps=limit.reshape(-1),
        slow_position_m=jnp.full_like(zero, jnp.inf),
        slow_limit_mps=limit.reshape(-1),
        stop_position_m=jnp.full_like(zero, jnp.inf),
    )
    if effects is not None:
        newcomers = with_memories(effects, newcomers, seed)
    return Entrants(newcomers, last, enters, rank, is_subject)


def _choose_lanes(
    room_m: Float[Array, "entrance lane"], inflow: Inflow, destination: Int[Array, "entrance rank"]
) -> tuple[Int[Array, "entrance rank"], Bool[Array, "entrance rank"]]:
    """Return the lane of each in the queue, and whether any was left that serves his destination.

    Ties go to the right, as in SUMO.
    """
    num_entrances, num_lanes = room_m.shape
    free = jnp.where(inflow.lane_row >= 0, room_m, -jnp.inf)
    lanes, served = [], []
    for rank in range(num_lanes):
        serves = inflow.serves[jnp.arange(num_entrances), destination[:, rank]]
        candidate = jnp.where(serves, free, -jnp.inf)
        lane = jnp.argmax(candidate, axis=1).astype(jnp.int32)
        is_served = jnp.max(candidate, axis=1) > -jnp.inf
        taken = (jnp.arange(num_lanes) == lane[:, None]) & is_served[:, None]
        free = jnp.where(taken, -jnp.inf, free)
        lanes.append(lane)
        served.append(is_served)
    return jnp.stack(lanes, axis=1), jnp.stack(served, axis=1)


def _draw(
    cumulated: Float[Array, "entrance option"],
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
    purpose: Purpose,
) -> Int[Array, "entrance lane"]:
    chance = uniform(seed, identity, 0, purpose)
    # the last share is 1 but for rounding: compare with all but the last, so that rounding cannot run off the end
    return jnp.sum(chance[:, :, None] > cumulated[:, None, :-1], axis=2).astype(jnp.int32)


def _speed_factor(
    classes: tuple[VehicleClass, ...],
    vehicle_class: Int[Array, "entrance lane"],
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
) -> Float[Array, "entrance lane"]:
    mean = select_by_class([c.speed_factor_mean for c in classes], vehicle_class)
    deviation = select_by_class([c.speed_factor_deviation for c in classes], vehicle_class)
    normal = ndtri(uniform(seed, identity, 0, Purpose.SPEED_FACTOR))
    return jnp.clip(mean + deviation * normal, *SPEED_FACTOR_BOUNDS)
