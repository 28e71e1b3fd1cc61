"""Braking distances and safe speeds in SUMO's time-discrete kinematics.

SUMO moves vehicles by x' = x + v' dt with the new speed v' (semi-implicit Euler), so a vehicle that brakes with b
covers v dt less than in continuous time. These are the closed forms of `MSCFModel::brakeGapEuler` and
`MSCFModel::maximumSafeStopSpeedEuler`, which all SUMO car-following models share (SUMO 1.28). Gaps are measured from
the front bumper to the place where the vehicle must stand; SUMO has already taken `minGap` off.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]


def brake_gap_m(speed_mps: Value, deceleration_mps2: Value, reaction_time_s: Value | float, step_s: float) -> Value:
    """Return the distance covered until standstill.

    Args:
        speed_mps: speed >= 0 at the beginning.
        deceleration_mps2: constant deceleration > 0.
        reaction_time_s: time driven at the initial speed before braking begins.
        step_s: length of a time step.
    """
    speed_per_step = deceleration_mps2 * step_s
    num_steps = jnp.floor(speed_mps / speed_per_step)
    braking_m = step_s * (num_steps * speed_mps - speed_per_step * num_steps * (num_steps + 1.0) / 2.0)
    return braking_m + speed_mps * reaction_time_s


def safe_stop_speed_mps(gap_m: Value, deceleration_mps2: Value, reaction_time_s: Value, step_s: float) -> Value:
    """Return the highest speed from which a vehicle still stands after `gap_m`.

    Args:
        gap_m: free distance; 0 or less gives speed 0, inf gives inf.
        deceleration_mps2: deceleration > 0 that the driver is ready to use.
        reaction_time_s: time driven at the returned speed before braking begins.
        step_s: length of a time step.

    Deviation: SUMO takes 0.001 m off the gap first, which no measure resolves.
    """
    b, t, s = deceleration_mps2 * step_s, reaction_time_s, step_s
    gap = jnp.clip(gap_m, 0.0, 1e6)  # bounded, so that inf does not become nan below
    # n steps of braking cover 0.5 n (n - 1) b s + n b t; n is the largest whole number that fits in the gap
    n = jnp.floor(0.5 - (t - 0.5 * jnp.sqrt(s * s + 4.0 * (s * (2.0 * gap / b - t) + t * t))) / s)
    covered = 0.5 * n * (n - 1.0) * b * s + n * b * t
    speed = n * b + (gap - covered) / (n * s + t)
    return jnp.where(gap_m == jnp.inf, jnp.inf, jnp.maximum(speed, 0.0))


def safe_follow_speed_mps(
    gap_m: Value,
    leader_speed_mps: Value,
    deceleration_mps2: Value,
    leader_deceleration_mps2: Value,
    reaction_time_s: Value,
    step_s: float,
) -> Value:
    """Return the highest speed that is safe behind a leader who may brake to a standstill (Krauss).

    Source: `MSCFModel::maximumSafeFollowSpeed`. The leader is assumed to brake at least as hard as the follower,
    because two braking paths may cross even if the final gap is positive.
    """
    leader_brake_gap_m = brake_gap_m(
        leader_speed_mps, jnp.maximum(deceleration_mps2, leader_deceleration_mps2), 0.0, step_s
    )
    return safe_stop_speed_mps(gap_m + leader_brake_gap_m, deceleration_mps2, reaction_time_s, step_s)


def krauss_secure_gap_m(
    speed_mps: Value,
    leader_speed_mps: Value,
    deceleration_mps2: Value,
    leader_deceleration_mps2: Value,
    reaction_time_s: Value,
    step_s: float,
) -> Value:
    """Return the gap that keeps a follower safe if the leader brakes to a standstill.

    Source: `MSCFModel::getSecureGap`.
    """
    leader_deceleration_mps2 = jnp.maximum(deceleration_mps2, leader_deceleration_mps2)
    own_m = brake_gap_m(speed_mps, deceleration_mps2, reaction_time_s, step_s)
    return jnp.maximum(0.0, own_m - brake_gap_m(leader_speed_mps, leader_deceleration_mps2, 0.0, step_s))


def late_braking_speed_mps(
    distance_m: Value, target_speed_mps: Value, deceleration_mps2: Value, step_s: float
) -> Value:
    """Return the highest speed from which a lower one is still reached after `distance_m`.

    Source: `MSCFModel::freeSpeed`.
    Deviation: the continuous-time form v^2 = v_target^2 + 2 b d, with one step driven at the new speed before the next
    deceleration; less than one step away from SUMO's discrete one.
    """
    distance = jnp.clip(distance_m - target_speed_mps * step_s, 0.0, 1e6)
    half_step = 0.5 * deceleration_mps2 * step_s
    bound = -half_step + jnp.sqrt(half_step**2 + target_speed_mps**2 + 2.0 * deceleration_mps2 * distance)
    return jnp.maximum(bound, target_speed_mps)
