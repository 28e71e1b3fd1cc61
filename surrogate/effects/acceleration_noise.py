"""Drivers misjudge gap and speed difference, and their error persists: SUMO's driver state."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.keyed_random import Purpose, roughly_normal
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.car_following_model import FollowingSituation

NAME = "acceleration_noise"
Value = Float[Array, " vehicle"]

# SUMO's defaults, MSDriverState's `DriverStateDefaults`
ERROR_TIME_SCALE_S = 100.0
ERROR_NOISE_INTENSITY = 0.2
SPEED_DIFFERENCE_ERROR = 0.15
HEADWAY_ERROR = 0.75
SMALLEST_AWARENESS = 0.1
SMALLEST_GAP_SHARE = 0.1  # of the true gap, however wrong the driver is


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"error": jnp.zeros_like(vehicles.speed_mps)}


def _perceive(dial: Dial, situation: FollowingSituation, moment: Moment) -> FollowingSituation:
    """Return the situation with a gap and a speed difference off by shares of the true gap."""
    del dial
    error = jnp.where(moment.is_background, moment.memory(NAME)["error"], 0.0)
    gap = situation.gap_m
    factor = jnp.maximum(1.0 + HEADWAY_ERROR * error, SMALLEST_GAP_SHARE)
    seen = jnp.where((gap > 0.0) & jnp.isfinite(gap), gap * factor, gap)
    wrong_mps = SPEED_DIFFERENCE_ERROR * error * jnp.where(jnp.isfinite(gap), jnp.maximum(gap, 0.0), 0.0)
    leader_mps = jnp.maximum(situation.leader_speed_mps + wrong_mps, 0.0)
    return eqx.tree_at(lambda s: (s.gap_m, s.leader_speed_mps), situation, (seen, leader_mps))


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    """Return the errors one step later: an Ornstein-Uhlenbeck process."""
    del order_mps2
    time_scale_s = ERROR_TIME_SCALE_S * jnp.maximum(1.0 - dial.strength, SMALLEST_AWARENESS)
    step = moment.step_s / time_scale_s
    kick = ERROR_NOISE_INTENSITY * dial.strength * jnp.sqrt(2.0 * step)
    noise = roughly_normal(moment.seed, moment.vehicles.identity, moment.step, Purpose.PERCEPTION_ERROR)
    return {"error": jnp.exp(-step) * moment.memory(NAME)["error"] + kick * noise}


ACCELERATION_NOISE = Effect(
    name=NAME,
    title="drivers misjudge gaps and speeds, persistently",
    unit="1 - awareness of SUMO's driver state, 0 to 0.9",
    weak=0.3,
    medium=0.5,
    strong=0.8,
    acts_on=ActsOn.PERCEPTION,
    source=(
        "SUMO's MSDriverState with its default coefficients; estimation errors as Wiener processes in Treiber, "
        "Kesting & Helbing (2006). Deviation: no threshold below which changes go unnoticed"
    ),
    begin=_begin,
    perceive=_perceive,
    remember=_remember,
)
