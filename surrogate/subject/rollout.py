"""Where everybody will be: the subject vehicle under each candidate, and its neighbours as they react to it."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LEADER_MEMORY_S = 1.0  # how long a leader is expected to keep his acceleration
FARTHEST_M = 1e4  # stands for "nobody there": finite, so that differences stay finite
SMALLEST_GAP_M = 0.1
LARGEST_RISK = 25.0

Value = Float[Array, "..."]


def with_constant_acceleration(
    speed_mps: Value, acceleration_mps2: Value, top_mps: Value, times_s: Float[Array, " time"]
) -> tuple[Value, Value]:
    """Return distances and speeds at the given times, time last; the speed stays between 0 and `top_mps`.

    Exact: the speed is linear up to where it meets its bound, and constant from there on.
    """
    bound = jnp.where(acceleration_mps2 > 0.0, jnp.maximum(top_mps, speed_mps), 0.0)
    rate = jnp.where(acceleration_mps2 == 0.0, 1.0, acceleration_mps2)
    until_s = jnp.where(acceleration_mps2 == 0.0, jnp.inf, (bound - speed_mps) / rate)
    run_s = jnp.minimum(times_s, until_s[..., None])
    v, a = speed_mps[..., None], acceleration_mps2[..., None]
    distance = v * run_s + 0.5 * a * run_s**2
    after_s = times_s - run_s
    reached = v + a * run_s
    return distance + after_s * reached, reached


def of_leader(speed_mps: Value, acceleration_mps2: Value, times_s: Float[Array, " time"]) -> tuple[Value, Value]:
    """Return distances and speeds of leaders whose acceleration fades within about a second, time last.

    A leader that brakes to a standstill stands.
    """
    v, a = speed_mps[..., None], acceleration_mps2[..., None]
    faded = 1.0 - jnp.exp(-times_s / LEADER_MEMORY_S)
    speed = jnp.maximum(v + a * LEADER_MEMORY_S * faded, 0.0)
    steps = jnp.diff(times_s, prepend=0.0)
    before = jnp.concatenate([v, speed[..., :-1]], axis=-1)
    return jnp.cumsum(0.5 * (speed + before) * steps, axis=-1), speed


def desired_gap_m(
    speed_mps: Value, leader_speed_mps: Value, jam_gap_m: Value, time_gap_s: Value, braking_mps2: Value
) -> Value:
    """Return the IDM's desired gap.

    Args:
        speed_mps: own speed.
        leader_speed_mps: the leader's speed.
        jam_gap_m: s0.
        time_gap_s: T.
        braking_mps2: sqrt(a b).

    Source: Treiber et al. (2000), eq. (3); its dynamic part is floored at 0.
    """
    closing = speed_mps * (speed_mps - leader_speed_mps) / (2.0 * braking_mps2)
    return jam_gap_m + jnp.maximum(0.0, speed_mps * time_gap_s + closing)


def risk(gap_m: Value, desired_m: Value) -> Value:
    """Return (desired gap / gap)^2, bounded: 1 at the desired gap, dimensionless (the IDM's interaction term)."""
    return jnp.minimum((desired_m / jnp.maximum(gap_m, SMALLEST_GAP_M)) ** 2, LARGEST_RISK)


def of_follower(
    gap_m: Value,
    speed_mps: Value,
    desired_mps: Value,
    own_leader: tuple[Value, Value],
    subject: tuple[Value, Value],
    is_before_it: Value | np.ndarray,
    driver: tuple[Value, Value, Value, Value],
    yield_mps2: Value,
    step_s: float,
) -> tuple[Value, Value]:
    """Return gap to the subject vehicle and speed of followers in the lane changed to, time last.

    Args:
        gap_m: gap from the follower to the subject vehicle now.
        speed_mps: its speed.
        desired_mps: speed that it wants.
        own_leader: distance from the follower's front to the rear of the vehicle ahead in its lane, and the speed of
            that one, at the end of each step; time last.
        subject: distances and speeds of the subject vehicle, time last.
        is_before_it: whether the subject vehicle is in that lane at the end of each step; time last.
        driver: jam gap, time gap, acceleration and comfortable deceleration expected of the driver.
        yield_mps2: how hard he yields at most.
        step_s: length of a step.
    """
    jam_gap_m, time_gap_s, a, b = driver
    braking = jnp.sqrt(a * b)
    leader_m, leader_mps = own_leader
    subject_m, subject_mps = subject

    def advance(carry: tuple[Value, Value], now: tuple[Value, ...]) -> tuple[tuple[Value, Value], tuple[Value, Value]]:
        travelled, v = carry
        rear_m, rear_mps, x, u, claimed = now
        to_subject_m = gap_m + x - travelled
        to_leader_m = rear_m - travelled
        is_nearer = claimed & (to_subject_m < to_leader_m)
        ahead_m = jnp.where(is_nearer, to_subject_m, to_leader_m)
        ahead_mps = jnp.where(is_nearer, u, rear_mps)
        free = (v / jnp.maximum(desired_mps, 0.1)) ** 4
        near = risk(ahead_m, desired_gap_m(v, ahead_mps, jam_gap_m, time_gap_s, braking))
        wanted = jnp.clip(a * (1.0 - free - near), -yield_mps2, a)
        new_v = jnp.maximum(v + wanted * step_s, 0.0)
        travelled = travelled + 0.5 * (v + new_v) * step_s
        return (travelled, new_v), (gap_m + x - travelled, new_v)

    shape = jnp.broadcast_shapes(gap_m.shape, subject_m.shape[:-1])
    start = jnp.zeros(shape), jnp.broadcast_to(speed_mps, shape)
    whole = (*shape, subject_m.shape[-1])
    inputs = tuple(
        jnp.moveaxis(jnp.broadcast_to(each, whole), -1, 0)
        for each in (leader_m, leader_mps, subject_m, subject_mps, is_before_it)
    )
    _, (gaps_m, speeds_mps) = jax.lax.scan(advance, start, inputs)
    return jnp.moveaxis(gaps_m, 0, -1), jnp.moveaxis(speeds_mps, 0, -1)
