"""Who enters now where vehicles depart in any of SUMO's ways.

Each vehicle is tried as SUMO tries it: at each step since the last decision, at the place and with the speed that its
departure says, against who is ahead and who is behind; with that it has moved on by as much as has passed since.

Source: `MSLane::insertVehicle`, `getDepartSpeed`, `isInsertionSuccess`, `freeInsertion`, `MSEdge::insertVehicle`, SUMO
1.28.
Deviation: leaders and followers are taken to have kept their acceleration since the last decision; one vehicle enters
a lane per decision; gaps between vehicles further on are not sought for departPos "free"; what comes behind the edge
(a lower limit, the end of a lane) is left to car following.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import true_newcomers
from surrogate.effects.base import Newcomers
from surrogate.effects.settings import Effects
from surrogate.inflow.departure import ADAPTS, DepartureRules, Lane, Position, Speed
from surrogate.inflow.inflow import ENTRANCE_STRIDE, Inflow, Queues, SubjectPlan, subject_identity
from surrogate.inflow.newcomers import NOBODY_WAITS, SMALLEST_GAP_M, Entrants, new_vehicles, speed_factors
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.neighbours import entry_ahead
from surrogate.road.road import Road
from surrogate.road.traffic_state import TrafficState, VehicleArrays
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take
from surrogate.xla.materialise import materialise

RANDOM_PLACES = 10  # that SUMO tries for "random_free"
WAITING_SLOTS = 16  # of those who wait for the same lanes, so many may be overtaken by who wants another
KEYS_PER_STEP = 64  # of random numbers of a vehicle that waits
Candidate = Float[Array, "entrance lane"]
Attempt = Float[Array, "entrance lane attempt"]


class _Asking(NamedTuple):
    """Those at the front of each queue who may ask for a lane, by how long they have waited.

    Attributes:
        is_there: whether there is one.
        is_subject: whether it is the subject vehicle.
        slot: its place in the list of those who wait; behind its end for the subject vehicle.
        identity: who it is.
        flow: flow that it is of.
        since_s: since when it has waited.
    """

    is_there: Bool[Array, "entrance asking"]
    is_subject: Bool[Array, "entrance asking"]
    slot: Int[Array, "entrance asking"]
    identity: Int[Array, "entrance asking"]
    flow: Int[Array, "entrance asking"]
    since_s: Float[Array, "entrance asking"]


class _Ways(NamedTuple):
    """How each candidate departs."""

    position: Int[Array, "entrance lane"]
    position_m: Candidate
    speed: Int[Array, "entrance lane"]
    speed_mps: Candidate


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
    waiting, everybody = materialise(_who_asks(state, queues, inflow, subject, now_s, subject_first))
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
    on_lane = _OnLane(vehicles, row, start_m, end_m, limit, is_occupied, last)
    preference = _preferences(on_lane, inflow, rules, classes, everybody, vehicle_class, destination, speed_factor)
    if rules.has_random_lanes:
        keys = everybody.identity[..., None] * KEYS_PER_STEP + jnp.arange(row.shape[1])
        any_lane = uniform(seed, keys, state.step, Purpose.DEPART_LANE)
        is_any = (rules.lane == Lane.RANDOM)[:, None, None] & (preference > -jnp.inf)
        preference = jnp.where(is_any, any_lane, preference)
    chosen = materialise(first_of_each_lane(materialise(preference)))

    def of(values: Array) -> Array:
        return jnp.take_along_axis(values, jnp.maximum(chosen, 0), axis=1)

    asking = _Asking(*map(of, everybody))
    is_waiting = asking.is_there & (chosen >= 0)
    is_subject = asking.is_subject & is_waiting
    vehicle_class, destination, speed_factor = of(vehicle_class), of(destination), of(speed_factor)
    ways = _ways_of(rules, asking)

    # how fast, if nobody minds
    top = select_by_class([c.max_speed_mps for c in classes], vehicle_class)
    if Speed.GIVEN in rules.speeds:  # SUMO has such a driver want to go as fast as he comes
        is_given = ways.speed == Speed.GIVEN
        speed_factor = jnp.where(is_given, jnp.maximum(speed_factor, ways.speed_mps / limit), speed_factor)
    desired = jnp.minimum(speed_factor * limit, top)
    speed = _wanted_speed(rules.speeds, ways, desired, speed_factor, on_lane, seed, asking.identity, state.step)
    adapts = jnp.isin(ways.speed, jnp.asarray(ADAPTS))
    adapts |= ~is_occupied & jnp.isin(ways.speed, jnp.asarray((Speed.AVERAGE, Speed.LAST)))
    adapts |= ways.position == Position.FREE

    vehicle_class, speed, desired, adapts = materialise((vehicle_class, speed, desired, adapts))

    # where and when: at each step since the last decision, the first first
    model = CarFollowingMix(tuple(c.car_following for c in classes), vehicle_class)
    length = select_by_class([c.length_m for c in classes], vehicle_class)
    behind_last_m = _behind_last(on_lane, classes, model, speed, step_s)
    position, ago_s, is_tried = _attempts(
        rules.positions, ways, start_m, end_m, length, behind_last_m, seed, asking.identity, state.step, num_steps,
        step_s,
    )  # fmt: skip
    position, ago_s, is_tried = materialise((position, ago_s, is_tried))
    is_tried &= (now_s - ago_s > asking.since_s[:, :, None] - step_s) | (ago_s == 0.0)
    checked, fits = _checked_speed(
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
    position, speed = _moved_on(state, classes, model, ahead, position, speed, ago_s, desired, num_steps, step_s)
    newcomers = new_vehicles(
        position, speed, row, vehicle_class, destination, asking.identity, speed_factor, limit,
        vehicles.track.shape[1:], seed, effects,
    )  # fmt: skip
    each = (row.size, 1)  # nobody waits for one who wants another lane
    return Entrants(
        newcomers, ahead.reshape(each), enters.reshape(each), jnp.zeros(each, jnp.int32), is_subject.reshape(each),
        waiting, asking.slot,
    )  # fmt: skip


def still_waiting(
    candidates: Entrants, has_entered: Bool[Array, "candidate one"]
) -> Int[Array, "entrance slot"] | None:
    """Return who waits after some have entered; None where queues need no list."""
    if candidates.waiting is None or candidates.slot is None:
        return None
    waiting, slot = candidates.waiting, candidates.slot
    slots = jnp.arange(waiting.shape[1])
    left = (slot[..., None] == slots) & has_entered.reshape(slot.shape)[..., None]
    waiting = jnp.where(jnp.any(left, axis=1), NOBODY_WAITS, waiting)
    in_front = jnp.argsort(waiting == NOBODY_WAITS, axis=1, stable=True)
    return jnp.take_along_axis(waiting, in_front, axis=1)


def _who_asks(
    state: TrafficState,
    queues: Queues,
    inflow: Inflow,
    subject: SubjectPlan,
    now_s: Float[Array, ""],
    subject_first: bool,
) -> tuple[Int[Array, "entrance slot"], _Asking]:
    """Return the list of those who wait at the front of each queue, and with the subject vehicle who may ask."""
    table, waiting = inflow.timetable, state.waiting
    assert table is not None
    assert waiting is not None
    num_entrances, num_slots = waiting.shape
    num_waiting = jnp.sum(waiting != NOBODY_WAITS, axis=1, dtype=jnp.int32)
    slot = jnp.arange(num_slots, dtype=jnp.int32)
    next_arrival = (state.num_inserted + num_waiting)[:, None] + slot - num_waiting[:, None]
    comes = (slot >= num_waiting[:, None]) & (next_arrival < queues.num_arrived[:, None])
    waiting = jnp.where(comes, next_arrival, waiting)
    num_taken = state.num_inserted + jnp.sum(waiting != NOBODY_WAITS, axis=1, dtype=jnp.int32)

    waits, which = subject.waiting(state.subject_inserted, now_s)
    depart_s = subject.depart_s[which] if subject.num_subjects else subject.depart_s
    if not subject_first:
        waits &= table.num_until(subject.entrance, depart_s) <= num_taken[subject.entrance]
    is_own_queue = jnp.arange(num_entrances, dtype=jnp.int32) == subject.entrance

    arrival = jnp.clip(waiting, 0, table.time_s.shape[1] - 1)
    place = jnp.take_along_axis(table.place, arrival, axis=1)
    entrance = jnp.arange(num_entrances, dtype=jnp.int32)[:, None]
    own_identity = jnp.broadcast_to(subject_identity(num_entrances) + which, (num_entrances, 1))

    def with_subject(others: Array, own: Array) -> Array:
        return jnp.concatenate([others, jnp.broadcast_to(own, (num_entrances, 1)).astype(others.dtype)], axis=1)

    is_there = with_subject(waiting != NOBODY_WAITS, (is_own_queue & waits)[:, None])
    since_s = with_subject(
        jnp.take_along_axis(table.time_s, arrival, axis=1), jnp.asarray(-jnp.inf) if subject_first else depart_s
    )
    asking = _Asking(
        is_there=is_there,
        is_subject=with_subject(jnp.zeros(waiting.shape, bool), is_own_queue[:, None]),
        slot=with_subject(jnp.broadcast_to(slot, waiting.shape), jnp.asarray(num_slots)),
        identity=with_subject(entrance * ENTRANCE_STRIDE + place, own_identity),
        flow=with_subject(jnp.take_along_axis(table.flow, place, axis=1), jnp.asarray(0)),
        since_s=since_s,
    )
    in_turn = jnp.argsort(jnp.where(is_there, since_s, jnp.inf), axis=1, stable=True)
    return waiting, _Asking(*(jnp.take_along_axis(values, in_turn, axis=1) for values in asking))


class _OnLane(NamedTuple):
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


def _preferences(
    on_lane: _OnLane,
    inflow: Inflow,
    rules: DepartureRules,
    classes: tuple[VehicleClass, ...],
    asking: _Asking,
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


def _ways_of(rules: DepartureRules, asking: _Asking) -> _Ways:
    def of(table: Array, of_subject: float) -> Array:
        return jnp.where(asking.is_subject, of_subject, jnp.take_along_axis(table, asking.flow, axis=1))

    own = rules.subject
    return _Ways(
        of(rules.position, int(own.position)), of(rules.position_m, own.position_m),
        of(rules.speed, int(own.speed)), of(rules.speed_mps, own.speed_mps),
    )  # fmt: skip


def _wanted_speed(
    occurring: Sequence[Speed],
    ways: _Ways,
    desired: Candidate,
    speed_factor: Candidate,
    on_lane: _OnLane,
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
    step: Int[Array, ""],
) -> Candidate:
    """Return the speed that each departure says, before anybody in the way is looked at."""
    last_mps = take(on_lane.vehicles.speed_mps, on_lane.last)
    speed = desired
    for one in occurring:
        if one is Speed.GIVEN:
            value = ways.speed_mps
        elif one is Speed.LIMIT:
            value = jnp.minimum(desired / speed_factor, on_lane.limit_mps)
        elif one is Speed.RANDOM:
            value = desired * uniform(seed, identity, step, Purpose.DEPART_SPEED)
        elif one is Speed.LAST:
            value = jnp.where(on_lane.is_occupied, jnp.minimum(desired, last_mps), desired)
        elif one is Speed.AVERAGE:
            value = jnp.minimum(desired, jnp.where(on_lane.is_occupied, on_lane.mean_mps(), on_lane.limit_mps))
        else:
            continue
        speed = jnp.where(ways.speed == one, value, speed)
    return speed


def _behind_last(
    on_lane: _OnLane, classes: tuple[VehicleClass, ...], model: CarFollowingMix, speed: Candidate, step_s: float
) -> Candidate:
    """Return the place right behind the last vehicle, as close as is safe, or the lane's end."""
    vehicles, last = on_lane.vehicles, on_lane.last
    last_class = take(vehicles.vehicle_class, last)
    brakes = CarFollowingMix(model.models, last_class).field("max_deceleration_mps2")
    needed_m = model.secure_gap_m(speed, take(vehicles.speed_mps, last), brakes, step_s)
    needed_m = needed_m + model.field("jam_gap_m") + SMALLEST_GAP_M
    rear_m = take(vehicles.position_m, last) - select_by_class([c.length_m for c in classes], last_class)
    latest_m = on_lane.end_m - SMALLEST_GAP_M
    return jnp.where(last_class >= 0, jnp.minimum(latest_m, rear_m - needed_m), latest_m)


