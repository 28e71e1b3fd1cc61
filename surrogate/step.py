"""One decision interval of the whole road: move, decide about lanes, let vehicles out and in."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import decided, road_demands, settled, with_lane_changes, with_memories
from surrogate.effects.base import Moment
from surrogate.effects.settings import Effects
from surrogate.inflow import ArrivalDraws, Inflow, SubjectPlan, arrive, entrants
from surrogate.kinematics import move
from surrogate.lane_change.base import STAY, Reason
from surrogate.lane_change.decide import decide
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.manoeuvre import (
    ChangeTiming,
    after_reorder,
    change_timing,
    idle_manoeuvres,
    with_duration,
)
from surrogate.lane_change.surroundings import Place
from surrogate.materialise import materialise
from surrogate.neighbours import leader_at, own_leader, second_leader
from surrogate.reorder import Moves, new_order, rearrange
from surrogate.road import Road
from surrogate.subject.control import with_plan, with_planned_acceleration
from surrogate.subject.planner import Planner
from surrogate.subject.replay import Replay, as_logged, entry_of_subject, impose, overlaps, staying, with_logged_lane
from surrogate.tiles import Tile, all_tiles, for_each_tile
from surrogate.traffic_state import TrafficState, VehicleArrays, empty_vehicles, with_changes
from surrogate.vehicle_class import VehicleClass, select_by_class


class Clock(eqx.Module):
    """Lengths of steps; choices of the trace.

    Attributes:
        step_s: car-following step.
        steps_per_decision: steps between two decisions about lanes, arrivals and perception.
        lane_change_duration_s: time that a lane change takes; 0 for none.
    """

    step_s: float = eqx.field(static=True)
    steps_per_decision: int = eqx.field(static=True)
    lane_change_duration_s: float = eqx.field(static=True, default=0.0)

    @property
    def change_timing(self) -> ChangeTiming | None:
        """When things happen in a lane change; None if it takes no time."""
        return change_timing(self.lane_change_duration_s, self.step_s, self.interval_s)

    @property
    def interval_s(self) -> float:
        """Time between two decisions."""
        return self.step_s * self.steps_per_decision


class World(eqx.Module):
    """Everything that stays the same during a run.

    Attributes:
        road: geometry.
        inflow: where and as what vehicles enter.
        classes: vehicle classes; that of the subject vehicle is the last.
        demand_vehps: demand of each entrance.
        subject: when and where the subject vehicle enters.
        seed: seed of the run.
        effects: what the baseline lacks; None for the baseline, whose program then knows nothing of effects.
        driver: who drives the subject vehicle, if not the models of its class.
    """

    road: Road
    inflow: Inflow
    classes: tuple[VehicleClass, ...]
    demand_vehps: Float[Array, " entrance"]
    subject: SubjectPlan
    seed: Int[Array, ""]
    effects: Effects | None = None
    driver: Planner | Replay | None = None

    @property
    def subject_class(self) -> int:
        """Class of the subject vehicle."""
        return len(self.classes) - 1

    def is_subject(self, vehicles: VehicleArrays) -> Bool[Array, " vehicle"]:
        """Return which vehicle is the subject vehicle."""
        return vehicles.vehicle_class == self.subject_class


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
    vehicles = empty_vehicles(num_rows, capacity)
    if world.effects is not None:
        vehicles = with_memories(world.effects, vehicles, world.seed)
    draws = ArrivalDraws(world.inflow, world.demand_vehps, world.seed, world.effects, world.subject.entrance)
    return TrafficState(
        vehicles=vehicles,
        head=jnp.arange(num_rows + 1, dtype=jnp.int32),
        step=jnp.zeros((), jnp.int32),
        num_arrived=none,
        num_inserted=none,
        next_arrival=draws.demand_to(none),
        cumulated_demand=jnp.zeros((num_entrances,), jnp.float32),
        subject_inserted=jnp.zeros((), bool),
        subject_left=jnp.zeros((), bool),
        num_tracks=jnp.zeros((), jnp.int32),
        num_collisions=jnp.zeros((), jnp.int32),
        num_subject_overlaps=jnp.zeros((), jnp.int32) if isinstance(world.driver, Replay) else None,
        num_lost=jnp.zeros((), jnp.int32),
        num_lane_changes=jnp.zeros((len(Reason),), jnp.int32),
        manoeuvres=idle_manoeuvres(capacity) if has_manoeuvres else None,
    )


def settle_lanes(
    state: TrafficState,
    world: World,
    clock: Clock,
    num_tiles: Int[Array, ""] | int | None = None,
    plans: Bool[Array, ""] | bool = True,
) -> TrafficState:
    """Return the state after one decision: vehicles change lane, leave and enter; no time passes.

    Args:
        state: the state.
        world: the run.
        clock: lengths of steps.
        num_tiles: tiles that hold vehicles, see `surrogate.tiles`; all unless given.
        plans: whether a planner plans; False saves the work while no subject vehicle of a batch is on its road.
    """
    now_s = state.step.astype(jnp.float32) * clock.step_s
    effects = world.effects
    queues = arrive(
        state,
        world.inflow,
        world.demand_vehps,
        world.seed,
        now_s,
        clock.interval_s,
        effects,
        world.subject.entrance,
    )
    with jax.named_scope("lane_change"):
        place = Place(state.vehicles, world.road, state.head)
        decision = decide(place, world.classes, clock.interval_s, clock.step_s, num_tiles)
    moment = Moment(state.vehicles, world.classes, world.seed, state.step, clock.step_s)
    if effects is not None:
        decision = materialise(decided(effects, decision, moment))
    manoeuvres, timing = state.manoeuvres, clock.change_timing
    closed = None
    if isinstance(planner := world.driver, Planner):
        with jax.named_scope("plan"):
            decision = jax.lax.cond(
                plans,
                lambda: with_plan(decision, planner, place, world.classes, world.subject_class, clock.interval_s),
                lambda: decision,
            )
    if manoeuvres is not None and timing is not None:
        planned = decision
        if isinstance(world.driver, Replay):
            decision = staying(decision, world.is_subject(state.vehicles))
        decision, manoeuvres, closed = with_duration(decision, manoeuvres, state.vehicles, state.head, timing)
        if isinstance(world.driver, Planner):
            decision = with_planned_acceleration(decision, planned, world.is_subject(state.vehicles))
    if isinstance(world.driver, Replay):
        # a log has the vehicle in its new lane at once, half way through its change
        decision = with_logged_lane(decision, world.driver, state, world.is_subject(state.vehicles))
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
        candidates = entrants(
            state,
            queues,
            world.road,
            world.inflow,
            world.classes,
            world.subject,
            world.seed,
            now_s,
            clock.step_s,
            effects,
        )
    if isinstance(world.driver, Replay):
        candidates = as_logged(candidates, world.driver, world.road, state)
        closed = None if closed is None else closed & ~entry_of_subject(candidates, closed)
    destination_m = world.road.destination_end_m.at[vehicles.destination].get(mode="promise_in_bounds")
    leaves = vehicles.is_vehicle & (vehicles.position_m >= destination_m)
    if isinstance(world.driver, Replay):
        leaves |= world.is_subject(vehicles) & world.driver.is_over(state.step)
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
        row = jnp.where(order.has_moved, decision.target_row, vehicles.row)
        vehicles = look_up_lane(with_changes(vehicles, row=row), place)
        if effects is not None:
            vehicles = materialise(road_demands(effects, vehicles, world.road, moment))
        newcomers = candidates.vehicles
        if effects is not None:
            vehicles = with_lane_changes(vehicles, jnp.where(order.has_moved, decision.direction, STAY), moved_from)
        vehicles = rearrange(vehicles, newcomers, order)
        if manoeuvres is not None and timing is not None:
            lengths_m = select_by_class([c.length_m for c in world.classes], vehicles.vehicle_class)
            manoeuvres = after_reorder(manoeuvres, moved_from, order, vehicles, lengths_m, timing)
    if effects is not None:
        vehicles = settled(effects, Moment(vehicles, world.classes, world.seed, state.step, clock.step_s))
    enters_as_other = order.has_entered & ~candidates.is_subject
    reasons = jnp.zeros_like(state.num_lane_changes).at[decision.reason].add(order.has_moved.astype(jnp.int32))
    return TrafficState(
        vehicles=vehicles,
        head=order.head,
        step=state.step,
        num_arrived=queues.num_arrived,
        num_inserted=state.num_inserted + jnp.sum(enters_as_other, axis=1, dtype=jnp.int32),
        next_arrival=queues.next_arrival,
        cumulated_demand=queues.cumulated_demand,
        subject_inserted=state.subject_inserted | jnp.any(order.has_entered & candidates.is_subject),
        subject_left=state.subject_left | jnp.any(leaves & world.is_subject(state.vehicles)),
        num_tracks=state.num_tracks,
        num_collisions=state.num_collisions,
        num_subject_overlaps=state.num_subject_overlaps,
        num_lost=state.num_lost + order.num_lost,
        num_lane_changes=state.num_lane_changes + reasons,
        manoeuvres=manoeuvres,
    )


def move_on(
    state: TrafficState, world: World, step_s: float, num_steps: int, num_tiles: Int[Array, ""] | int | None = None
) -> TrafficState:
    """Return the state after some steps in which everybody stays in his lane.

    Args:
        state: the state.
        world: the run.
        step_s: length of a step.
        num_steps: how many.
        num_tiles: tiles that hold vehicles, see `surrogate.tiles`; all unless given.
    """
    num_entries = state.vehicles.row.shape[0]
    num_tiles = all_tiles(num_entries) if num_tiles is None else num_tiles
    cooperative = []
    for vehicle_class in world.classes:
        model = vehicle_class.lane_change
        cooperative.append(jnp.clip(model.cooperative_speed, 0.0, 1.0) if isinstance(model, Lc2013) else jnp.ones(()))

    def one_step(_: int, carry: _Progress) -> _Progress:
        motion, step, num_collisions, num_overlaps = carry
        vehicles = motion.of(state.vehicles)
        leader, beside = materialise(own_leader(vehicles)), None
        if state.manoeuvres is not None:
            beside = materialise(leader_at(state.manoeuvres.second_leader, vehicles))
        second = None if world.effects is None else materialise(second_leader(leader))

        def one_tile(tile: Tile, carry: tuple[_Motion, Array]) -> tuple[_Motion, Array]:
            motion, num_collisions = carry
            before = tile(motion)
            vehicles = before.of(tile(state.vehicles))
            cooperative_speed = select_by_class(cooperative, vehicles.vehicle_class)
            after, has_collided = move(
                vehicles,
                tile(leader),
                world.classes,
                cooperative_speed,
                world.seed,
                step,
                step_s,
                world.effects,
                tile(second),
                tile(beside),
            )
            after = jax.tree.map(lambda new, old: jnp.where(tile.is_new, new, old), _Motion.from_(after), before)
            return tile.write(motion, after), num_collisions + jnp.sum(has_collided & tile.is_new)

        motion, num_collisions = for_each_tile(one_tile, num_tiles, num_entries, (motion, num_collisions))
        if isinstance(world.driver, Replay) and num_overlaps is not None:
            is_subject = world.is_subject(state.vehicles)
            length_m = select_by_class([one.length_m for one in world.classes], state.vehicles.vehicle_class)
            vehicles = impose(world.driver, motion.of(state.vehicles), is_subject, step + 1, step_s)
            num_overlaps = num_overlaps + overlaps(vehicles, is_subject, length_m)
            motion = _Motion.from_(vehicles)
        return motion, step + 1, num_collisions, num_overlaps

    with jax.named_scope("move"):
        carry = (_Motion.from_(state.vehicles), state.step, state.num_collisions, state.num_subject_overlaps)
        motion, *counts = jax.lax.fori_loop(0, num_steps, one_step, carry)
    moved = (motion.of(state.vehicles), *counts)
    return eqx.tree_at(
        lambda s: (s.vehicles, s.step, s.num_collisions, s.num_subject_overlaps),
        state,
        moved,
        is_leaf=lambda leaf: leaf is None,
    )


class _Motion(eqx.Module):
    """What changes of vehicles that stay in their lanes."""

    position_m: Float[Array, " vehicle"]
    speed_mps: Float[Array, " vehicle"]
    acceleration_mps2: Float[Array, " vehicle"]
    personal: dict[str, dict[str, Array]] | None

    @classmethod
    def from_(cls, vehicles: VehicleArrays) -> "_Motion":
        """Take it from vehicles."""
        return cls(vehicles.position_m, vehicles.speed_mps, vehicles.acceleration_mps2, vehicles.personal)

    def of(self, vehicles: VehicleArrays) -> VehicleArrays:
        """Return the vehicles with this motion."""
        return with_changes(
            vehicles,
            position_m=self.position_m,
            speed_mps=self.speed_mps,
            acceleration_mps2=self.acceleration_mps2,
            personal=self.personal,
        )


_Progress = tuple[_Motion, Array, Array, Array | None]  # motion, step, collisions, overlaps of a replayed vehicle


def look_up_lane(vehicles: VehicleArrays, place: Place) -> VehicleArrays:
    """Return the vehicles with what the road demands of them in the row they are in now."""
    row = jnp.minimum(vehicles.row, place.road.num_rows - 1)
    return with_changes(
        vehicles,
        speed_limit_mps=place.at_row(place.road.speed_limit_mps, row),
        slow_position_m=place.at_row(place.road.slow_position_m, row),
        slow_limit_mps=place.at_row(place.road.slow_limit_mps, row),
        stop_position_m=place.on_route(place.road.stop_position_m, row),
    )
