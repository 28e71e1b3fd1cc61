"""Where, when and how fast a vehicle is tried, whether it may be there, and how far it has come since.

Source: `MSLane::getDepartSpeed`, `insertVehicle`, `isInsertionSuccess`, `lastInsertion`, `freeInsertion`, SUMO 1.28.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.inflow.asking import Asking
from surrogate.inflow.departure import DepartureRules, Position, Speed
from surrogate.inflow.lane_choice import KEYS_PER_STEP, OnLane
from surrogate.inflow.newcomers import SMALLEST_GAP_M
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.neighbours import entry_ahead
from surrogate.road.traffic_state import TrafficState, VehicleArrays
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take

RANDOM_PLACES = 10  # that SUMO tries for "random_free"
Candidate = Float[Array, "entrance lane"]
Attempt = Float[Array, "entrance lane attempt"]


class Ways(NamedTuple):
    """How each candidate departs."""

    position: Int[Array, "entrance lane"]
    position_m: Candidate
    speed: Int[Array, "entrance lane"]
    speed_mps: Candidate


def ways_of(rules: DepartureRules, asking: Asking) -> Ways:
    """Return how each departs."""

    def of(table: Array, of_subject: float) -> Array:
        return jnp.where(asking.is_subject, of_subject, jnp.take_along_axis(table, asking.flow, axis=1))

    own = rules.subject
    return Ways(
        of(rules.position, int(own.position)), of(rules.position_m, own.position_m),
        of(rules.speed, int(own.speed)), of(rules.speed_mps, own.speed_mps),
    )  # fmt: skip


def wanted_speed(
    occurring: Sequence[Speed],
    ways: Ways,
    desired: Candidate,
    speed_factor: Candidate,
    on_lane: OnLane,
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


def attempts_of(
    occurring: Sequence[Position],
    ways: Ways,
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


def checked_speed(
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


def moved_on(
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