def _attempts(
    occurring: Sequence[Position],
    ways: _Ways,
    start_m: Candidate,
    end_m: Candidate,
    length: Candidate,
    behind_last_m: Candidate,
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
    step: Int[Array, ""],
    num_steps: int,
    step_s: float,
) -> tuple[Attempt, Attempt, Bool[Array, "entrance lane attempt"]]:
    """Return where each candidate is tried, how long ago, and whether it is."""
    has_free_places = Position.RANDOM_FREE in occurring
    num_attempts = max(num_steps, RANDOM_PLACES + 1) if has_free_places else num_steps
    number = jnp.arange(num_attempts, dtype=jnp.int32)
    start, end, way = start_m[..., None], end_m[..., None], ways.position[..., None]
    # the same place at each step, those of long ago first
    ago_s = jnp.broadcast_to((num_steps - 1 - number) * step_s, (*start_m.shape, num_attempts)).astype(jnp.float32)
    is_tried = jnp.broadcast_to(number < num_steps, ago_s.shape)
    given = ways.position_m[..., None]
    place = jnp.minimum(start + length[..., None] + SMALLEST_GAP_M, end)
    place = jnp.where(way == Position.GIVEN, jnp.where(given < 0.0, end, start) + given, place)
    place = jnp.clip(jnp.where(way == Position.FREE, start, place), start, end)
    place = jnp.broadcast_to(place, ago_s.shape)
    if Position.LAST in occurring:
        is_last = way == Position.LAST
        place = jnp.where(is_last, behind_last_m[..., None], place)
        ago_s = jnp.where(is_last, 0.0, ago_s)
        is_tried &= ~is_last | ((number == 0) & (behind_last_m >= start_m)[..., None])
    if Position.RANDOM in occurring or has_free_places:
        keys = identity[..., None] * KEYS_PER_STEP + number
        anywhere = start + (end - start) * uniform(seed, keys, step, Purpose.DEPART_POSITION)
        is_random = way == Position.RANDOM
        place = jnp.where(is_random, anywhere, place)
        ago_s = jnp.where(is_random, 0.0, ago_s)
        if has_free_places:
            is_random_free = way == Position.RANDOM_FREE
            place = jnp.where(is_random_free, jnp.where(number < RANDOM_PLACES, anywhere, start), place)
            ago_s = jnp.where(is_random_free, 0.0, ago_s)
            is_tried |= is_random_free & (number <= RANDOM_PLACES)
    return place, jnp.maximum(ago_s, 0.0), is_tried


