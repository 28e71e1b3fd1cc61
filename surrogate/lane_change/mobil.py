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
- Accelerations are those that the vehicles would carry out (`surrogate.kinematics`), not what the model wants:
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
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.car_following.base import FollowingSituation
from surrogate.lane_change.base import LaneChangeModel, Reason, Side
from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.gap_acceptance import Blocked, Ego, Following
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.motives import Wish
from surrogate.lane_change.strategy import Strategy
from surrogate.neighbours import shift_up
from surrogate.traffic_state import HEAD, VehicleArrays
from surrogate.vehicle_class import CarFollowingMix, VehicleClass, select_record
from surrogate.vehicle_limits import limited_acceleration

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]
CONGESTED_BELOW_MPS = 60.0 / 3.6  # v_crit


class Mobil(LaneChangeModel):
    """Parameters of MOBIL.

    Attributes:
        politeness: p, weight of what others gain or lose.
        safe_deceleration_mps2: b_safe, hardest braking that the new follower may be forced to; a positive number.
        changing_threshold_mps2: a_th, least gain for which a change is worth it.
        keep_right_bias_mps2: a_bias, in favour of the right lane.
        european_rule: 0 where lanes are alike, 1 where the left lane is for passing only.
        strategic: as in `Lc2013`.
        assertive: as in `Lc2013`.
        look_ahead_left: as in `Lc2013`.
    """

    politeness: Float[Array, "..."]
    safe_deceleration_mps2: Float[Array, "..."]
    changing_threshold_mps2: Float[Array, "..."]
    keep_right_bias_mps2: Float[Array, "..."]
    european_rule: Float[Array, "..."]
    strategic: Float[Array, "..."]
    assertive: Float[Array, "..."]
    look_ahead_left: Float[Array, "..."]


class OldFollower(eqx.Module):
    """Who follows each vehicle in its own lane.

    Attributes:
        exists: whether there is one.
        gap_m: its gap to the vehicle less its own jam gap; inf where there is none.
        speed_mps: its speed.
        acceleration_mps2: its last acceleration.
        max_speed_mps: speed that it wants.
        vehicle_class: its class.
    """

    exists: Flag
    gap_m: Value
    speed_mps: Value
    acceleration_mps2: Value
    max_speed_mps: Value
    vehicle_class: Int[Array, " vehicle"]


class Appraisal(eqx.Module):
    """What MOBIL makes of one side.

    Attributes:
        incentive_mps2: left side of (3), or of (5) or (6).
        excess_mps2: incentive less the threshold of that side.
        bias_mps2: what the bias for the right has added to the excess.
        is_safe: whether the new follower need not brake harder than is safe, (2).
    """

    incentive_mps2: Value
    excess_mps2: Value
    bias_mps2: Value
    is_safe: Flag

    @property
    def wants(self) -> Flag:
        """Whether the change is worth it and safe."""
        return self.is_safe & (self.excess_mps2 > 0.0)


