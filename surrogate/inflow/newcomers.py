"""Those who ask to enter: what each is and wants, which lane each takes, and the vehicles that come of it."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax.scipy.special import ndtri
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import with_memories
from surrogate.effects.settings import Effects
from surrogate.inflow.inflow import Inflow
from surrogate.keyed_random import Purpose, uniform
from surrogate.road.traffic_state import UNSEEN, VehicleArrays
from surrogate.vehicle.vehicle_class import CarFollowingMix, VehicleClass, select_by_class
from surrogate.xla.gather import take

SMALLEST_GAP_M = 0.1  # SUMO's POSITION_EPS
NOBODY_WAITS = -1  # in a list of those who wait
SPEED_FACTOR_BOUNDS = (0.2, 2.0)  # SUMO's defaults for normc


class Entrants(eqx.Module):
    """Candidates to enter at one decision, one per lane of each entrance."""

    vehicles: VehicleArrays  # the candidates
    entry_ahead: Int[Array, "entrance lane"]  # entry behind which each goes
    enters: Bool[Array, "entrance lane"]  # whether there is one and it has room
    rank: Int[Array, "entrance lane"]  # place in the queue
    is_subject: Bool[Array, "entrance lane"]  # whether it is the subject vehicle
    # numbers of the arrivals at the front of each queue, this decision's among them; None where nobody overtakes
    # in a queue
    waiting: Int[Array, "entrance slot"] | None = None
    slot: Int[Array, "entrance lane"] | None = None  # place of each candidate in that list


def choose_lanes(
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


def speed_factors(
    classes: tuple[VehicleClass, ...],
    vehicle_class: Int[Array, "entrance lane"],
    seed: Int[Array, ""],
    identity: Int[Array, "entrance lane"],
) -> Float[Array, "entrance lane"]:
    """Return the desired speeds of drivers over the limit, each his own."""
    mean = select_by_class([c.speed_factor_mean for c in classes], vehicle_class)
    deviation = select_by_class([c.speed_factor_deviation for c in classes], vehicle_class)
    normal = ndtri(uniform(seed, identity, 0, Purpose.SPEED_FACTOR))
    return jnp.clip(mean + deviation * normal, *SPEED_FACTOR_BOUNDS)


def new_vehicles(
    position_m: Float[Array, "entrance lane"],
    speed_mps: Float[Array, "entrance lane"],
    row: Int[Array, "entrance lane"],
    vehicle_class: Int[Array, "entrance lane"],
    destination: Int[Array, "entrance lane"],
    identity: Int[Array, "entrance lane"],
    speed_factor: Float[Array, "entrance lane"],
    limit_mps: Float[Array, "entrance lane"],
    of_subjects: Sequence[int],
    seed: Int[Array, ""],
    effects: Effects | None,
) -> VehicleArrays:
    """Return the candidates as vehicles, entrance by entrance.

    Args:
        position_m: where each would be.
        speed_mps: how fast.
        row: in which row.
        vehicle_class: of which class.
        destination: where it goes.
        identity: who it is.
        speed_factor: of its desired speed.
        limit_mps: legal limit where it enters.
        of_subjects: shape of what is kept for each subject vehicle.
        seed: seed of the run.
        effects: what the baseline lacks; None for the baseline.
    """
    zero = jnp.zeros((row.size,), jnp.float32)
    newcomers = VehicleArrays(
        position_m=position_m.reshape(-1),
        speed_mps=speed_mps.reshape(-1),
        acceleration_mps2=zero,
        row=row.reshape(-1),
        vehicle_class=vehicle_class.reshape(-1),
        destination=destination.reshape(-1),
        identity=identity.reshape(-1),
        track=jnp.full((row.size, *of_subjects), UNSEEN, jnp.int32),
        speed_factor=speed_factor.reshape(-1),
        gain_left_memory=zero,
        gain_right_memory=zero,
        keep_right_memory=zero,
        look_ahead_speed_mps=zero,
        own_advice_mps2=jnp.full_like(zero, jnp.inf),
        asked_advice_mps2=jnp.full_like(zero, jnp.inf),
        speed_limit_mps=limit_mps.reshape(-1),
        slow_position_m=jnp.full_like(zero, jnp.inf),
        slow_limit_mps=limit_mps.reshape(-1),
        stop_position_m=jnp.full_like(zero, jnp.inf),
    )
    return newcomers if effects is None else with_memories(effects, newcomers, seed)


def behind_last_m(
    vehicles: VehicleArrays,
    last: Int[Array, "entrance lane"],
    end_m: Float[Array, "entrance lane"],
    classes: tuple[VehicleClass, ...],
    model: CarFollowingMix,
    speed_mps: Float[Array, "entrance lane"],
    step_s: float,
) -> Float[Array, "entrance lane"]:
    """Return the place right behind the last vehicle on a lane, as close as is safe, or the lane's end."""
    last_class, last_m, last_mps = (
        take(values, last) for values in (vehicles.vehicle_class, vehicles.position_m, vehicles.speed_mps)
    )
    models_ahead = CarFollowingMix(model.models, last_class)
    needed_m = model.secure_gap_m(speed_mps, last_mps, models_ahead.field("max_deceleration_mps2"), step_s)
    needed_m = needed_m + model.field("jam_gap_m") + SMALLEST_GAP_M
    rear_m = last_m - select_by_class([c.length_m for c in classes], last_class)
    latest_m = end_m - SMALLEST_GAP_M
    return jnp.where(last_class >= 0, jnp.minimum(latest_m, rear_m - needed_m), latest_m)
