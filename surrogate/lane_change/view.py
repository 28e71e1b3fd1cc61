"""What vehicles see before they decide about their lanes, and who is in the way there."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from surrogate.lane_change.free_model import FreeModel, Outlook, free_models, of_members
from surrogate.lane_change.gap_acceptance import Blocked, Ego, blocked
from surrogate.lane_change.lanes import Lanes
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.old_follower import OldFollower
from surrogate.lane_change.strategy import Strategy, decayed_look_ahead_speed_mps, strategy
from surrogate.lane_change.surroundings import Wanted, ego_of, following_of, side_of, sight_m
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.lane_change_model import Side
from surrogate.vehicle.vehicle_class import VehicleClass, select_record
from surrogate.xla.materialise import materialise

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class View(eqx.Module):
    """What vehicles see before they decide."""

    ego: Ego  # each vehicle and its own lane
    right: Side  # the lane on its right
    left: Side  # the lane on its left
    after_right: Value  # look-ahead speed once the right side has been looked at
    after_left: Value  # look-ahead speed once both have
    route_right: Strategy  # what the route says of the right side
    route_left: Strategy  # what it says of the left side


def look_around(
    part: VehiclesOnRoad,
    wanted: Wanted,
    lanes: Lanes,
    classes: tuple[VehicleClass, ...],
    interval_s: float,
    step_s: float,
) -> View:
    """View of each vehicle.

    Args:
        part: the vehicles asked about.
        wanted: speeds that vehicles want.
        lanes: their lanes.
        classes: vehicle classes.
        interval_s: time since the last decision.
        step_s: length of a time step.
    """
    vehicles = part.vehicles
    following = following_of(vehicles.vehicle_class, classes)
    model = lc2013_of(vehicles, classes)
    look_m = sight_m(vehicles, following, step_s)
    ego = ego_of(part, following, wanted, lanes.need, look_m)
    right, left = (side_of(part, following, wanted, look_m, lane) for lane in (lanes.right, lanes.left))
    # SUMO lets the look-ahead speed decay once for each side that there is
    before = vehicles.look_ahead_speed_mps
    after_right = jnp.where(right.is_open, decayed_look_ahead_speed_mps(ego, before, interval_s), before)
    after_left = decayed_look_ahead_speed_mps(ego, after_right, interval_s)
    after_left = jnp.where(left.is_open, after_left, after_right)
    return View(
        ego=ego,
        right=right,
        left=left,
        after_right=after_right,
        after_left=after_left,
        route_right=strategy(model, ego, right, after_right, following, True),
        route_left=strategy(model, ego, left, after_left, following, False),
    )


class Judgement(eqx.Module):
    """Who is in the way on each side, by each vehicle's own model."""

    gaps: tuple[Blocked, Blocked]  # to the right and to the left
    others: list[tuple[FreeModel, Flag]]  # models other than LC2013 that occur, and whose they are
    outlook: Outlook | None  # what these are told; None if there are none


def judge_gaps(
    part: VehiclesOnRoad,
    around: View,
    old_follower: OldFollower | None,
    classes: tuple[VehicleClass, ...],
    step_s: float,
) -> Judgement:
    """Who is in the way.

    Args:
        part: the vehicles asked about.
        around: what they see.
        old_follower: who follows each in its own row; None if all classes have LC2013.
        classes: vehicle classes.
        step_s: length of a time step.
    """
    vehicle_class = part.vehicles.vehicle_class
    following = following_of(vehicle_class, classes)
    assertive = lc2013_of(part.vehicles, classes).assertive
    right, left = (blocked(around.ego, side, following, assertive, step_s) for side in (around.right, around.left))
    gaps = materialise((right, left))
    if old_follower is None:
        return Judgement(gaps, [], None)
    sides, routes = (around.right, around.left), (around.route_right, around.route_left)
    outlook = Outlook(around.ego, sides, routes, gaps, vehicle_class, old_follower, following, step_s)
    others = free_models(outlook, classes)
    for other, is_member in others:
        gaps = of_members(is_member, other.gaps(outlook), gaps)
    return Judgement(gaps, others, outlook)


def lc2013_of(vehicles: VehicleArrays, classes: tuple[VehicleClass, ...]) -> Lc2013:
    """Return the parameters for route and talk of each vehicle."""
    return select_record([c.lane_change.route_parameters() for c in classes], vehicles.vehicle_class)
