"""LC2013's free motives: make room for somebody, gain speed, keep right; and the wish that follows for one side."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.car_following.safe_speed import brake_gap_m, safe_follow_speed_mps
from surrogate.lane_change.cooperation import CONGESTED_BELOW_MPS, CONGESTED_LIMIT_BELOW_MPS, HELP_OVERTAKE_MPS
from surrogate.lane_change.gap_acceptance import Ego, Following
from surrogate.lane_change.lc2013 import Lc2013, Memory
from surrogate.lane_change.strategy import Strategy, is_shorter
from surrogate.vehicle.lane_change_model import Reason, Side
from surrogate.xla.materialise import materialise

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]

RELATIVE_GAIN_MIN_SPEED_MPS = 10.0
KEEP_RIGHT_TIME_S = 5.0
KEEP_RIGHT_ACCEPTANCE_S = 7.0
MUCH_FASTER_MPS = 5.0 / 3.6
SMALLEST_SPEED_MPS = 0.1
SMALLEST_GAIN = 0.001
CHANGE_THRESHOLD = 0.2


class Wish(eqx.Module):
    """What LC2013 makes of one side."""

    change: Flag  # whether the vehicle wants to change
    urgent: Flag  # whether it must, for its route or for somebody else's
    reason: Int[Array, " vehicle"]  # `Reason` of the wish
    gain: Value  # updated memory of the gain on this side
    keep_right: Value  # updated memory
    advice_mps2: Value  # acceleration that the vehicle advises itself; inf where none
    reverts: Flag  # whether it would go back in the next step, long before the next decision


def wish(
    model: Lc2013,
    ego: Ego,
    side: Side,
    route: Strategy,
    memory: Memory,
    following: Following,
    is_asked_to_help: Flag,
    is_right: bool,
    interval_s: float,
    step_s: float,
) -> Wish:
    """What each vehicle wants on one side, whether or not the gap allows it.

    Args:
        model: parameters of each vehicle.
        ego: each vehicle and its own lane.
        side: the lane on this side.
        route: what the route says of this side.
        memory: LC2013's memories.
        following: car-following models.
        is_asked_to_help: whether a vehicle that must change in this direction has asked this one to make room.
        is_right: which side this is.
        interval_s: time since the last decision.
        step_s: length of a time step.

    Source: `MSLCM_LC2013::_wantsChange`.
    """
    v = ego.speed_mps
    threshold_left = CHANGE_THRESHOLD / model.speed_gain
    threshold_right = threshold_left / model.speed_gain_right
    is_congested = (v < CONGESTED_BELOW_MPS) | (ego.speed_limit_mps < CONGESTED_LIMIT_BELOW_MPS)
    held = _Held(
        advice_mps2=jnp.full_like(v, jnp.inf),
        cap_mps=ego.max_speed_mps,
        gain=memory.gain_right if is_right else memory.gain_left,
        is_nudged=jnp.zeros_like(is_congested),
    )
    if not is_right:
        held = _behind_slower_leader(
            held, ego, side, route, following, threshold_left, is_congested, interval_s, step_s
        )
    side_mps, this_mps = _lane_speeds_mps(ego, side, following, step_s)
    # from a lane that does not serve the route, SUMO goes back as soon as that one is no slower
    reverts = (side.need.best_lane_offset * (-1 if is_right else 1) < 0) & (this_mps > side_mps)
    this_mps = jnp.minimum(this_mps, held.cap_mps)

    # cooperative
    against = memory.gain_left / threshold_left if is_right else memory.gain_right / threshold_right
    inconvenience = jnp.minimum(1.0, jnp.maximum(this_mps / jnp.maximum(side_mps, SMALLEST_SPEED_MPS) - 1.0, against))
    has_room = ~is_shorter(side.need.from_edge_m, jnp.abs(route.num_lanes_back) + 1, route.look_ahead_m)
    is_cooperative = is_asked_to_help & (inconvenience <= model.cooperative) & (route.to_best | has_room)

    # keep right and speed gain
    relative_gain = (side_mps - this_mps) / jnp.maximum(side_mps, RELATIVE_GAIN_MIN_SPEED_MPS)
    lasts = side.need.from_edge_m / jnp.maximum(SMALLEST_SPEED_MPS, v) > model.speed_gain_remain_time_s
    gain, keep_right = held.gain, memory.keep_right
    if is_right:
        much_faster_here = this_mps - MUCH_FASTER_MPS > side_mps
        gain = jnp.where(much_faster_here, gain * 0.5**interval_s, gain + interval_s * relative_gain)
        keep_right_rate = _keep_right_rate(ego, side, following, threshold_right, is_congested, step_s)
        keep_right = jnp.where(much_faster_here, keep_right, keep_right - interval_s * keep_right_rate)
        is_keep_right = ~much_faster_here & (keep_right * model.keep_right < -threshold_right)
        is_speed_gain = (gain > threshold_right) & lasts
    else:
        decay = jnp.where(this_mps > side_mps, 0.5**interval_s, 0.8**interval_s)
        decayed = jnp.where(gain > 0.0, gain * decay, gain)
        gain = jnp.where(this_mps >= side_mps, decayed, gain + interval_s * relative_gain)
        is_keep_right = jnp.zeros_like(is_congested)
        is_speed_gain = (gain > threshold_left) & ((relative_gain > SMALLEST_GAIN) | held.is_nudged) & lasts
    is_cooperative, gain, keep_right, is_keep_right, is_speed_gain, relative_gain = materialise(
        (is_cooperative, gain, keep_right, is_keep_right, is_speed_gain, relative_gain)
    )
    favours = gain > 0.0
    is_convenient = route.serves_route & (relative_gain >= 0.0) & favours

    is_free = side.is_open & ~route.must_change & ~route.must_stay
    weighs = is_free & ~is_cooperative  # only then does LC2013 get as far as its memories
    change = route.must_change | (is_free & (is_cooperative | is_keep_right | is_speed_gain | is_convenient))
    reason = jnp.where(is_speed_gain, int(Reason.SPEED_GAIN), int(Reason.STRATEGIC))
    reason = jnp.where(is_keep_right, int(Reason.KEEP_RIGHT), reason)
    reason = jnp.where(is_cooperative, int(Reason.COOPERATIVE), reason)
    reason = jnp.where(route.must_change, int(Reason.STRATEGIC), reason)
    return Wish(
        change=change,
        urgent=route.must_change | (is_free & is_cooperative),
        reason=reason,
        gain=jnp.where(weighs, gain, held.gain),
        keep_right=jnp.where(weighs, keep_right, memory.keep_right),
        advice_mps2=held.advice_mps2,
        reverts=change & ~route.must_change & reverts,
    )


def _lane_speeds_mps(ego: Ego, side: Side, following: Following, step_s: float) -> tuple[Value, Value]:
    """Speeds that the lane on the side and the own lane will allow."""
    is_accelerating = (side.leader_exists & (side.leader_acceleration_mps2 > 0.0)) | (
        ego.leader_exists & (ego.leader_acceleration_mps2 > 0.0)
    )
    side_mps, own_mps = (
        anticipated_speed_mps(
            ego, following, lane.leader_exists, lane.leader_gap_m, lane.leader_speed_mps, lane.leader_class,
            lane.need.from_edge_m, is_accelerating, step_s,
        )
        for lane in (side, ego)
    )  # fmt: skip
    return materialise((side_mps, own_mps))


class _Held(eqx.Module):
    """What a slower leader on the left makes of a driver."""

    advice_mps2: Value  # acceleration that stays behind him; inf where none is asked
    cap_mps: Value  # highest speed in the own lane
    gain: Value  # memory of the gain on the left
    is_nudged: Flag  # whether he makes the driver wish to go left


def _behind_slower_leader(
    held: _Held,
    ego: Ego,
    side: Side,
    route: Strategy,
    following: Following,
    threshold_left: Value,
    is_congested: Flag,
    interval_s: float,
    step_s: float,
) -> _Held:
    """The same with who must not pass on the right.

    Source: VARIANT_20 (noOvertakeRight) of `MSLCM_LC2013::_wantsChange`.
    """
    slower = materialise(
        _slower_leader_on_the_left(ego, side, following, held.gain, threshold_left, interval_s, step_s)
    )
    applies = side.is_open & ~route.must_change & ~is_congested & slower.applies
    is_slow_road = ego.speed_limit_mps < CONGESTED_LIMIT_BELOW_MPS
    advises = side.is_open & ~route.must_change & ~is_slow_road & slower.advises
    return _Held(
        advice_mps2=jnp.where(advises, slower.advice_mps2, held.advice_mps2),
        cap_mps=jnp.where(applies, jnp.minimum(held.cap_mps, slower.safe_speed_mps), held.cap_mps),
        is_nudged=applies & (slower.share > 0.0),
        gain=jnp.where(applies, held.gain + interval_s * slower.share * slower.relative_gain, held.gain),
    )


def anticipated_speed_mps(
    ego: Ego,
    following: Following,
    leader_exists: Flag,
    gap_m: Value,
    leader_speed_mps: Value,
    leader_class: Int[Array, " vehicle"],
    lane_length_m: Value,
    is_accelerating: Flag,
    step_s: float,
) -> Value:
    """Speed that a lane will allow in the near future.

    Source: `MSLCM_LC2013::anticipateFollowSpeed`: behind an accelerating leader the model's own speed one second
    ahead, else the speed that is safe now. Without a leader the end of the lane takes its place.
    """
    gap = jnp.where(leader_exists, gap_m, lane_length_m)
    leader_mps = jnp.where(leader_exists, leader_speed_mps, 0.0)
    in_one_second_mps = ego.speed_mps + following.max_acceleration_mps2 * (1.0 - step_s)
    by_model = following.follow_speed_mps(in_one_second_mps, gap, leader_mps, ego, step_s)
    deceleration = following.max_deceleration_mps2
    leader_deceleration = following.of(leader_class).field("max_deceleration_mps2")
    safe = safe_follow_speed_mps(gap, leader_mps, deceleration, leader_deceleration, following.time_gap_s, step_s)
    return jnp.minimum(ego.max_speed_mps, jnp.where(is_accelerating, by_model, safe))


class _SlowerLeader(eqx.Module):
    """A slower leader on the left, whom one should not overtake on the right."""

    applies: Flag  # whether there is one
    advises: Flag  # whether there is one, or will be one before the next decision
    safe_speed_mps: Value  # speed that stays behind him
    advice_mps2: Value  # acceleration until the next decision that stays behind him
    share: Value  # share of the time for which he makes the driver wish to go left, because braking is near
    relative_gain: Value  # gain that the driver then counts, per second


def _slower_leader_on_the_left(
    ego: Ego, side: Side, following: Following, gain: Value, threshold: Value, interval_s: float, step_s: float
) -> _SlowerLeader:
    """How a vehicle avoids passing a slower leader on the left lane on his right.

    SUMO counts the gain when the model wants to go slower with the gap of 8 s later than with the present one. Its W99
    draws a random number in each of the two when the road is free, so the answer is yes in half of the steps; here
    half of the gain counts in every step.
    """
    v = ego.speed_mps
    difference = jnp.maximum(ego.max_speed_mps - side.leader_max_speed_mps, v - side.leader_speed_mps)
    hardest = v - following.max_deceleration_mps2 * step_s
    follow = following.follow_speed_mps(v, side.leader_gap_m, side.leader_speed_mps, ego, step_s)
    is_below_threshold = gain < threshold
    safe = jnp.where(follow >= hardest, follow, jnp.maximum(hardest, side.leader_speed_mps - HELP_OVERTAKE_MPS))
    safe = jnp.where(is_below_threshold, jnp.maximum(safe, side.leader_speed_mps), safe)
    future_gap_m = side.leader_gap_m - 8.0 * difference
    future = following.follow_speed_mps(v, future_gap_m, side.leader_speed_mps, ego, step_s)
    is_free = (future == follow) & (follow > v)
    share = jnp.where(future < safe, 1.0, is_free * 0.5)
    relative_gain = difference / jnp.maximum(ego.max_speed_mps, RELATIVE_GAIN_MIN_SPEED_MPS)

    # SUMO names a speed for each step anew; here one acceleration lasts until the next decision. Braking relaxes as
    # the speed falls; the rule ends where traffic counts as congested or, if the leader would go as fast as oneself, at
    # his speed, and comes back above: in between decisions, the speed is to stay at that level.
    wait_s = interval_s - step_s
    now = jnp.maximum((follow - v) / step_s, -following.max_deceleration_mps2)
    braking = jnp.minimum(now, 0.0)
    half_way_mps = v + 0.5 * wait_s * braking
    then_mps = following.follow_speed_mps(half_way_mps, side.leader_gap_m, side.leader_speed_mps, ego, step_s)
    relief = jnp.maximum((then_mps - half_way_mps) / step_s - now, 0.0) / jnp.maximum(-braking, 0.1)
    now = jnp.where(now < 0.0, now / (1.0 + relief), now)  # mean of a braking that relaxes exponentially
    fall_behind = (side.leader_speed_mps - HELP_OVERTAKE_MPS - v) / interval_s
    advice = jnp.where(follow >= hardest, now, jnp.maximum(now, fall_behind))
    advice = jnp.where(is_below_threshold, jnp.maximum(advice, (side.leader_speed_mps - v) / interval_s), advice)
    is_lasting = ego.max_speed_mps > side.leader_max_speed_mps
    level_mps = jnp.maximum(CONGESTED_BELOW_MPS, jnp.where(is_lasting, 0.0, side.leader_speed_mps))
    advice = jnp.maximum(advice, (level_mps + jnp.minimum(advice, 0.0) * step_s - v) / interval_s)
    ahead_mps = v + following.max_acceleration_mps2 * wait_s
    return _SlowerLeader(
        applies=side.leader_exists & (difference > 0.0),
        advises=side.leader_exists & (ahead_mps > level_mps),
        safe_speed_mps=safe,
        advice_mps2=advice,
        share=share,
        relative_gain=relative_gain,
    )


def _keep_right_rate(
    ego: Ego, side: Side, following: Following, threshold_right: Value, is_congested: Flag, step_s: float
) -> Value:
    """Growth of the obligation to keep right, per second.

    The obligation grows with the share of an acceptance time for which the right lane can be driven at full speed.
    """
    v, top = ego.speed_mps, ego.max_speed_mps
    road_speed_factor = top / ego.speed_limit_mps
    acceptance_s = KEEP_RIGHT_ACCEPTANCE_S * road_speed_factor * jnp.maximum(1.0, v)
    deceleration = following.max_deceleration_mps2
    gap_m = jnp.maximum(0.0, side.need.from_edge_m - brake_gap_m(top, deceleration, following.time_gap_s, step_s))
    seconds = jnp.minimum(acceptance_s, gap_m / top)
    leader_deceleration = following.of(side.leader_class).field("max_deceleration_mps2")
    secure_m = following.own.secure_gap_m(top, side.leader_speed_mps, leader_deceleration, step_s)
    limited_m = jnp.maximum(0.0, jnp.minimum(gap_m, side.leader_gap_m - secure_m))
    is_limited = side.leader_exists & (side.leader_speed_mps < top)
    closing_mps = jnp.where(is_limited, top - side.leader_speed_mps, 1.0)
    seconds = jnp.where(is_limited, jnp.minimum(seconds, limited_m / jnp.maximum(closing_mps, 1e-3)), seconds)
    gap_m = jnp.where(is_limited, limited_m, gap_m)

    cannot_pass = ego.leader_exists & ~is_congested & (ego.leader_max_speed_mps < top)
    own_closing_mps = top - ego.leader_speed_mps
    behind_s = jnp.minimum(gap_m, ego.leader_gap_m) / jnp.where(own_closing_mps > 1e-3, own_closing_mps, 1e-3)
    seconds = jnp.where(cannot_pass, jnp.minimum(seconds, behind_s), seconds)
    return threshold_right * (seconds / acceptance_s) / KEEP_RIGHT_TIME_S