def appraise(
    model: Mobil, ego: Ego, side: Side, old_follower: OldFollower, following: Following, is_right: bool, step_s: float
) -> Appraisal:
    """Return what changing to one side is worth, whether or not there is a lane.

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
    """Return how a driver (speed, acceleration, desired speed) accelerates behind a leader (speed, acceleration)."""
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


def old_follower_of(vehicles: VehicleArrays, following: Following, desired_mps: Value) -> OldFollower:
    """Return who follows each vehicle in its own row: the entry after it, for each row begins with a head."""
    vehicle_class = shift_up(vehicles.vehicle_class, HEAD)
    exists = vehicle_class >= 0
    rear_m = vehicles.position_m - following.length_m(vehicles.vehicle_class)
    jam_gap_m = following.of(vehicle_class).field("jam_gap_m")
    gap_m = rear_m - shift_up(vehicles.position_m, 0.0) - jam_gap_m
    return OldFollower(
        exists=exists,
        gap_m=jnp.where(exists, gap_m, jnp.inf),
        speed_mps=shift_up(vehicles.speed_mps, 0.0),
        acceleration_mps2=shift_up(vehicles.acceleration_mps2, 0.0),
        max_speed_mps=jnp.where(exists, shift_up(desired_mps, 0.0), jnp.inf),
        vehicle_class=vehicle_class,
    )


def mobil_wishes(
    wishes: tuple[Wish, Wish],
    ego: Ego,
    sides: tuple[Side, Side],
    routes: tuple[Strategy, Strategy],
    gaps: tuple[Blocked, Blocked],
    vehicle_class: Int[Array, " vehicle"],
    old_follower: OldFollower,
    following: Following,
    classes: tuple[VehicleClass, ...],
    step_s: float,
) -> tuple[Wish, Wish]:
    """Return the wishes of all vehicles, to the right and to the left, with MOBIL's for those of its classes.

    Args:
        wishes: LC2013's.
        ego: each vehicle and its own lane.
        sides: the lanes on the right and on the left.
        routes: what the route says of them.
        gaps: who is in the way there.
        vehicle_class: class of each vehicle.
        old_follower: who follows each in its own row.
        following: car-following models.
        classes: vehicle classes, one of which at least has MOBIL.
        step_s: length of a time step.
    """
    models = [c.lane_change for c in classes]
    members = [index for index, model in enumerate(models) if isinstance(model, Mobil)]
    by_class = [m if isinstance(m, Mobil) else models[members[0]] for m in models]
    model = select_record(by_class, vehicle_class)
    assert isinstance(model, Mobil)
    is_mobil = jnp.isin(vehicle_class, jnp.asarray(members))
    right, left = (
        appraise(model, ego, side, old_follower, following, is_right, step_s)
        for side, is_right in zip(sides, (True, False), strict=True)
    )
    is_free = [s.is_open & ~r.must_change & ~r.must_stay for s, r in zip(sides, routes, strict=True)]
    can_right, can_left = (
        a.wants & free & ~gap.at_all for a, free, gap in zip((right, left), is_free, gaps, strict=True)
    )
    prefers_left = can_left & (left.excess_mps2 > right.excess_mps2)
    chosen = can_right & ~prefers_left, can_left & ~(can_right & ~prefers_left)
    # a change that only the bias makes worth it is one to keep right
    is_for_right = right.excess_mps2 - right.bias_mps2 <= 0.0
    free_reasons = jnp.where(is_for_right, int(Reason.KEEP_RIGHT), int(Reason.SPEED_GAIN)), int(Reason.SPEED_GAIN)
    none = jnp.zeros_like(ego.speed_mps)

    def merged(lc2013: Wish, route: Strategy, wants: Flag, free_reason: Int[Array, " vehicle"] | int) -> Wish:
        own = Wish(
            change=route.must_change | wants,
            urgent=route.must_change,
            reason=jnp.where(route.must_change, int(Reason.STRATEGIC), free_reason),
            gain=none,
            keep_right=none,
            advice_mps2=jnp.full_like(none, NO_ADVICE),
            reverts=jnp.zeros_like(wants),
        )
        return jax.tree.map(lambda mine, other: jnp.where(is_mobil, mine, other), own, lc2013)

    to_right, to_left = (merged(*arguments) for arguments in zip(wishes, routes, chosen, free_reasons, strict=True))
    return to_right, to_left


def route_parameters(model: Mobil) -> Lc2013:
    """Return the parameters for route and gaps as a record of LC2013, whose motives then play no part."""
    neutral = jnp.ones((), jnp.float32)
    return Lc2013(
        strategic=model.strategic,
        cooperative=neutral,
        cooperative_speed=neutral,
        speed_gain=neutral,
        speed_gain_right=neutral,
        speed_gain_remain_time_s=neutral,
        keep_right=neutral,
        assertive=model.assertive,
        look_ahead_left=model.look_ahead_left,
    )
