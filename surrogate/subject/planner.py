"""A behavioural and motion planner for the subject vehicle, which claims its way instead of waiting for it.

In receding horizon it rolls out every pair of manoeuvre and acceleration, its neighbours with them, and begins the
cheapest. The follower in the lane changed to is expected to yield, up to a deceleration that may be asked of it: that
is how it claims a gap in which no gap acceptance rule would put it.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from surrogate.subject import rollout
from surrogate.subject.view import LEFT_LANE, OWN_LANE, RIGHT_LANE, SubjectView
from surrogate.vehicle.lane_change_model import LEFT, RIGHT, STAY

# A manoeuvre is a lane and the time at which it is entered. Who cannot change yet may make the gap that he needs.
MANOEUVRES = (
    (OWN_LANE, 0.0),
    (RIGHT_LANE, 0.0), (RIGHT_LANE, 1.0), (RIGHT_LANE, 2.0), (RIGHT_LANE, 3.0),
    (LEFT_LANE, 0.0), (LEFT_LANE, 1.0), (LEFT_LANE, 2.0), (LEFT_LANE, 3.0),
)  # fmt: skip
ACCELERATIONS_MPS2 = (-4.0, -3.0, -2.2, -1.5, -1.0, -0.6, -0.3, -0.1, 0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0)
DIRECTION = (RIGHT, STAY, LEFT)
ROUTE_TIME_S = 15.0  # a lane change that the route needs begins to matter so long before the last chance
FORBIDDEN = 1e4  # cost of a collision, so that even the least bad of bad plans is found
URGENCY_COST = 20.0  # cost of one lane change still to be made at the last chance, in the unit of efficiency


class Planner(eqx.Module):
    """The planner's parameters; every number is a leaf.

    Source: the role of the three weights follows Table 4 of the paper, which takes the planner from Zhang et al.
    (2023), TR-C 156, 104363.
    Deviation: neither text nor code of that planner was at hand; the costs below are our own, see
    docs/subject-vehicle.md.
    """

    safety_weight: Float[Array, ""]  # weight of the risk of short gaps, dimensionless
    efficiency_weight: Float[Array, ""]  # weight of the speed lost against the desired one, and of the route
    comfort_weight: Float[Array, ""]  # weight of acceleration, its changes, and changes of lane
    jam_gap_m: Float[Array, ""]  # gap that it keeps at standstill, and expects others to keep
    time_gap_s: Float[Array, ""]  # time gap at which its risk is 1, and that it expects of others
    max_acceleration_mps2: Float[Array, ""]  # highest acceleration that it plans
    comfortable_deceleration_mps2: Float[Array, ""]  # deceleration that enters the desired gap
    yield_deceleration_mps2: Float[Array, ""]  # how hard it expects a follower to yield to it at most
    claim_time_gap_s: Float[Array, ""]  # least time gap, to the leader and to the follower, with which it enters a lane
    reaction_s: Float[Array, ""]  # time that it leaves itself between two looks at its leader
    ahead_m: Float[Array, ""]  # how far ahead it sees, front bumper to front bumper
    behind_m: Float[Array, ""]  # how far behind
    horizon_s: float = eqx.field(static=True, default=5.0)  # how far it plans
    prediction_step_s: float = eqx.field(static=True, default=0.5)


class Plan(eqx.Module):
    """What the planner wants until it plans again."""

    direction: Int[Array, ""]  # RIGHT, STAY or LEFT: the lane change to make now
    target_row: Int[Array, ""]  # row changed to, where `direction` is not STAY
    entry_ahead: Int[Array, ""]  # entry of the leader in that row
    acceleration_mps2: Float[Array, ""]  # acceleration to keep, as far as safety allows
    # cost of each pair of manoeuvre and acceleration; FORBIDDEN and more where somebody would be hit
    cost: Float[Array, "manoeuvre acceleration"]


def plan(planner: Planner, view: SubjectView, interval_s: float) -> Plan:
    """Return the first step of the cheapest plan.

    Args:
        planner: parameters.
        view: the subject vehicle and its surroundings.
        interval_s: time until the next plan.
    """
    wanted = jnp.minimum(jnp.asarray(ACCELERATIONS_MPS2, jnp.float32), planner.max_acceleration_mps2)
    # what would stop the vehicle before the next plan stops it with that plan
    acceleration = jnp.maximum(wanted, -view.speed_mps / interval_s)
    cost = plan_costs(planner, view, acceleration)
    best = jnp.argmin(cost.reshape(-1))
    manoeuvre, choice = best // acceleration.shape[0], best % acceleration.shape[0]
    lane = jnp.asarray([lane for lane, _ in MANOEUVRES])[manoeuvre]
    begins_now = jnp.asarray([delay_s == 0.0 for _, delay_s in MANOEUVRES])[manoeuvre]
    return Plan(
        direction=jnp.where(begins_now, jnp.asarray(DIRECTION, jnp.int32)[lane], STAY),
        target_row=view.lanes.row[lane],
        entry_ahead=view.lanes.entry_ahead[lane],
        acceleration_mps2=acceleration[choice],
        cost=cost,
    )


def plan_costs(
    planner: Planner, view: SubjectView, acceleration_mps2: Float[Array, " acceleration"]
) -> Float[Array, "manoeuvre acceleration"]:
    """Cost of every pair of manoeuvre and acceleration.

    J = safety_weight * mean risk + efficiency_weight * (mean speed lost [m/s] + route) + comfort_weight * comfort

    Mean risk is the mean over the horizon of (desired gap / gap)^2 to whatever is ahead, with that of the follower
    after a change; comfort is a^2 + (a - a_before)^2 / 2 in (m/s^2)^2, and 1 for a change of lane.
    """
    num_steps = round(planner.horizon_s / planner.prediction_step_s)
    times_s = planner.prediction_step_s * np.arange(1, num_steps + 1, dtype=np.float32)
    lane = np.asarray([lane for lane, _ in MANOEUVRES])
    delay_s = np.asarray([delay_s for _, delay_s in MANOEUVRES], np.float32)
    changes = (lane != OWN_LANE)[:, None, None]
    has_changed = changes & (times_s >= delay_s[:, None])[:, None, :]  # manoeuvre, 1, time
    lanes = view.lanes

    desired = jnp.where(changes[..., 0], lanes.desired_speed_mps[lane][:, None], lanes.desired_speed_mps[OWN_LANE])
    a = acceleration_mps2[None, :]
    speed = jnp.broadcast_to(view.speed_mps, (len(lane), a.shape[1]))
    x, v = rollout.with_constant_acceleration(speed, jnp.broadcast_to(a, speed.shape), desired, jnp.asarray(times_s))

    leader_gap = jnp.minimum(lanes.leader_gap_m, rollout.FARTHEST_M)
    leader_x, leader_v = rollout.of_leader(lanes.leader_speed_mps, lanes.leader_acceleration_mps2, jnp.asarray(times_s))
    leader_rear = leader_gap[:, None] + leader_x  # lane, time
    stop = jnp.minimum(lanes.stop_m, rollout.FARTHEST_M)
    leader = leader_rear, leader_v
    own_gap, own_risk = _ahead_of(OWN_LANE, planner, leader, stop, (x, v))
    new_gap, new_risk = _ahead_of(lane, planner, leader, stop, (x, v))
    gap = jnp.where(has_changed, new_gap, own_gap)
    ahead_risk = jnp.where(has_changed, new_risk, own_risk)
    behind_gap, behind_v = _behind(planner, view, lane, leader, (x, v), has_changed)
    braking = jnp.sqrt(planner.max_acceleration_mps2 * planner.comfortable_deceleration_mps2)
    behind_wanted = rollout.desired_gap_m(behind_v, v, planner.jam_gap_m, planner.time_gap_s, braking)
    has_follower = (lanes.follower_gap_m < jnp.inf)[lane][:, None, None] & has_changed
    behind_risk = jnp.where(has_follower, rollout.risk(behind_gap, behind_wanted), 0.0)

    # the gap at the moment of the change, and nobody is hit later
    room_ahead, room_behind = _room_at_change(planner, view, lane, delay_s, (new_gap, v), (behind_gap, behind_v))
    is_hit = jnp.any(gap <= 0.0, axis=-1) | jnp.any(has_follower & (behind_gap <= 0.0), axis=-1)
    is_narrow = changes[..., 0] & ((room_ahead < 0.0) | (room_behind < 0.0))
    no_lane = changes[..., 0] & ~lanes.is_open[lane][:, None]

    lost = jnp.mean(jnp.abs(desired[..., None] - v), axis=-1)
    sight_m = jnp.maximum(view.speed_mps, 5.0) * ROUTE_TIME_S
    changes_left = lanes.num_changes[lane]
    nearness = jnp.exp(-jnp.maximum(stop[lane], 0.0) / (sight_m * jnp.maximum(changes_left, 1.0)))
    lost = lost + (URGENCY_COST * changes_left * nearness)[:, None]
    comfort = a**2 + 0.5 * (a - view.acceleration_mps2) ** 2 + changes[..., 0]
    cost = (
        planner.safety_weight * jnp.mean(ahead_risk + behind_risk, axis=-1)
        + planner.efficiency_weight * lost
        + planner.comfort_weight * comfort
    )
    # who would be hit in any case still brakes as hard as he can: the later and the slower, the better
    severity = jnp.mean(jnp.where(gap <= 0.0, 1.0 + v, 0.0), axis=-1)
    cost = jnp.where(is_hit, FORBIDDEN * (1.0 + severity), cost)
    return jnp.where(is_narrow | no_lane, 100.0 * FORBIDDEN, cost)


def _ahead_of(
    lane: np.ndarray | int, planner: Planner, leader: tuple[Array, Array], stop_m: Array, subject: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Least gap and largest risk to leader and end of a lane.

    Args:
        lane: one for each manoeuvre, or the same for all.
        planner: the planner.
        leader: rear and speed of the leader in each lane, time last.
        stop_m: distance to the end of each lane.
        subject: distances and speeds of the subject vehicle, time last.
    """
    (leader_rear, leader_v), (x, v) = leader, subject
    gap = jnp.atleast_2d(leader_rear[lane])[:, None, :] - x
    to_stop = jnp.atleast_1d(stop_m[lane])[:, None, None] - x
    braking = jnp.sqrt(planner.max_acceleration_mps2 * planner.comfortable_deceleration_mps2)
    mps = jnp.atleast_2d(leader_v[lane])[:, None, :]
    wanted = rollout.desired_gap_m(v, mps, planner.jam_gap_m, planner.time_gap_s, braking)
    to_stand = rollout.desired_gap_m(v, jnp.zeros_like(v), planner.jam_gap_m, 0.0 * planner.time_gap_s, braking)
    danger = jnp.maximum(rollout.risk(gap, wanted), rollout.risk(to_stop, to_stand))
    return jnp.minimum(gap, to_stop), danger


