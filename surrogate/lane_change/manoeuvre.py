"""Lane changes that take time: SUMO's option `lanechange.duration`.

While a vehicle changes, it is in two lanes: it follows the leaders of both, and the followers of both follow it. Half
way it belongs to the new lane; when its body has left the old lane, that is free; until the end it decides about no
other change. Nothing is called off. In the arrays a vehicle has one row; in the other it is a *shadow*.

Source: `MSLaneChanger::continueChange` and `MSAbstractLaneChangeModel::updateShadowLane`, and step by step SUMO 1.28
(experiments/fidelity/timed_change.py): the shadow is there from the first step.

Deviations:
- Times are rounded to whole intervals of decisions; where half a change rounds to none, a change takes no time.
- Lanes are 3.2 m wide and vehicles 1.8 m, SUMO's defaults, which sets when the body has left the old lane.
- Nobody starts into a gap in which somebody's shadow is, however long that gap is; nor does anybody enter the
  road there.
- Of several leaders on the other lane the rearmost counts.
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.road.neighbours import entry_ahead
from surrogate.road.reorder import NOBODY, Order
from surrogate.road.traffic_state import Manoeuvres, VehicleArrays
from surrogate.vehicle.lane_change_model import STAY, LaneChangeDecision
from surrogate.xla.gather import take

LANE_WIDTH_M, VEHICLE_WIDTH_M = 3.2, 1.8
IN_OLD_LANE = 0.5 + 0.5 * VEHICLE_WIDTH_M / LANE_WIDTH_M  # share of the duration
NO_LEADER = 0  # entry: the head of the first row


class ChangeTiming(eqx.Module):
    """When things happen in a change, in decisions since it began; choices of the trace."""

    switches: int = eqx.field(static=True)  # the vehicle belongs to the new lane
    leaves: int = eqx.field(static=True)  # its body has left the old lane
    ends: int = eqx.field(static=True)  # it may decide again


def change_timing(duration_s: float, step_s: float, interval_s: float) -> ChangeTiming | None:
    """Return the timing of changes of this duration; None if half of one is nearer to no decision than to one.

    Args:
        duration_s: SUMO's `lanechange.duration`.
        step_s: length of a time step.
        interval_s: time between two decisions.
    """
    if duration_s <= step_s:
        return None

    def decisions(share: float) -> int:
        # as SUMO counts: the first share is covered in the step in which the change begins, and rounding adds up
        covered, num_steps = 0.0, 0
        while covered < share:
            covered += LANE_WIDTH_M / duration_s * step_s / LANE_WIDTH_M
            num_steps += 1
        return math.floor((num_steps - 1) * step_s / interval_s + 0.5)

    if decisions(0.5) == 0:
        return None
    return ChangeTiming(switches=decisions(0.5), leaves=decisions(IN_OLD_LANE), ends=decisions(1.0))


def idle_manoeuvres(capacity: int) -> Manoeuvres:
    """Return that nobody changes."""
    none = jnp.zeros((capacity,), jnp.int32)
    return Manoeuvres(
        direction=none, reason=none, age=none, has_switched=jnp.zeros((capacity,), bool), shadow_row=none,
        second_leader=none,
    )  # fmt: skip


def with_duration(
    decision: LaneChangeDecision,
    manoeuvres: Manoeuvres,
    vehicles: VehicleArrays,
    head: Int[Array, " row_plus_one"],
    timing: ChangeTiming,
) -> tuple[LaneChangeDecision, Manoeuvres, Bool[Array, " vehicle"]]:
    """Return the decision with changes of row for those half way, the changes under way, and gaps with shadows.

    Args:
        decision: what vehicles would do if changes took no time.
        manoeuvres: changes under way.
        vehicles: all vehicles.
        head: first entry of each row.
        timing: when things happen.
    """
    entry = jnp.arange(vehicles.row.shape[0], dtype=jnp.int32)
    age = manoeuvres.age + 1
    is_busy = (manoeuvres.direction != STAY) & (age < timing.ends)
    has_shadow = is_busy & (age < timing.leaves)
    beside = entry_ahead(vehicles.position_m, manoeuvres.shadow_row, vehicles.position_m, head)
    is_shadowed = jnp.zeros_like(is_busy).at[jnp.where(has_shadow, beside, 0)].max(has_shadow)

    starts = (decision.direction != STAY) & ~is_busy & ~take(is_shadowed, decision.entry_ahead)
    # of several who want the same gap only the first begins, as in `reorder`
    wanted = jnp.where(starts, decision.entry_ahead, 0)
    claimant = jnp.full_like(entry, NOBODY).at[wanted].min(jnp.where(starts, entry, NOBODY))
    starts &= take(claimant, wanted) == entry
    begun_behind = decision.entry_ahead
    switches = is_busy & ~manoeuvres.has_switched & (age >= timing.switches)
    unchanged = is_busy | starts

    begun = Manoeuvres(
        direction=jnp.where(starts, decision.direction, jnp.where(is_busy, manoeuvres.direction, STAY)),
        reason=jnp.where(starts, decision.reason, manoeuvres.reason),
        age=jnp.where(starts, 0, age),
        has_switched=manoeuvres.has_switched & ~starts,
        shadow_row=jnp.where(starts, decision.target_row, jnp.where(is_busy, manoeuvres.shadow_row, 0)),
        second_leader=manoeuvres.second_leader,
    )
    decision = LaneChangeDecision(
        direction=jnp.where(switches, manoeuvres.direction, STAY),
        reason=manoeuvres.reason,
        entry_ahead=beside,
        target_row=manoeuvres.shadow_row,
        own_advice_mps2=jnp.where(is_busy, NO_ADVICE, decision.own_advice_mps2),
        asked_advice_mps2=decision.asked_advice_mps2,
        gain_left_memory=jnp.where(unchanged, 0.0, decision.gain_left_memory),
        gain_right_memory=jnp.where(unchanged, 0.0, decision.gain_right_memory),
        keep_right_memory=jnp.where(unchanged, 0.0, decision.keep_right_memory),
        look_ahead_speed_mps=jnp.where(unchanged, 0.0, decision.look_ahead_speed_mps),
    )
    # no newcomer enters there: behind the entry before a shadow, or behind who becomes one
    closed = is_shadowed.at[jnp.where(starts, begun_behind, 0)].max(starts) | switches
    return decision, begun, closed


def after_reorder(
    manoeuvres: Manoeuvres,
    old_row: Int[Array, " vehicle"],
    order: Order,
    vehicles: VehicleArrays,
    lengths_m: Array,
    timing: ChangeTiming,
) -> Manoeuvres:
    """Return the manoeuvres in the new order, with the leaders that shadows add.

    Args:
        manoeuvres: in the old order.
        old_row: row of each vehicle before.
        order: the new order.
        vehicles: the vehicles in it.
        lengths_m: their lengths.
        timing: when things happen.
    """
    num_new = order.has_entered.size + 1

    def gather(leaf: Array) -> Array:
        return take(jnp.concatenate([leaf, jnp.zeros((num_new,), leaf.dtype)]), order.source)

    direction, reason, age, has_switched = (
        gather(leaf)
        for leaf in (
            manoeuvres.direction, manoeuvres.reason, manoeuvres.age, manoeuvres.has_switched | order.has_moved,
        )
    )  # fmt: skip
    shadow_row = gather(jnp.where(order.has_moved, old_row, manoeuvres.shadow_row))
    has_shadow = (direction != STAY) & (age < timing.leaves) & vehicles.is_vehicle
    return Manoeuvres(
        direction=direction,
        reason=reason,
        age=age,
        has_switched=has_switched,
        shadow_row=shadow_row,
        second_leader=_second_leaders(has_shadow, shadow_row, order.head, vehicles, lengths_m),
    )


def _second_leaders(
    has_shadow: Bool[Array, " vehicle"],
    shadow_row: Int[Array, " vehicle"],
    head: Int[Array, " row_plus_one"],
    vehicles: VehicleArrays,
    lengths_m: Array,
) -> Int[Array, " vehicle"]:
    """For each vehicle the entry of its leader on the other lane, or of the shadow before it in its own."""
    last = vehicles.row.shape[0] - 1
    entry = jnp.arange(last + 1, dtype=jnp.int32)
    rear_m = vehicles.position_m - lengths_m
    ahead = entry_ahead(vehicles.position_m, shadow_row, vehicles.position_m, head)
    behind = jnp.where(has_shadow, jnp.minimum(ahead + 1, last), NO_LEADER)  # may be the next row's head: no matter
    shadow_rear_m = jnp.full(entry.shape, jnp.inf).at[behind].min(jnp.where(has_shadow, rear_m, jnp.inf))
    is_rearmost = has_shadow & (rear_m <= take(shadow_rear_m, behind))
    shadow = (
        jnp.full(entry.shape, NO_LEADER, jnp.int32)
        .at[jnp.where(is_rearmost, behind, NO_LEADER)]
        .max(jnp.where(is_rearmost, entry, NO_LEADER))
    )
    own = jnp.where(has_shadow, ahead, NO_LEADER)
    return jnp.where(take(rear_m, own) <= take(rear_m, shadow), own, shadow)
