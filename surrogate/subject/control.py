"""Puts a plan in the place of what the lane-change model would have done with the subject vehicle."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.subject.planner import Planner, plan
from surrogate.subject.view import OWN_LANE, look_around
from surrogate.vehicle.lane_change_model import STAY, LaneChangeDecision, Reason
from surrogate.vehicle.vehicle_class import VehicleClass
from surrogate.xla.materialise import materialise


def with_planned_acceleration(
    decision: LaneChangeDecision, planned: LaneChangeDecision, is_subject: Bool[Array, " vehicle"]
) -> LaneChangeDecision:
    """Return the decision with the acceleration planned for the subject vehicle, which goes on while it changes lane.

    Args:
        decision: what happens now, where lane changes take time.
        planned: what `with_plan` returned.
        is_subject: which vehicle is the subject vehicle.
    """
    advice = jnp.where(is_subject, planned.own_advice_mps2, decision.own_advice_mps2)
    return eqx.tree_at(lambda d: d.own_advice_mps2, decision, advice)


def with_plan(
    decision: LaneChangeDecision,
    planner: Planner,
    on_road: VehiclesOnRoad,
    classes: tuple[VehicleClass, ...],
    subject_class: int,
    interval_s: float,
) -> LaneChangeDecision:
    """Return the decision with the subject vehicle's part taken from its planner.

    The planned acceleration is passed on as the vehicle's own advice, which counts as long as its class follows no
    slower; what others ask of it is its planner's business, so it is dropped.
    """
    view = look_around(
        on_road.vehicles, on_road.head, on_road.road, classes, subject_class, planner.ahead_m, planner.behind_m
    )
    # both once for a vehicle, not once for each entry of the arrays that they are written into
    view = materialise(view)
    chosen = materialise(plan(planner, view, interval_s))
    is_needed = view.lanes.num_changes[OWN_LANE] > 0
    reason = jnp.where(is_needed, Reason.STRATEGIC, Reason.SPEED_GAIN).astype(jnp.int32)
    is_subject = on_road.vehicles.vehicle_class == subject_class
    return dataclasses.replace(
        decision,
        direction=jnp.where(is_subject, chosen.direction, decision.direction),
        reason=jnp.where(is_subject, reason, decision.reason),
        entry_ahead=jnp.where(is_subject & (chosen.direction != STAY), chosen.entry_ahead, decision.entry_ahead),
        target_row=jnp.where(is_subject, chosen.target_row, decision.target_row),
        own_advice_mps2=jnp.where(is_subject, chosen.acceleration_mps2, decision.own_advice_mps2),
        asked_advice_mps2=jnp.where(is_subject, NO_ADVICE, decision.asked_advice_mps2),
    )