def _behind(
    planner: Planner,
    view: SubjectView,
    lane: np.ndarray,
    leader: tuple[Array, Array],
    subject: tuple[Array, Array],
    has_changed: np.ndarray,
) -> tuple[Array, Array]:
    """Gap to the follower in the lane of each manoeuvre and his speed, time last; for the others see `_ahead_of`."""
    (leader_rear, leader_v), lanes = leader, view.lanes
    return rollout.of_follower(
        gap_m=jnp.minimum(lanes.follower_gap_m, rollout.FARTHEST_M)[lane][:, None],
        speed_mps=lanes.follower_speed_mps[lane][:, None],
        desired_mps=jnp.maximum(lanes.desired_speed_mps, lanes.follower_speed_mps)[lane][:, None],
        own_leader=(
            (lanes.follower_gap_m + view.length_m)[lane][:, None, None].clip(max=rollout.FARTHEST_M)
            + leader_rear[lane][:, None, :],
            leader_v[lane][:, None, :],
        ),
        subject=subject,
        is_before_it=has_changed,
        driver=(
            planner.jam_gap_m,
            planner.time_gap_s,
            planner.max_acceleration_mps2,
            planner.comfortable_deceleration_mps2,
        ),
        yield_mps2=planner.yield_deceleration_mps2,
        step_s=planner.prediction_step_s,
    )


