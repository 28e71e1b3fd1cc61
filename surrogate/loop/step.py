"""One decision of the whole road: vehicles change lane, leave and enter; no time passes."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from surrogate.effects.apply import decide_lanes, remember_lane_changes, road_demands, with_lane_changes, with_memories
from surrogate.effects.base import Moment
from surrogate.inflow.asking import WAITING_SLOTS, still_waiting
from surrogate.inflow.entering import entrants
from surrogate.inflow.inflow import ArrivalDraws, arrive
from surrogate.inflow.insertion import entrants_by_rule
from surrogate.inflow.newcomers import NOBODY_WAITS
from surrogate.lane_change.decide import decide
from surrogate.lane_change.manoeuvre import (
    after_reorder,
    idle_manoeuvres,
    with_duration,
)
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.distant import with_distant_drivers
from surrogate.loop.several_subjects import who_left
from surrogate.loop.world import Clock, World
from surrogate.road.reorder import Moves, Order, new_order, rearrange
from surrogate.road.traffic_state import UNSEEN, Manoeuvres, TrafficState, VehicleArrays, empty_vehicles, with_changes
from surrogate.subject.control import with_plan, with_planned_acceleration
from surrogate.subject.logged_drive import LoggedMotion, as_logged, entry_of_subject, staying, with_logged_lane
from surrogate.subject.planner import Planner
from surrogate.vehicle.lane_change_model import STAY, LaneChangeDecision, Reason
from surrogate.vehicle.vehicle_class import select_by_class
from surrogate.xla.materialise import materialise


def initial_state(world: World, capacity: int, clock: Clock | None = None) -> TrafficState:
    """Return an empty road at time 0.

    Args:
        world: the run.
        capacity: entries of the vehicle arrays: rows plus the most vehicles that may be on the road at once.
        clock: lengths of steps; must be given where lane changes take time.
    """
    has_manoeuvres = clock is not None and clock.change_timing is not None
    num_rows, num_entrances = world.road.num_rows, world.inflow.num_entrances
    none = jnp.zeros((num_entrances,), jnp.int32)
    nobody_waits = jnp.full((num_entrances, WAITING_SLOTS), NOBODY_WAITS, jnp.int32)
    vehicles = empty_vehicles(num_rows, capacity)
    if world.effects is not None:
        vehicles = with_memories(world.effects, vehicles, world.seed)
    of_subjects = jnp.shape(world.subject.depart_s)
    if of_subjects:
        vehicles = with_changes(vehicles, track=jnp.full((capacity, *of_subjects), UNSEEN, jnp.int32))
    draws = ArrivalDraws(world.inflow, world.demand_vehps, world.seed, world.effects, world.subject.entrance)
    return TrafficState(
        vehicles=vehicles,
        head=jnp.arange(num_rows + 1, dtype=jnp.int32),
        step=jnp.zeros((), jnp.int32),
        num_arrived=none,
        num_inserted=none,
        next_arrival=draws.demand_to(none),
        cumulated_demand=jnp.zeros((num_entrances,), jnp.float32),
        subject_inserted=jnp.zeros(of_subjects, bool),
        subject_left=jnp.zeros(of_subjects, bool),
        num_tracks=jnp.zeros(of_subjects, jnp.int32),
        num_collisions=jnp.zeros((), jnp.int32),
        num_subject_overlaps=jnp.zeros((), jnp.int32) if isinstance(world.driver, LoggedMotion) else None,
        num_lost=jnp.zeros((), jnp.int32),
        num_lane_changes=jnp.zeros((len(Reason),), jnp.int32),
        manoeuvres=idle_manoeuvres(capacity) if has_manoeuvres else None,
        waiting=None if world.inflow.rules is None else nobody_waits,
    )


def settle_lanes(
    state: TrafficState,
    world: World,
    clock: Clock,
    num_tiles: Int[Array, ""] | int | None = None,
    plans: Bool[Array, ""] | bool = True,
) -> TrafficState:
    """State after one decision: vehicles change lane, leave and enter; no time passes.

    Args:
        state: the state.
        world: the run.
        clock: lengths of steps.
        num_tiles: tiles that hold vehicles, see `surrogate.xla.tiles`; all unless given.
        plans: whether a planner plans; False saves the work while no subject vehicle of a batch is on its road.
    """
    now_s = state.step.astype(jnp.float32) * clock.step_s
    effects, subject = world.effects, world.subject
    if world.distant is not None:
        is_subject = world.is_subject(state.vehicles)
        changed = with_distant_drivers(state.vehicles, world.distant, world.classes, is_subject)
        state = eqx.tree_at(lambda s: s.vehicles, state, changed)
    queues = arrive(
        state, world.inflow, world.demand_vehps, world.seed, now_s, clock.interval_s, effects, subject.entrance
    )
    with jax.named_scope("lane_change"):
        on_road = VehiclesOnRoad(state.vehicles, world.road, state.head)
        decision = decide(on_road, world.classes, clock.interval_s, clock.step_s, num_tiles)
    moment = Moment(state.vehicles, world.classes, world.seed, state.step, clock.step_s)
    if effects is not None:
        decision = materialise(decide_lanes(effects, decision, moment))
    decision, manoeuvres, closed = _as_carried_out(decision, state, world, clock, on_road, plans)
    vehicles = with_changes(
        state.vehicles,
        own_advice_mps2=decision.own_advice_mps2,
        asked_advice_mps2=decision.asked_advice_mps2,
        gain_left_memory=decision.gain_left_memory,
        gain_right_memory=decision.gain_right_memory,
        keep_right_memory=decision.keep_right_memory,
        look_ahead_speed_mps=decision.look_ahead_speed_mps,
    )
    with jax.named_scope("enter"):
        enter = (
            entrants if world.inflow.rules is None else partial(entrants_by_rule, num_steps=clock.steps_per_decision)
        )
        candidates = enter(
            state, queues, world.road, world.inflow, world.classes, subject, world.seed, now_s, clock.step_s, effects
        )
    if isinstance(world.driver, LoggedMotion):
        candidates = as_logged(candidates, world.driver, world.road, state)
        closed = None if closed is None else closed & ~entry_of_subject(candidates, closed)
    leaves = _leaves(vehicles, state, world)
    moves = Moves(
        leaves_road=leaves,
        changes_row=(decision.direction != STAY) & ~leaves,
        entry_ahead=decision.entry_ahead,
        entrant_ahead=candidates.entry_ahead,
        entrant_enters=candidates.enters,
        entrant_rank=candidates.rank,
        closed=closed,
    )
    with jax.named_scope("reorder"):
        order = new_order(moves, vehicles, state.head)
        moved_from = vehicles.row
        vehicles = _in_new_rows(vehicles, decision, order, on_road, world, moment)
        vehicles = rearrange(vehicles, candidates.vehicles, order)
        if manoeuvres is not None and (timing := clock.change_timing) is not None:
            lengths_m = select_by_class([c.length_m for c in world.classes], vehicles.vehicle_class)
            manoeuvres = after_reorder(manoeuvres, moved_from, order, vehicles, lengths_m, timing)
    if effects is not None:
        vehicles = remember_lane_changes(effects, Moment(vehicles, world.classes, world.seed, state.step, clock.step_s))
    entered_now = jnp.any(order.has_entered & candidates.is_subject)
    if subject.num_subjects:
        _, number = subject.waiting(state.subject_inserted, now_s)
        entered_now &= jnp.arange(subject.num_subjects) == number
    enters_as_other = (order.has_entered & ~candidates.is_subject).reshape(world.inflow.num_entrances, -1)
    num_entered = jnp.sum(enters_as_other, axis=1, dtype=jnp.int32)
    reasons = jnp.stack([jnp.sum(order.has_moved & (decision.reason == reason), dtype=jnp.int32) for reason in Reason])
    return dataclasses.replace(
        state,
        vehicles=vehicles,
        head=order.head,
        num_arrived=queues.num_arrived,
        num_inserted=state.num_inserted + num_entered,
        next_arrival=queues.next_arrival,
        cumulated_demand=queues.cumulated_demand,
        subject_inserted=state.subject_inserted | entered_now,
        subject_left=state.subject_left | who_left(leaves, state.vehicles, world),
        num_lost=state.num_lost + order.num_lost,
        num_lane_changes=state.num_lane_changes + reasons,
        manoeuvres=manoeuvres,
        waiting=still_waiting(candidates, order.has_entered),
    )


def _as_carried_out(
    decision: LaneChangeDecision,
    state: TrafficState,
    world: World,
    clock: Clock,
    on_road: VehiclesOnRoad,
    plans: Bool[Array, ""] | bool,
) -> tuple[LaneChangeDecision, Manoeuvres | None, Bool[Array, " vehicle"] | None]:
    """The decision with the subject vehicle's driver and with changes that take time, these, and gaps that are closed.

    The last two are None where changes take no time.
    """
    manoeuvres, timing, driver = state.manoeuvres, clock.change_timing, world.driver
    closed = None
    if isinstance(planner := driver, Planner):
        with jax.named_scope("plan"):
            decision = jax.lax.cond(
                plans,
                lambda: with_plan(decision, planner, on_road, world.classes, world.subject_class, clock.interval_s),
                lambda: decision,
            )
    if manoeuvres is not None and timing is not None:
        planned = decision
        if isinstance(driver, LoggedMotion):
            decision = staying(decision, world.is_subject(state.vehicles))
        decision, manoeuvres, closed = with_duration(decision, manoeuvres, state.vehicles, state.head, timing)
        if isinstance(driver, Planner):
            decision = with_planned_acceleration(decision, planned, world.is_subject(state.vehicles))
    if isinstance(driver, LoggedMotion):
        # a log has the vehicle in its new lane at once, half way through its change
        decision = with_logged_lane(decision, driver, state, world.is_subject(state.vehicles))
    return decision, manoeuvres, closed


def _leaves(vehicles: VehicleArrays, state: TrafficState, world: World) -> Bool[Array, " vehicle"]:
    """Vehicles at their destination, and the subject vehicle where its log ends."""
    destination_m = world.road.destination_end_m.at[vehicles.destination].get(mode="promise_in_bounds")
    leaves = vehicles.is_vehicle & (vehicles.position_m >= destination_m)
    if isinstance(world.driver, LoggedMotion):
        leaves |= world.is_subject(vehicles) & world.driver.is_over(state.step)
    return leaves


def _in_new_rows(
    vehicles: VehicleArrays,
    decision: LaneChangeDecision,
    order: Order,
    on_road: VehiclesOnRoad,
    world: World,
    moment: Moment,
) -> VehicleArrays:
    """The vehicles, not yet reordered, with the rows that they change to and what the road demands there."""
    effects = world.effects
    row = jnp.where(order.has_moved, decision.target_row, vehicles.row)
    vehicles = look_up_lane(with_changes(vehicles, row=row), on_road)
    if effects is not None:
        vehicles = materialise(road_demands(effects, vehicles, world.road, moment))
        vehicles = with_lane_changes(vehicles, jnp.where(order.has_moved, decision.direction, STAY))
    return vehicles


def look_up_lane(vehicles: VehicleArrays, on_road: VehiclesOnRoad) -> VehicleArrays:
    """Return the vehicles with what the road demands of them in the row they are in now."""
    row = jnp.minimum(vehicles.row, on_road.road.num_rows - 1)
    return with_changes(
        vehicles,
        speed_limit_mps=on_road.at_row(on_road.road.speed_limit_mps, row),
        slow_position_m=on_road.at_row(on_road.road.slow_position_m, row),
        slow_limit_mps=on_road.at_row(on_road.road.slow_limit_mps, row),
        stop_position_m=on_road.on_route(on_road.road.stop_position_m, row),
    )