def _checked_speed(
    state: TrafficState,
    classes: tuple[VehicleClass, ...],
    vehicle_class: Int[Array, "entrance lane"],
    row: Int[Array, "entrance lane"],
    position: Attempt,
    ago_s: Attempt,
    speed: Candidate,
    adapts: Bool[Array, "entrance lane"],
    desired: Candidate,
    length: Candidate,
    step_s: float,
) -> tuple[Attempt, Bool[Array, "entrance lane attempt"]]:
    """Return the speed with which each attempt would succeed, and whether it does."""
    vehicles, models = state.vehicles, tuple(c.car_following for c in classes)
    lengths = [c.length_m for c in classes]
    shape = position.shape
    row_ = jnp.broadcast_to(row[..., None], shape)
    own_class = jnp.broadcast_to(vehicle_class[..., None], shape)
    ahead = entry_ahead(position, row_, vehicles.position_m, state.head)
    behind = jnp.minimum(ahead + 1, vehicles.row.shape[0] - 1)
    own = CarFollowingMix(models, own_class)
    wanted = jnp.broadcast_to(speed[..., None], shape)

    ahead_class, ahead_m, ahead_mps = _then(vehicles, ahead, ago_s)
    has_leader = ahead_class >= 0
    gap_m = jnp.where(has_leader, ahead_m - select_by_class(lengths, ahead_class) - position, jnp.inf)
    situation = FollowingSituation(
        speed_mps=wanted,
        gap_m=gap_m,
        leader_speed_mps=jnp.where(has_leader, ahead_mps, 0.0),
        leader_acceleration_mps2=jnp.zeros(shape, jnp.float32),
        acceleration_mps2=jnp.zeros(shape, jnp.float32),
        desired_speed_mps=jnp.broadcast_to(desired[..., None], shape),
        uniform=jnp.full(shape, 0.5, jnp.float32),
    )
    ahead_model = CarFollowingMix(models, ahead_class)
    safe = own.insertion_speed_mps(situation, ahead_model.field("max_deceleration_mps2"), step_s)
    safe = jnp.where(has_leader, jnp.minimum(safe, wanted), wanted)
    fits = gap_m >= own.field("jam_gap_m")
    fits &= adapts[..., None] | (safe >= wanted) | (wanted <= 0.0)
    checked = jnp.where(adapts[..., None], safe, wanted)

    behind_class, behind_m, behind_mps = _then(vehicles, behind, ago_s)
    has_follower = (behind_class >= 0) & (take(vehicles.row, behind) == row_)
    follower = CarFollowingMix(models, behind_class)
    rear_gap_m = position - length[..., None] - behind_m - follower.field("jam_gap_m")
    needed_m = follower.secure_gap_m(behind_mps, checked, own.field("max_deceleration_mps2"), step_s)
    fits &= ~has_follower | (rear_gap_m >= needed_m)
    return checked, fits


