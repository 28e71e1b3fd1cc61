"""Open loop: recorded leaders drive simulated followers."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.vehicle_limits import limited_acceleration, next_speed_mps

Value = Float[Array, "*step follower"]


class ReplayStart(eqx.Module):
    """Followers at the beginning of a replay."""

    speed_mps: Value  # own speed
    acceleration_mps2: Value  # own acceleration in the step before
    gap_m: Value  # gap to the leader
    leader_acceleration_mps2: Value  # the leader's acceleration in the step before
    desired_speed_mps: Value  # speed wanted


class ReplayState(eqx.Module):
    """Followers during a replay."""

    speed_mps: Value
    acceleration_mps2: Value
    gap_m: Value


class LeaderMotion(eqx.Module):
    """Leaders at the beginning of a step, and how far they get in it."""

    speed_mps: Value
    acceleration_mps2: Value
    advance_m: Value


def replay(
    model: CarFollowingModel,
    start: ReplayStart,
    leader_speed_mps: Float[Array, "step follower"],
    uniform: Value,
    step_s: float,
) -> tuple[ReplayState, ReplayState]:
    """Return the followers after the last step, and after every step along a leading axis.

    Args:
        model: one model for all followers, or one record with a value for each.
        start: the followers at the beginning.
        leader_speed_mps: the leaders' speeds at the beginning of each step.
        uniform: random number of each follower, the same in all steps.
        step_s: length of a step.

    The followers obey the same rules as on the road (`surrogate.loop.kinematics`) but for what lane changing asks of
    them; the leader's position follows from his speeds by the same semi-implicit Euler step.
    """
    first = ReplayState(start.speed_mps, start.acceleration_mps2, start.gap_m)
    before = leader_speed_mps[0] - step_s * start.leader_acceleration_mps2
    previous = jnp.concatenate([before[None], leader_speed_mps[:-1]])
    following = jnp.concatenate([leader_speed_mps[1:], leader_speed_mps[-1:]])

    def one_step(state: ReplayState, leader: tuple[Value, Value, Value]) -> tuple[ReplayState, ReplayState]:
        past, now, later = leader
        motion = LeaderMotion(now, (now - past) / step_s, step_s * later)
        moved = follow(model, state, motion, start.desired_speed_mps, uniform, step_s)
        return moved, moved

    return jax.lax.scan(one_step, first, (previous, leader_speed_mps, following))


def follow(
    model: CarFollowingModel,
    state: ReplayState,
    leader: LeaderMotion,
    desired_speed_mps: Value,
    uniform: Value,
    step_s: float,
) -> ReplayState:
    """Return the followers one step later.

    Args:
        model: one model for all followers, or one record with a value for each.
        state: the followers now.
        leader: what their leaders do.
        desired_speed_mps: speed wanted.
        uniform: random number of each follower.
        step_s: length of a step.
    """
    situation = FollowingSituation(
        speed_mps=state.speed_mps,
        gap_m=state.gap_m,
        leader_speed_mps=leader.speed_mps,
        leader_acceleration_mps2=leader.acceleration_mps2,
        acceleration_mps2=state.acceleration_mps2,
        desired_speed_mps=desired_speed_mps,
        uniform=uniform,
    )
    acceleration = limited_acceleration(
        model.acceleration(situation, step_s),
        state.speed_mps,
        desired_speed_mps,
        model.max_acceleration_mps2,
        model.max_deceleration_mps2,
        model.emergency_deceleration_mps2,
        step_s,
    )
    speed = next_speed_mps(state.speed_mps, acceleration, step_s)
    return after_speed(state, speed, leader.advance_m, step_s)


def after_speed(
    state: ReplayState, speed_mps: Value, leader_advance_m: Float[Array, "..."], step_s: float
) -> ReplayState:
    """Return the followers one step later, given the speeds that they reach; linear, so tangents obey it as well."""
    gap = state.gap_m + leader_advance_m - step_s * speed_mps
    return ReplayState(speed_mps, (speed_mps - state.speed_mps) / step_s, gap)