def _room_at_change(
    planner: Planner,
    view: SubjectView,
    lane: np.ndarray,
    delay_s: np.ndarray,
    ahead: tuple[Array, Array],
    behind: tuple[Array, Array],
) -> tuple[Float[Array, "manoeuvre acceleration"], Float[Array, "manoeuvre acceleration"]]:
    """By how much the gaps ahead and behind exceed what the planner claims, when it enters the lane."""
    (gap_ahead, v), (gap_behind, behind_v) = ahead, behind
    step = np.maximum(np.rint(delay_s / planner.prediction_step_s).astype(int) - 1, 0)
    number = np.arange(len(lane))
    is_now = (delay_s == 0.0)[:, None]
    own_v = jnp.where(is_now, view.speed_mps, v[number, :, step])
    lanes = view.lanes
    ahead_m = jnp.where(is_now, lanes.leader_gap_m[lane][:, None], gap_ahead[number, :, step])
    behind_m = jnp.where(is_now, lanes.follower_gap_m[lane][:, None], gap_behind[number, :, step])
    follower_v = jnp.where(is_now, lanes.follower_speed_mps[lane][:, None], behind_v[number, :, step])
    leader_v = lanes.leader_speed_mps[lane][:, None]
    closing_ahead = jnp.maximum(own_v - leader_v, 0.0)
    closing_behind = jnp.maximum(follower_v - own_v, 0.0)
    least_ahead = planner.jam_gap_m + planner.claim_time_gap_s * own_v
    least_ahead = least_ahead + closing_ahead**2 / (2.0 * planner.comfortable_deceleration_mps2)
    least_behind = planner.jam_gap_m + planner.claim_time_gap_s * follower_v
    least_behind = least_behind + closing_behind**2 / (2.0 * planner.yield_deceleration_mps2)
    return ahead_m - least_ahead, behind_m - least_behind
