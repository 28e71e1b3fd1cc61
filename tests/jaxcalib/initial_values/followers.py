"""Followers whose drivers are known, as samples of car-following: each with a desired speed of his own."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxcalib.initial_values.following_samples import FollowingSamples
from surrogate.car_following.idm import Idm
from surrogate.car_following.replay import ReplayStart, replay

STEP_S, LIMIT_MPS = 0.1, 25.0
NUM_DRIVES, PER_DRIVE = 3, 4
NAMES = ("minGap", "tau", "accel", "decel", "nothing")
TRUTH = np.asarray([2.7, 1.45, 1.1, 1.7, 0.3])  # the last one is no parameter of the model
LOWER, UPPER = np.asarray([0.5, 0.4, 0.3, 0.5, 0.0]), np.asarray([6.0, 3.0, 5.0, 8.0, 1.0])
FACTORS = np.linspace(0.74, 1.06, NUM_DRIVES * PER_DRIVE)


def idm(theta: Array) -> Idm:
    jam_gap_m, time_gap_s, acceleration_mps2, deceleration_mps2 = theta[:4]
    return Idm(
        jam_gap_m=jam_gap_m,
        time_gap_s=time_gap_s,
        max_acceleration_mps2=acceleration_mps2,
        max_deceleration_mps2=deceleration_mps2,
        emergency_deceleration_mps2=jnp.asarray(9.0, jnp.float32),
        acceleration_exponent=jnp.asarray(4.0, jnp.float32),
    )


def leaders_mps(num_steps: int) -> np.ndarray:
    """Return leaders who stop and go, and now and then drive off so that the desired speed shows, [step, follower]."""
    time_s, phase = STEP_S * np.arange(num_steps)[:, None], 0.9 * np.arange(len(FACTORS))
    waves = 13.0 + 11.0 * np.sin(time_s / 13.0 + phase) + 3.0 * np.sin(time_s / 3.7 + 2.0 * phase)
    return np.maximum(waves, 0.0).astype(np.float32)


def samples(num_steps: int = 600, every: int = 3, factors: Sequence[float] | np.ndarray = FACTORS) -> FollowingSamples:
    """Return moments of all followers after their first three seconds."""
    leader = leaders_mps(num_steps)
    at_first = jnp.asarray(leader[0])
    start = ReplayStart(
        speed_mps=at_first,
        acceleration_mps2=jnp.zeros_like(at_first),
        gap_m=6.0 + 1.6 * at_first,
        leader_acceleration_mps2=jnp.zeros_like(at_first),
        desired_speed_mps=jnp.asarray(factors, jnp.float32) * LIMIT_MPS,
    )
    half = jnp.full_like(at_first, 0.5)
    _, states = replay(idm(jnp.asarray(TRUTH, jnp.float32)), start, jnp.asarray(leader), half, STEP_S)
    speed, gap, acceleration = (
        np.asarray(part, float) for part in (states.speed_mps, states.gap_m, states.acceleration_mps2)
    )
    # a state is that after a step, where the next begins
    step, follower = (part.ravel() for part in np.mgrid[30 : num_steps - 1 : every, : len(FACTORS)])
    return FollowingSamples(
        vehicle=7 * follower + 2,  # numbers of vehicles need not follow one another
        drive=follower // PER_DRIVE,
        row=np.zeros(len(step), int),
        position_m=np.zeros(len(step)),
        speed_mps=speed[step - 1, follower],
        acceleration_mps2=acceleration[step - 1, follower],
        gap_m=gap[step - 1, follower],
        leader_speed_mps=leader[step, follower][:, None].astype(float),
        leader_acceleration_mps2=(leader[step, follower] - leader[step - 1, follower]).astype(float) / STEP_S,
        later_speed_mps=speed[step, follower],
        step_s=STEP_S,
    )
