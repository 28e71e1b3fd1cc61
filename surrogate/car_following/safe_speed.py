"""Braking distances and safe speeds in SUMO's time-discrete kinematics.

SUMO moves vehicles by x' = x + v' dt with the new speed v' (semi-implicit Euler), so a vehicle that brakes with b
covers v dt less than in continuous time. These are the closed forms of `MSCFModel::brakeGapEuler` and
`MSCFModel::maximumSafeStopSpeedEuler`, which all SUMO car-following models share (SUMO 1.28). Gaps are measured from
the front bumper to the place where the vehicle must stand; SUMO has already taken `minGap` off.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Value = Float[Array, "..."]
EMERGENCY_FACTOR = 1.2
SMALLEST_DISTANCE_M = 1e-3  # SUMO's NUMERICAL_EPS: so much it stops earlier


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
    """
    b, t, s = deceleration_mps2 * step_s, reaction_time_s, step_s
    gap = jnp.clip(gap_m - SMALLEST_DISTANCE_M, 0.0, 1e6)  # bounded, so that inf does not become nan below
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


def emergency_follow_speed_mps(
    safe_speed_mps: Value,
    speed_mps: Value,
    gap_m: Value,
    leader_speed_mps: Value,
    deceleration_mps2: Value,
    leader_deceleration_mps2: Value,
    emergency_deceleration_mps2: Value,
    step_s: float,
) -> Value:
    """Return the safe speed, or a higher one where it could only be reached by braking harder than usual.

    The reaction time in the safe speed asks for more than is needed in an emergency, so the driver then brakes as the
    distance alone demands, by a fifth more, but no less than usual and no more than for the safe speed.

    Args:
        safe_speed_mps: from `safe_follow_speed_mps`.
        speed_mps: own speed.
        gap_m: less the jam gap; inf means no leader.
        leader_speed_mps: the leader's speed.
        deceleration_mps2: what the driver is ready to use.
        leader_deceleration_mps2: what he expects of his leader.
        emergency_deceleration_mps2: physical bound; the rule holds only where it exceeds the usual deceleration.
        step_s: length of a time step.

    Source: `MSCFModel::maximumSafeFollowSpeed` and `calculateEmergencyDeceleration`, SUMO 1.28 (the factor and the
    rule are confirmed step by step, see experiments/fidelity).
    """
    gap = jnp.minimum(gap_m, 1e6)
    wanted_mps2 = (speed_mps - safe_speed_mps) / step_s
    leader_stops_m = 0.5 * leader_speed_mps**2 / leader_deceleration_mps2
    behind_a_stop = 0.5 * speed_mps**2 / jnp.maximum(gap + leader_stops_m, SMALLEST_DISTANCE_M)
    both_brake = 0.5 * (speed_mps**2 - leader_speed_mps**2) / jnp.maximum(gap, SMALLEST_DISTANCE_M)
    needed_mps2 = jnp.where(behind_a_stop <= leader_deceleration_mps2, behind_a_stop, both_brake)
    needed_mps2 = jnp.clip(
        EMERGENCY_FACTOR * needed_mps2, deceleration_mps2, jnp.maximum(wanted_mps2, deceleration_mps2)
    )
    needed_mps2 = jnp.where(gap < 0.0, emergency_deceleration_mps2, needed_mps2)
    is_emergency = (wanted_mps2 > deceleration_mps2) & (emergency_deceleration_mps2 > deceleration_mps2)
    return jnp.where(is_emergency, jnp.maximum(speed_mps - needed_mps2 * step_s, 0.0), safe_speed_mps)


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
