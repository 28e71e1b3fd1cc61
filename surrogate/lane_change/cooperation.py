"""How a vehicle that must change lane and its neighbours there adapt their speeds.

Who must change follows the leader in the target lane, or overtakes him if there is time; and he asks the follower to
open a gap, if that can work in the time left, or else lets him pass. Source: `MSLCM_LC2013::informLeader` and
`informFollower` (semi-implicit Euler branch).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from surrogate.car_following.safe_speed import brake_gap_m
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.lane_change_model import Side
from surrogate.vehicle.vehicle_class import CarFollowingMix

Value = Float[Array, " request"]
Flag = Bool[Array, " request"]

URGENCY = 2.0
HELP_OVERTAKE_MPS = 10.0 / 3.6
MIN_FALL_BEHIND_MPS2 = 7.0 / 3.6
CUT_IN_LEFT_SPEED_MPS = 27.0
MAX_ON_RAMP_LENGTH_M = 200.0
CONGESTED_BELOW_MPS = 60.0 / 3.6
CONGESTED_LIMIT_BELOW_MPS = 60.1 / 3.6
NO_ADVICE = jnp.inf


class Requests(eqx.Module):
    """What a vehicle that must change asks of itself and of its two neighbours in the target lane."""

    own_advice_mps2: Value  # acceleration for itself; inf where none
    leader_advice_mps2: Value  # acceleration for the leader in the target lane; inf where none
    follower_advice_mps2: Value  # acceleration for the follower there; inf where none
    asks_follower: Flag  # whether the follower is told that he is in the way


def requests(
    ego: Ego,
    side: Side,
    gaps: Blocked,
    following: Following,
    look_ahead_speed_mps: Value,
    is_right: Flag,
    interval_s: float,
    step_s: float,
) -> Requests:
    """Requests of vehicles that must change lane.

    Args:
        ego: each of these vehicles and its own lane.
        side: the lane that it must change to.
        gaps: who is in the way there.
        following: car-following models.
        look_ahead_speed_mps: LC2013's slowly decaying speed.
        is_right: whether that lane is the right one.
        interval_s: time until the next decision.
        step_s: length of a time step.
    """
    v = ego.speed_mps
    left_m = ego.need.remaining_m
    num_lanes = jnp.maximum(1, jnp.abs(ego.need.best_lane_offset)).astype(v.dtype)
    remaining_s = jnp.maximum(step_s, left_m / jnp.maximum(look_ahead_speed_mps, 1e-3) / num_lanes / URGENCY)
    planned, own_leader_advice, leader_advice, overtakes = _deal_with_leader(
        ego, side, gaps, following, remaining_s, is_right, step_s
    )
    follower_advice, asks, own_follower_advice = _deal_with_follower(
        ego, side, gaps, following, planned, remaining_s, is_right, interval_s, step_s
    )
    talks_to_follower = ~overtakes & side.follower_exists
    own_follower_advice = jnp.where(talks_to_follower, own_follower_advice, NO_ADVICE)
    return Requests(
        own_advice_mps2=jnp.minimum(own_leader_advice, own_follower_advice),
        leader_advice_mps2=leader_advice,
        follower_advice_mps2=jnp.where(talks_to_follower, follower_advice, NO_ADVICE),
        asks_follower=talks_to_follower & asks,
    )


def _deal_with_leader(
    ego: Ego, side: Side, gaps: Blocked, following: Following, remaining_s: Value, is_right: Flag, step_s: float
) -> tuple[Value, Value, Value, Flag]:
    """The planned speed, the own advice, the leader's advice, and whether the leader is to be overtaken."""
    v, leader_v = ego.speed_mps, side.leader_speed_mps
    decel = following.max_deceleration_mps2
    left_m = ego.need.remaining_m
    stopping = FollowingSituation(
        speed_mps=v,
        gap_m=left_m,
        leader_speed_mps=jnp.zeros_like(v),
        leader_acceleration_mps2=jnp.zeros_like(v),
        acceleration_mps2=ego.acceleration_mps2,
        desired_speed_mps=ego.max_speed_mps,
        uniform=jnp.full_like(v, 0.5),
    )
    stop_mps = jnp.maximum(0.0, v + step_s * following.own.stop_acceleration(stopping, left_m, step_s))
    planned = jnp.minimum(v, stop_mps)

    leader_next = leader_v - step_s * jnp.maximum(1.0, -side.leader_acceleration_mps2)
    next_gap_m = side.leader_gap_m + step_s * (leader_next - planned)
    follow = following.follow_speed_mps(v, next_gap_m, leader_next, ego, step_s)
    target = jnp.maximum(jnp.maximum(0.0, v - decel * step_s), follow)

    leaders = following.of(side.leader_class)
    behind_m = leaders.secure_gap_m(leader_v, v, decel, step_s)
    leader_length_m = following.length_m(side.leader_class)
    overtake_m = jnp.maximum(
        0.0, side.leader_gap_m + leader_length_m + leaders.field("jam_gap_m") + ego.length_m + behind_m
    )
    faster_mps = planned - leader_v
    overtake_s = jnp.where(faster_mps > 0.0, overtake_m / jnp.maximum(faster_mps, 1e-3), remaining_s + 1.0)
    # noOvertakeLCLeft: nobody passes on the right in free traffic, to change to the left
    is_banned = ~is_right & (v >= CONGESTED_BELOW_MPS) & (ego.speed_limit_mps >= CONGESTED_LIMIT_BELOW_MPS)
    room_m = left_m - brake_gap_m(v, decel, following.time_gap_s, step_s)
    cannot = (faster_mps < 0.0) | is_banned | (room_m < overtake_m) | (remaining_s < overtake_s)

    fall_behind = jnp.minimum(decel, jnp.maximum(MIN_FALL_BEHIND_MPS2, (v - target) / remaining_s))
    slower = jnp.minimum(planned, jnp.maximum(0.0, v - step_s * fall_behind))
    must_slow = target < v
    blocked_plan = jnp.where(must_slow, slower, planned)
    blocked_advice = jnp.where(must_slow, slower, target)

    overtakes = gaps.by_leader & ~cannot
    own_mps = jnp.where(gaps.by_leader, blocked_advice, target)
    own_advice = jnp.where(side.leader_exists & ~overtakes, (own_mps - v) / step_s, NO_ADVICE)
    plan = jnp.where(gaps.by_leader, blocked_plan, jnp.minimum(target, planned))
    plan = jnp.where(side.leader_exists, plan, planned)
    leader_advice = jnp.where(overtakes, 0.0, NO_ADVICE)  # the leader should not accelerate
    return plan, own_advice, leader_advice, overtakes & side.leader_exists


