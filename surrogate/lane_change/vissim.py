"""VISSIM's lane changing: safety distances that shrink for a change, and braking that grows towards the last chance.

Sources: PTV VISSIM 2024's help, "Applications and driving behavior parameters of lane changing" and "Editing the
driving behavior parameter Lane change behavior". VISSIM's equations are not published; the help says which quantity
each parameter acts on, and the equations below are this module's reading of it. With the gap s, the speeds v of the
one behind and vl of the one ahead, and CC0, CC1 of the one behind (jam gap and time gap of other car-following models):

    (1)  d = CC0 + CC1 min(v, vl)                          desired safety distance
    (2)  s >= max(MinClear, SafDistFactLnChg d)            ahead and behind, for every change
    (3)  max(v - vl, 0)^2 <= 2 b (s - that distance)       braking that the one behind has to accept
    (4)  b = AccDecel                                      free changes
         b = max(AccDecel, MaxDecel - x / DecelRedDist)    necessary ones, x before the last place to change; (Own) for
                                                           the driver behind his new leader, (Trail) for his follower
    (5)  t = max(s - d, 0) / (v0 - vl)                     for how long a lane can be driven at the desired speed v0
    (6)  faster lane: v0 - vl > 2 m/s and t < CollTm here, t longer there by the 3 s that a change takes
    (7)  slower lane (right): t > CollTm there
    (8)  for somebody who must come over: the leader beyond is no slower than v - CoopLnChgSpeedDiff
    (9)  a driver brakes for such a one no harder than CoopDecel

Deviations from VISSIM:
- (3) acts on free changes as well: the help names only safety distances there, and (1) knows no closing speed.
- (6) is one number for all; in VISSIM 2 m/s is the mean over drivers. CollTm serves (6) and (7), so that nobody goes
  back and forth; VISSIM names it for (7). A large CollTm is VISSIM's free lane selection.
- Of cooperative lane changes only the speed difference is judged; who asks, by the talk that all models share.
- Where a change becomes necessary, and what drivers ask of each other, are LC2013's rules (`strategy.py`,
  `cooperation.py`), hence the last two parameters; VISSIM has a distance per connector instead.
- The shorter safety distance holds for the decision only, not while the change lasts; nobody is removed after waiting.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from surrogate.lane_change.free_model import FreeModel, Outlook, free_wish
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following
from surrogate.lane_change.lc2013 import Lc2013, route_only
from surrogate.lane_change.motives import Wish
from surrogate.vehicle.lane_change_model import Reason, Side

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]
OVERTAKES_BEYOND_MPS = 2.0
DURATION_OF_A_CHANGE_S = 3.0
FOREVER_S = 1e4


class Vissim(FreeModel):
    """VISSIM's parameters of lane changing; decelerations are positive numbers."""

    # SafDistFactLnChg, share of the desired safety distance that suffices for a change
    safety_distance_factor: Float[Array, "..."]
    min_clearance_m: Float[Array, "..."]  # MinClear (MinHdwy), least gap
    max_deceleration_own_mps2: Float[Array, "..."]  # MaxDecelOwn, accepted at the last place to change
    max_deceleration_trailing_mps2: Float[Array, "..."]  # MaxDecelTrail, the same for the new follower
    accepted_deceleration_own_mps2: Float[Array, "..."]  # AccDecelOwn, accepted far from it
    accepted_deceleration_trailing_mps2: Float[Array, "..."]  # AccDecelTrail, the same for the new follower
    deceleration_reduction_distance_m: Float[Array, "..."]  # DecelRedDist, distance over which 1 m/s^2 less is accepted
    cooperative_deceleration_mps2: Float[Array, "..."]  # CoopDecel, hardest braking for somebody who must change
    # CoopLnChgSpeedDiff, speed that a driver gives up to make room
    cooperative_speed_difference_mps: Float[Array, "..."]
    collision_time_s: Float[Array, "..."]  # CollTm, time to a slower leader for which a lane is as good as free
    strategic: Float[Array, "..."]  # as in `Lc2013`
    look_ahead_left: Float[Array, "..."]  # as in `Lc2013`

    def route_parameters(self) -> Lc2013:
        """Return the parameters for the route as a record of LC2013."""
        return route_only(self.strategic, jnp.ones((), jnp.float32), self.look_ahead_left)

    def most_asked_mps2(self) -> Float[Array, "..."]:
        """Return CoopDecel, (9)."""
        return self.cooperative_deceleration_mps2

    def gaps(self, outlook: Outlook) -> tuple[Blocked, Blocked]:
        """Who is in the way on each side, (1) to (4)."""
        right, left = (
            self.blocked(outlook.ego, side, outlook.following, route.must_change)
            for side, route in zip(outlook.sides, outlook.routes, strict=True)
        )
        return right, left

    def blocked(self, ego: Ego, side: Side, following: Following, is_necessary: Flag) -> Blocked:
        """Who is in the way on one side, (1) to (4)."""
        behind = following.of(side.follower_class)
        before_m = jnp.maximum(ego.need.remaining_m, 0.0) / self.deceleration_reduction_distance_m

        def accepted_mps2(most: Float[Array, "..."], least: Float[Array, "..."]) -> Value:
            return jnp.where(is_necessary, jnp.maximum(least, most - before_m), least)

        own = accepted_mps2(self.max_deceleration_own_mps2, self.accepted_deceleration_own_mps2)
        trailing = accepted_mps2(self.max_deceleration_trailing_mps2, self.accepted_deceleration_trailing_mps2)
        front_m, back_m = side.leader_gap_m + following.jam_gap_m, side.follower_gap_m + behind.field("jam_gap_m")
        front_d = safety_distance_m(following.jam_gap_m, following.time_gap_s, ego.speed_mps, side.leader_speed_mps)
        back_d = safety_distance_m(
            behind.field("jam_gap_m"), behind.field("time_gap_s"), side.follower_speed_mps, ego.speed_mps
        )
        return Blocked(
            by_leader=side.leader_exists
            & ~self._is_enough(front_m, front_d, ego.speed_mps, side.leader_speed_mps, own),
            by_follower=side.follower_exists
            & ~self._is_enough(back_m, back_d, side.follower_speed_mps, ego.speed_mps, trailing),
        )

    def _is_enough(self, gap_m: Value, distance_m: Value, speed_mps: Value, ahead_mps: Value, accepted: Value) -> Flag:
        room_m = gap_m - jnp.maximum(self.min_clearance_m, self.safety_distance_factor * distance_m)
        closing_mps = jnp.maximum(speed_mps - ahead_mps, 0.0)
        return (room_m >= 0.0) & (closing_mps**2 <= 2.0 * accepted * room_m)

    def wishes(
        self, outlook: Outlook, gaps: tuple[Blocked, Blocked], is_asked_to_help: tuple[Flag, Flag]
    ) -> tuple[Wish, Wish]:
        """Return the wishes by (5) to (8) and by the route."""
        ego = outlook.ego
        top = ego.max_speed_mps
        own_s = self._free_time_s(outlook, ego.leader_exists, ego.leader_gap_m, ego.leader_speed_mps)
        is_held = ego.leader_exists & (top - ego.leader_speed_mps > OVERTAKES_BEYOND_MPS)
        is_held &= own_s < self.collision_time_s
        side_s, gains, helps = [], [], []
        for side, route, gap, asked in zip(outlook.sides, outlook.routes, gaps, is_asked_to_help, strict=True):
            time_s = self._free_time_s(outlook, side.leader_exists, side.leader_gap_m, side.leader_speed_mps)
            is_free = side.is_open & ~route.must_change & ~route.must_stay & ~gap.at_all
            lost_mps = jnp.where(side.leader_exists, ego.speed_mps - side.leader_speed_mps, 0.0)
            side_s.append(time_s)
            gains.append(is_free & is_held & (time_s > own_s + DURATION_OF_A_CHANGE_S))
            helps.append(is_free & asked & (lost_mps <= self.cooperative_speed_difference_mps))
        right_route, left_route = outlook.routes
        is_free = outlook.sides[0].is_open & ~right_route.must_change & ~right_route.must_stay & ~gaps[0].at_all
        keeps_right = is_free & (side_s[0] > self.collision_time_s)
        is_left_better = gains[1] & (side_s[1] > side_s[0])
        faster_right, faster_left = gains[0] & ~is_left_better, gains[1] & ~(gains[0] & ~is_left_better)
        keeps_right &= ~faster_left & ~helps[1]
        reason = jnp.where(faster_right, int(Reason.SPEED_GAIN), int(Reason.KEEP_RIGHT))
        reason = jnp.where(helps[0], int(Reason.COOPERATIVE), reason)
        return (
            free_wish(right_route, faster_right | keeps_right | helps[0], reason),
            free_wish(
                left_route,
                faster_left | helps[1],
                jnp.where(helps[1], int(Reason.COOPERATIVE), int(Reason.SPEED_GAIN)),
            ),
        )

    def _free_time_s(self, outlook: Outlook, leader_exists: Flag, gap_m: Value, leader_mps: Value) -> Value:
        """Return for how long the desired speed can be driven behind a leader, (5)."""
        following, ego = outlook.following, outlook.ego
        distance_m = safety_distance_m(following.jam_gap_m, following.time_gap_s, ego.speed_mps, leader_mps)
        room_m = jnp.maximum(jnp.where(leader_exists, gap_m, 0.0) + following.jam_gap_m - distance_m, 0.0)
        slower_mps = jnp.maximum(ego.max_speed_mps - leader_mps, 1e-3)
        is_slower = leader_exists & (leader_mps < ego.max_speed_mps)
        return jnp.where(is_slower, jnp.minimum(room_m / slower_mps, FOREVER_S), FOREVER_S)


def safety_distance_m(jam_gap_m: Value, time_gap_s: Value, speed_mps: Value, leader_speed_mps: Value) -> Value:
    """Return the desired safety distance, (1)."""
    return jam_gap_m + time_gap_s * jnp.minimum(speed_mps, leader_speed_mps)