def _then(
    vehicles: VehicleArrays, entry: Int[Array, "*shape"], ago_s: Float[Array, "*shape"]
) -> tuple[Int[Array, "*shape"], Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Return class, position and speed that vehicles had some time ago, if they have not changed their acceleration."""
    speed_mps, acceleration = take(vehicles.speed_mps, entry), take(vehicles.acceleration_mps2, entry)
    before_mps = jnp.maximum(speed_mps - acceleration * ago_s, 0.0)
    position_m = take(vehicles.position_m, entry) - 0.5 * (speed_mps + before_mps) * ago_s
    return take(vehicles.vehicle_class, entry), position_m, before_mps


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


def _moved_on(
    state: TrafficState,
    classes: tuple[VehicleClass, ...],
    model: CarFollowingMix,
    ahead: Int[Array, "entrance lane"],
    position: Candidate,
    speed: Candidate,
    ago_s: Candidate,
    desired: Candidate,
    num_steps: int,
    step_s: float,
) -> tuple[Candidate, Candidate]:
    """Return where the candidates are and how fast, if they have followed their leader since they entered."""
    lengths = [c.length_m for c in classes]
    highest, lowest = model.field("max_acceleration_mps2"), -model.field("emergency_deceleration_mps2")

    def step(number: Int[Array, ""], now: tuple[Candidate, Candidate]) -> tuple[Candidate, Candidate]:
        position, speed = now
        left_s = (num_steps - 1 - number) * step_s
        ahead_class, ahead_m, ahead_mps = _then(state.vehicles, ahead, jnp.full_like(speed, left_s))
        has_leader = ahead_class >= 0
        situation = FollowingSituation(
            speed_mps=speed,
            gap_m=jnp.where(has_leader, ahead_m - select_by_class(lengths, ahead_class) - position, jnp.inf),
            leader_speed_mps=jnp.where(has_leader, ahead_mps, 0.0),
            leader_acceleration_mps2=jnp.zeros_like(speed),
            acceleration_mps2=jnp.zeros_like(speed),
            desired_speed_mps=desired,
            uniform=jnp.full_like(speed, 0.5),
        )
        acceleration = jnp.clip(model.acceleration(situation, step_s), lowest, highest)
        later = jnp.clip(speed + acceleration * step_s, 0.0, jnp.maximum(desired, speed))
        is_there = ago_s > left_s - 0.5 * step_s
        return jnp.where(is_there, position + later * step_s, position), jnp.where(is_there, later, speed)

    return jax.lax.fori_loop(0, num_steps - 1, step, (position, speed))
