"""MOBIL: a driver changes lane if that lets him and, by his politeness, others accelerate more, and harms nobody.

Source: A. Kesting, M. Treiber & D. Helbing (2007), "General lane-changing model MOBIL for car-following models",
Transportation Research Record 1999, 86-94. With accelerations a now and a~ after the change, of the driver c himself,
the new follower n and the old follower o:

    safety    (2)  a~_n >= -b_safe
    incentive (3)  a~_c - a_c + p (a~_n - a_n + a~_o - a_o) > a_th
    European  (4)  a_eur on the right lane is min(a of the right lane, a of the left lane) if v_c > v_lead > v_crit,
                   with the leader of the left lane: nobody passes on the right in free traffic
              (5)  left to right: a~_c,eur - a_c + p (a~_o - a_o) > a_th - a_bias
              (6)  right to left: a~_c - a_c,eur + p (a~_n - a_n) > a_th + a_bias

Deviations:
- The European rule is a number between 0 (equation 3) and 1 (equations 4 to 6), which blends the two, so that it is a
  parameter like the others. The bias a_bias acts in both; 0 makes equation (3) the published one.
- Accelerations are those that the vehicles would carry out (`surrogate.loop.kinematics`), not what the model wants:
  models that name a safe speed, such as Krauss, want any deceleration when they are too close.
- (4) acts on the choice of lane only, not on the acceleration in the right lane.
- MOBIL decides what a driver may wish. What his route demands, and whether the gaps ahead and behind are secure, is
  judged as for LC2013 (`strategy.py`, `gap_acceptance.py`), hence the last three parameters; so a wish has to meet (2)
  and the secure gaps, a change for the route only the secure gaps, and where the route forbids a change it is not made.
- If both sides are worth a change, the one that exceeds its threshold by more is taken; the paper does not say.
- Decisions fall at the interval of all lane-change decisions.
- A driver asked to make room adapts his speed in full, but does not change lane for it.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from surrogate.lane_change.free_model import FreeModel, Outlook, free_wish
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following
from surrogate.lane_change.lc2013 import Lc2013, route_only
from surrogate.lane_change.motives import Wish
from surrogate.lane_change.old_follower import OldFollower
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.lane_change_model import Reason, Side
from surrogate.vehicle.vehicle_class import CarFollowingMix
from surrogate.vehicle.vehicle_limits import limited_acceleration

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]
CONGESTED_BELOW_MPS = 60.0 / 3.6  # v_crit


class Mobil(FreeModel):
    """Parameters of MOBIL."""

    politeness: Float[Array, "..."]  # p, weight of what others gain or lose
    # b_safe, hardest braking that the new follower may be forced to; a positive number
    safe_deceleration_mps2: Float[Array, "..."]
    changing_threshold_mps2: Float[Array, "..."]  # a_th, least gain for which a change is worth it
    keep_right_bias_mps2: Float[Array, "..."]  # a_bias, in favour of the right lane
    european_rule: Float[Array, "..."]  # 0 where lanes are alike, 1 where the left lane is for passing only
    strategic: Float[Array, "..."]  # as in `Lc2013`
    assertive: Float[Array, "..."]  # as in `Lc2013`
    look_ahead_left: Float[Array, "..."]  # as in `Lc2013`

    def route_parameters(self) -> Lc2013:
        """Return the parameters for route and gaps as a record of LC2013."""
        return route_only(self.strategic, self.assertive, self.look_ahead_left)

    def wishes(
        self, outlook: Outlook, gaps: tuple[Blocked, Blocked], is_asked_to_help: tuple[Flag, Flag]
    ) -> tuple[Wish, Wish]:
        """Return the wishes by (2) to (6) and by the route; nobody changes lane to make room."""
        del is_asked_to_help
        (wants_right, wants_left), is_for_right = _wants_by_side(self, outlook, gaps)
        right_reason = jnp.where(is_for_right, int(Reason.KEEP_RIGHT), int(Reason.SPEED_GAIN))
        return (
            free_wish(outlook.routes[0], wants_right, right_reason),
            free_wish(outlook.routes[1], wants_left, int(Reason.SPEED_GAIN)),
        )


class Appraisal(eqx.Module):
    """What MOBIL makes of one side."""

    incentive_mps2: Value  # left side of (3), or of (5) or (6)
    excess_mps2: Value  # incentive less the threshold of that side
    bias_mps2: Value  # what the bias for the right has added to the excess
    is_safe: Flag  # whether the new follower need not brake harder than is safe, (2)

    @property
    def wants(self) -> Flag:
        """Whether the change is worth it and safe."""
        return self.is_safe & (self.excess_mps2 > 0.0)


def appraise(
    model: Mobil, ego: Ego, side: Side, old_follower: OldFollower, following: Following, is_right: bool, step_s: float
) -> Appraisal:
    """Appraisal of a change to one side, whether or not there is a lane.

    Args:
        model: parameters of each vehicle.
        ego: each vehicle and its own lane.
        side: the lane on this side.
        old_follower: who follows in the own lane.
        following: car-following models.
        is_right: which side this is.
        step_s: length of a time step.
    """
    new = following.of(side.follower_class)
    old = following.of(old_follower.vehicle_class)
    new_gap_m = side.follower_gap_m + new.field("jam_gap_m")
    old_gap_m = old_follower.gap_m + old.field("jam_gap_m")
    side_gap_m, own_gap_m = side.leader_gap_m + following.jam_gap_m, ego.leader_gap_m + following.jam_gap_m
    side_leader = side.leader_speed_mps, side.leader_acceleration_mps2
    own_leader = ego.leader_speed_mps, ego.leader_acceleration_mps2
    itself = ego.speed_mps, ego.acceleration_mps2
    ego_driver = ego.speed_mps, ego.acceleration_mps2, ego.max_speed_mps
    new_driver = side.follower_speed_mps, side.follower_acceleration_mps2, side.follower_max_speed_mps
    old_driver = old_follower.speed_mps, old_follower.acceleration_mps2, old_follower.max_speed_mps

    own_now = _acceleration(following.own, ego_driver, own_gap_m, own_leader, step_s)
    own_then = _acceleration(following.own, ego_driver, side_gap_m, side_leader, step_s)
    new_now = _acceleration(new, new_driver, new_gap_m + ego.length_m + side_gap_m, side_leader, step_s)
    new_then = _acceleration(new, new_driver, new_gap_m, itself, step_s)
    old_now = _acceleration(old, old_driver, old_gap_m, itself, step_s)
    old_then = _acceleration(old, old_driver, old_gap_m + ego.length_m + own_gap_m, own_leader, step_s)
    new_gain = jnp.where(side.follower_exists, new_then - new_now, 0.0)
    old_gain = jnp.where(old_follower.exists, old_then - old_now, 0.0)

    left_leader_mps, left_leader_exists = (
        (ego.leader_speed_mps, ego.leader_exists) if is_right else (side.leader_speed_mps, side.leader_exists)
    )
    must_not_pass = left_leader_exists & (ego.speed_mps > left_leader_mps) & (left_leader_mps > CONGESTED_BELOW_MPS)
    held = jnp.where(must_not_pass, model.european_rule, 0.0)
    lower = jnp.minimum(own_now, own_then)
    unseen = 1.0 - model.european_rule  # in the right lane nobody's wishes count
    if is_right:
        own_then = own_then + held * (lower - own_then)
        others_gain = unseen * new_gain + old_gain
    else:
        own_now = own_now + held * (lower - own_now)
        others_gain = new_gain + unseen * old_gain
    incentive = own_then - own_now + model.politeness * others_gain
    bias = jnp.broadcast_to(model.keep_right_bias_mps2 * (1.0 if is_right else -1.0), incentive.shape)
    return Appraisal(
        incentive_mps2=incentive,
        excess_mps2=incentive - model.changing_threshold_mps2 + bias,
        bias_mps2=bias,
        is_safe=~side.follower_exists | (new_then >= -model.safe_deceleration_mps2),
    )


def _acceleration(
    models: CarFollowingMix,
    driver: tuple[Value, Value, Value],
    gap_m: Value,
    leader: tuple[Value, Value],
    step_s: float,
) -> Value:
    """Acceleration of a driver (speed, acceleration, desired speed) behind a leader (speed, acceleration)."""
    speed_mps, acceleration_mps2, desired_mps = driver
    desired_mps = jnp.where(jnp.isfinite(desired_mps), desired_mps, speed_mps + 1.0)  # where there is no such driver
    wanted = models.acceleration(
        FollowingSituation(
            speed_mps=speed_mps,
            gap_m=gap_m,
            leader_speed_mps=leader[0],
            leader_acceleration_mps2=leader[1],
            acceleration_mps2=acceleration_mps2,
            desired_speed_mps=desired_mps,
            uniform=jnp.full_like(speed_mps, 0.5),
        ),
        step_s,
    )
    return limited_acceleration(
        wanted,
        speed_mps,
        desired_mps,
        models.field("max_acceleration_mps2"),
        models.field("max_deceleration_mps2"),
        models.field("emergency_deceleration_mps2"),
        step_s,
    )


def _wants_by_side(model: Mobil, outlook: Outlook, gaps: tuple[Blocked, Blocked]) -> tuple[tuple[Flag, Flag], Flag]:
    """Whether each side is worth a change, and whether that to the right is for the right alone."""
    old_follower = outlook.old_follower
    right, left = (
        appraise(model, outlook.ego, side, old_follower, outlook.following, is_right, outlook.step_s)
        for side, is_right in zip(outlook.sides, (True, False), strict=True)
    )
    is_free = [s.is_open & ~r.must_change & ~r.must_stay for s, r in zip(outlook.sides, outlook.routes, strict=True)]
    can_right, can_left = (
        a.wants & free & ~gap.at_all for a, free, gap in zip((right, left), is_free, gaps, strict=True)
    )
    prefers_left = can_left & (left.excess_mps2 > right.excess_mps2)
    chosen = can_right & ~prefers_left, can_left & ~(can_right & ~prefers_left)
    # a change that only the bias makes worth it is one to keep right
    return chosen, right.excess_mps2 - right.bias_mps2 <= 0.0
