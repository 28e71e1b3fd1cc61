"""Who enters now where vehicles depart in any of SUMO's ways.

Each vehicle is tried as SUMO tries it: at each step since the last decision, at the place and with the speed that its
departure says, against who is ahead and who is behind; with that it has moved on by as much as has passed since.

Source: `MSLane::insertVehicle`, `getDepartSpeed`, `isInsertionSuccess`, `freeInsertion`, `MSEdge::insertVehicle`, SUMO
1.28.
Deviation: leaders and followers are taken to have kept their acceleration since the last decision; one vehicle enters
a lane per decision; gaps between vehicles further on are not sought for departPos "free"; what comes behind the edge
(a lower limit, the end of a lane) is left to car following.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import true_newcomers
from surrogate.effects.base import Newcomers
from surrogate.effects.settings import Effects
from surrogate.inflow.asking import Asking, who_asks
from surrogate.inflow.attempts import attempts_of, checked_speed, moved_on, wanted_speed, ways_of
from surrogate.inflow.departure import ADAPTS, Lane, Position, Speed
from surrogate.inflow.inflow import Inflow, Queues, SubjectPlan
from surrogate.inflow.lane_choice import KEYS_PER_STEP, OnLane, first_of_each_lane, lane_preferences
from surrogate.inflow.newcomers import Entrants, behind_last_m, new_vehicles, speed_factors
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.neighbours import entry_ahead
from surrogate.road.road import Road
from surrogate.road.traffic_state import TrafficState
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise

Candidate = Float[Array, "entrance lane"]
Attempt = Float[Array, "entrance lane attempt"]


def entrants_by_rule(
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
    num_steps: int = 1,
    subject_first: bool = False,
) -> Entrants:
    """Return who may enter now: for each lane the first of those in a queue who want it.

    As `entering.entrants`, but for:

    Args:
        state: the state.
        queues: the queues now.
        road: geometry.
        inflow: where vehicles enter, with a timetable and rules.
        classes: vehicle classes.
        subject: when and where the subject vehicle enters.
        seed: seed of the run.
        now_s: time.
        step_s: car-following step.
        effects: what the baseline lacks; None for the baseline.
        num_steps: steps since the last decision.
        subject_first: whether nobody enters before the subject vehicle, as where that repeats its log.
    """
    rules, vehicles = inflow.rules, state.vehicles
    assert rules is not None
    waiting, everybody = materialise(who_asks(state, queues, inflow, subject, now_s, subject_first))
    vehicle_class = jnp.take_along_axis(inflow.flow_class, everybody.flow, axis=1)
    vehicle_class = jnp.where(everybody.is_subject, subject.vehicle_class, vehicle_class)
    destination = jnp.take_along_axis(inflow.flow_destination, everybody.flow, axis=1)
    destination = jnp.where(everybody.is_subject, subject.destination, destination)
    speed_factor = speed_factors(classes, vehicle_class, seed, everybody.identity)
    if effects is not None:
        newcomers = Newcomers(everybody.identity, vehicle_class, speed_factor, everybody.is_subject)
        true = true_newcomers(effects, newcomers, classes, seed)
        vehicle_class, speed_factor = true.vehicle_class, true.speed_factor

    # who on which lane
    row = jnp.maximum(inflow.lane_row, 0)
    start_m, end_m = (jnp.broadcast_to(edge_m[:, None], row.shape) for edge_m in (inflow.start_m, inflow.end_m))
    last = entry_ahead(start_m, row, vehicles.position_m, state.head)
    last_m = take(vehicles.position_m, last)
    is_occupied = (take(vehicles.vehicle_class, last) >= 0) & (last_m <= end_m)
    limit = take(road.speed_limit_mps.reshape(-1), row * road.num_segments + road.segment_at(start_m))
    on_lane = OnLane(vehicles, row, start_m, end_m, limit, is_occupied, last)
    preference = lane_preferences(on_lane, inflow, rules, classes, everybody, vehicle_class, destination, speed_factor)
    if rules.has_random_lanes:
        keys = everybody.identity[..., None] * KEYS_PER_STEP + jnp.arange(row.shape[1])
        any_lane = uniform(seed, keys, state.step, Purpose.DEPART_LANE)
        is_any = (rules.lane == Lane.RANDOM)[:, None, None] & (preference > -jnp.inf)
        preference = jnp.where(is_any, any_lane, preference)
    chosen = materialise(first_of_each_lane(materialise(preference)))

    def of(values: Array) -> Array:
        return jnp.take_along_axis(values, jnp.maximum(chosen, 0), axis=1)

    asking = Asking(*map(of, everybody))
    is_waiting = asking.is_there & (chosen >= 0)
    is_subject = asking.is_subject & is_waiting
    vehicle_class, destination, speed_factor = of(vehicle_class), of(destination), of(speed_factor)
    ways = ways_of(rules, asking)

    # how fast, if nobody minds
    top = select_by_class([c.max_speed_mps for c in classes], vehicle_class)
    if Speed.GIVEN in rules.speeds:  # SUMO has such a driver want to go as fast as he comes
        is_given = ways.speed == Speed.GIVEN
        speed_factor = jnp.where(is_given, jnp.maximum(speed_factor, ways.speed_mps / limit), speed_factor)
    desired = jnp.minimum(speed_factor * limit, top)
    speed = wanted_speed(rules.speeds, ways, desired, speed_factor, on_lane, seed, asking.identity, state.step)
    adapts = jnp.isin(ways.speed, jnp.asarray(ADAPTS))
    adapts |= ~is_occupied & jnp.isin(ways.speed, jnp.asarray((Speed.AVERAGE, Speed.LAST)))
    adapts |= ways.position == Position.FREE

    vehicle_class, speed, desired, adapts = materialise((vehicle_class, speed, desired, adapts))

    # where and when: at each step since the last decision, the first first
    model = CarFollowingMix(tuple(c.car_following for c in classes), vehicle_class)
    length = select_by_class([c.length_m for c in classes], vehicle_class)
    nearest_m = behind_last_m(on_lane.vehicles, on_lane.last, on_lane.end_m, classes, model, speed, step_s)
    position, ago_s, is_tried = attempts_of(
        rules.positions, ways, start_m, end_m, length, nearest_m, seed, asking.identity, state.step, num_steps,
        step_s,
    )  # fmt: skip
    position, ago_s, is_tried = materialise((position, ago_s, is_tried))
    is_tried &= (now_s - ago_s > asking.since_s[:, :, None] - step_s) | (ago_s == 0.0)
    checked, fits = checked_speed(
        state, classes, vehicle_class, row, position, ago_s, speed, adapts, desired, length, step_s
    )
    checked, fits = materialise((checked, fits & is_tried))
    attempt = jnp.argmax(fits, axis=2, keepdims=True)

    def of_attempt(values: Attempt) -> Candidate:
        return jnp.take_along_axis(values, attempt, axis=2)[:, :, 0]

    enters = is_waiting & jnp.any(fits, axis=2)
    enters &= _is_first_on_lane(row, enters, asking.since_s)
    position, speed, ago_s = materialise((of_attempt(position), of_attempt(checked), of_attempt(ago_s)))
    ahead = entry_ahead(position, row, vehicles.position_m, state.head)
    position, speed = moved_on(state, classes, model, ahead, position, speed, ago_s, desired, num_steps, step_s)
    newcomers = new_vehicles(
        position, speed, row, vehicle_class, destination, asking.identity, speed_factor, limit,
        vehicles.track.shape[1:], seed, effects,
    )  # fmt: skip
    each = (row.size, 1)  # nobody waits for one who wants another lane
    return Entrants(
        newcomers, ahead.reshape(each), enters.reshape(each), jnp.zeros(each, jnp.int32), is_subject.reshape(each),
        waiting, asking.slot,
    )  # fmt: skip


def _is_first_on_lane(
    row: Int[Array, "entrance lane"], enters: Bool[Array, "entrance lane"], since_s: Candidate
) -> Bool[Array, "entrance lane"]:
    """Return whether nobody who has waited for longer enters the same lane from another queue."""
    rows, coming, since = row.reshape(-1), enters.reshape(-1), since_s.reshape(-1)
    number = jnp.arange(rows.shape[0])
    is_earlier = (since[None, :] < since[:, None]) | (
        (since[None, :] == since[:, None]) & (number[None, :] < number[:, None])
    )
    is_kept_out = jnp.any((rows[None, :] == rows[:, None]) & coming[None, :] & is_earlier, axis=1)
    return ~is_kept_out.reshape(row.shape)