class _Follower(eqx.Module):
    """The follower in the target lane, asked what he would do behind the vehicle that must change."""

    ego: Ego  # that vehicle
    side: Side  # the lane
    models: CarFollowingMix  # car-following models of the followers
    planned_mps: Value  # speed that the vehicle plans
    max_deceleration_mps2: Value  # of the vehicle
    step_s: float = eqx.field(static=True)  # length of a time step

    def secure_m(self, own_mps: Value, leader_mps: Value) -> Value:
        """Gap that is secure between him and the vehicle."""
        return self.models.secure_gap_m(own_mps, leader_mps, self.max_deceleration_mps2, self.step_s)

    def follow_mps(self, gap_m: Value) -> Value:
        """Next speed behind the vehicle at its planned speed, at a gap beyond the jam gap."""
        side = self.side
        situation = FollowingSituation(
            speed_mps=side.follower_speed_mps,
            gap_m=gap_m + self.models.field("jam_gap_m"),
            leader_speed_mps=self.planned_mps,
            leader_acceleration_mps2=self.ego.acceleration_mps2,
            acceleration_mps2=side.follower_acceleration_mps2,
            desired_speed_mps=side.follower_max_speed_mps,
            uniform=jnp.full_like(self.ego.speed_mps, 0.5),
        )
        return self.models.follow_speed_mps(situation, self.step_s)

    def by_next_step(self, speed_mps: Value) -> Value:
        """Acceleration that brings him to a speed within a step."""
        return (speed_mps - self.side.follower_speed_mps) / self.step_s


class _Opening(eqx.Module):
    """What a follower who brakes does for the gap."""

    next_mps: Value  # his speed after a step of braking
    just_enough_mps: Value  # speed at which the gap opens no further than it needs to
    helps_now: Flag  # whether a second of braking opens it
    helps_eventually: Flag  # whether braking opens it in the time left


def _opening(follower: _Follower, help_decel: Value, remaining_s: Value) -> _Opening:
    other_v, gap_m, step_s = follower.side.follower_speed_mps, follower.side.follower_gap_m, follower.step_s
    planned = follower.planned_mps
    next_step = jnp.maximum(0.0, other_v - help_decel * step_s)
    in_one_second = jnp.maximum(0.0, other_v - help_decel)
    difference = planned - in_one_second
    gap_then_m = gap_m + difference
    needed_m = follower.secure_m(in_one_second, planned)
    first = jnp.maximum(next_step, follower.follow_mps(gap_m + step_s * planned))
    just_enough = jnp.maximum(next_step, follower.follow_mps(gap_m + step_s * (planned - first)))
    return _Opening(
        next_mps=next_step,
        just_enough_mps=just_enough,
        helps_now=(gap_then_m > 0.0) & (gap_then_m >= needed_m),
        helps_eventually=(difference > 0.0) & (difference * remaining_s > needed_m - gap_then_m + 0.1),
    )


def _deal_with_follower(
    ego: Ego,
    side: Side,
    gaps: Blocked,
    following: Following,
    planned_mps: Value,
    remaining_s: Value,
    is_right: Flag,
    interval_s: float,
    step_s: float,
) -> tuple[Value, Flag, Value]:
    """Acceleration asked of the follower, whether he is told to make room, own acceleration; inf where none.

    SUMO names speeds for the next step. Where such a speed is that of another vehicle rather than a step of braking,
    it is to be reached by the next decision only.
    """
    v, other_v, gap_m = ego.speed_mps, side.follower_speed_mps, side.follower_gap_m
    models = following.of(side.follower_class)
    decel, help_decel = following.max_deceleration_mps2, models.field("max_deceleration_mps2")
    planned = jnp.maximum(planned_mps, 0.0)
    follower = _Follower(ego, side, models, planned, decel, step_s)
    # fast enough to cut in without help?
    needs_no_help = (planned - other_v >= HELP_OVERTAKE_MPS) & (
        (follower.secure_m(other_v, planned) - gap_m) / remaining_s < planned - other_v
    )
    opening = _opening(follower, help_decel, remaining_s)
    # else let him pass, perhaps a little slower so that those behind him can help
    is_congested = (other_v < CONGESTED_BELOW_MPS) | (ego.speed_limit_mps < CONGESTED_LIMIT_BELOW_MPS)
    cannot_pass = is_right & ~is_congested
    pass_mps = jnp.maximum(other_v, v + HELP_OVERTAKE_MPS)
    slow_pass_mps = jnp.maximum(opening.next_mps, v + HELP_OVERTAKE_MPS)
    is_on_ramp = (planned_mps > CUT_IN_LEFT_SPEED_MPS) | (ego.lane_length_m > MAX_ON_RAMP_LENGTH_M)
    wants_slow = (other_v > v) & (is_right | is_on_ramp)
    passes_slowly = wants_slow & ((other_v - v) / help_decel < remaining_s)
    let_pass_mps = jnp.where(wants_slow, slow_pass_mps, pass_mps)

    def by_next_decision(speed_mps: Value) -> Value:
        return (speed_mps - other_v) / interval_s

    by_next_step = follower.by_next_step
    # a step of braking is asked for again at each step, down to the speed that is low enough: until the next decision
    brake_to_pass = jnp.maximum(-help_decel, by_next_decision(v + HELP_OVERTAKE_MPS))
    let_pass = jnp.where(wants_slow, brake_to_pass, by_next_decision(pass_mps))
    asked = jnp.where(
        needs_no_help,
        by_next_decision(planned - HELP_OVERTAKE_MPS),
        jnp.where(
            opening.helps_now,
            by_next_step(opening.just_enough_mps),
            jnp.where(
                opening.helps_eventually,
                by_next_step(opening.next_mps),
                jnp.where(cannot_pass, by_next_step(jnp.maximum(opening.next_mps, HELP_OVERTAKE_MPS)), let_pass),
            ),
        ),
    )
    falls_back = ~needs_no_help & ~opening.helps_now & ~opening.helps_eventually & ~cannot_pass & ~passes_slowly
    passing_m = jnp.maximum(
        0.0,
        gap_m
        + ego.length_m
        + following.jam_gap_m
        + following.length_m(side.follower_class)
        + following.own.secure_gap_m(planned, let_pass_mps, help_decel, step_s),
    )
    fall_back = jnp.maximum((let_pass_mps - passing_m / remaining_s - v) / interval_s, -decel)
    own = jnp.where(gaps.by_follower & falls_back, fall_back, NO_ADVICE)
    # not in the way now: see that it stays so
    first_free = follower.follow_mps(gap_m + step_s * planned)
    stay_free = follower.follow_mps(gap_m + step_s * (planned - first_free))
    asked = jnp.where(gaps.by_follower, asked, jnp.where(gaps.by_leader, by_next_step(stay_free), NO_ADVICE))
    return asked, gaps.by_follower, own
