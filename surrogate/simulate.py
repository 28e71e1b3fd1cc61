"""Runs the road from empty to the subject vehicle's arrival, folding an observer over what it detects.

Nothing of the way is stored: the observer, given by the caller, turns each frame into its own small state. A batch of
runs shares one loop, so that it ends when the last subject vehicle has arrived.
"""

from typing import Any, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import appeared, sensed, start_of_sensing
from surrogate.materialise import materialise
from surrogate.moving import move_on
from surrogate.perception import PerceptionFrame, Sensor, blank_frame, perceive
from surrogate.step import initial_state, settle_lanes
from surrogate.tiles import tiles_for
from surrogate.traffic_state import TrafficState
from surrogate.world import Clock, World

ObserverState = Any


class Observer(Protocol):
    """A fold over perception frames."""

    def start(self) -> ObserverState:
        """Return the state before the first frame."""
        ...

    def update(self, state: ObserverState, frame: PerceptionFrame) -> ObserverState:
        """Return the state after one more frame; a frame that is not valid must change nothing."""
        ...

    def finish(self, state: ObserverState) -> Array:
        """Return what the drive comes to."""
        ...


class RunRecord(eqx.Module):
    """What is left of a run, up to the end of the block in which its subject vehicle arrives.

    What happens later depends on how long others of the batch drive, and is nobody's business.

    Attributes:
        observed: what the observer made of the drive.
        num_arrived: vehicles that asked to enter, per entrance.
        num_inserted: vehicles that entered, per entrance.
        num_on_road: most vehicles on the road at once, sampled at each block's end.
        num_vehicle_steps: vehicles on the road, summed over steps; counted at the ends of blocks.
        num_collisions: vehicle steps with overlapping vehicles.
        num_subject_overlaps: steps in which a replayed subject vehicle overlaps another vehicle.
        num_lost: newcomers that found the arrays full; a run with any is not valid.
        num_lane_changes: lane changes on the whole road by reason.
        subject_entered: whether the subject vehicle found its way onto the road.
        subject_left: whether it reached its destination.
        is_finite: whether all positions and speeds are finite at the end.
    """

    observed: Array
    num_arrived: Int[Array, " entrance"]
    num_inserted: Int[Array, " entrance"]
    num_on_road: Int[Array, ""]
    num_vehicle_steps: Int[Array, ""]
    num_collisions: Int[Array, ""]
    num_subject_overlaps: Int[Array, ""]
    num_lost: Int[Array, ""]
    num_lane_changes: Int[Array, " reason"]
    subject_entered: Bool[Array, ""]
    subject_left: Bool[Array, ""]
    is_finite: Bool[Array, ""]


class RunPlan(eqx.Module):
    """How long runs last and how much room they have.

    Attributes:
        clock: lengths of steps.
        capacity: entries of the vehicle arrays: rows plus the most vehicles on the road.
        steps_per_frame: steps between two frames; a multiple or a divisor of the steps between two decisions.
        block_s: time between two looks at whether all subject vehicles have arrived.
    """

    clock: Clock
    capacity: int = eqx.field(static=True)
    steps_per_frame: int = eqx.field(static=True)
    block_s: float = eqx.field(static=True, default=10.0)

    def __check_init__(self) -> None:
        """Check that frames and decisions meet."""
        longer, shorter = sorted((self.steps_per_frame, self.clock.steps_per_decision), reverse=True)
        if longer % shorter:
            raise ValueError(f"Expected frames every multiple or part of {self.clock.steps_per_decision} steps.")

    @property
    def steps_before_decision(self) -> int:
        """Steps from a frame to a decision; SUMO changes lanes anywhere between two frames, here it is the middle."""
        return min(self.steps_per_frame, self.clock.steps_per_decision) // 2


def observe_batch(
    worlds: World,
    axes: World,
    sensor: Sensor,
    observer: Observer,
    plan: RunPlan,
    first_frame_s: Float[Array, ""],
    end_s: Float[Array, ""],
    states: TrafficState | None = None,
) -> RunRecord:
    """Return the records of a batch of runs.

    Args:
        worlds: the runs; leaves that differ between runs have a leading axis for them.
        axes: a world with 0 where `worlds` has that axis and None where all runs share a leaf.
        sensor: the subject vehicles' sensors.
        observer: fold over their frames.
        plan: step lengths and room.
        first_frame_s: frames begin after this time; no subject vehicle may depart earlier.
        end_s: runs end then at the latest.
        states: the roads at time 0, with a leading axis for runs; empty ones unless given.
    """
    clock = plan.clock
    subject_class = len(worlds.classes) - 1

    def first(world: World) -> TrafficState:
        return initial_state(world, plan.capacity, clock)

    decisions_per_frame = max(1, plan.steps_per_frame // clock.steps_per_decision)
    frames_per_decision = max(1, clock.steps_per_decision // plan.steps_per_frame)
    steps_per_cycle = max(plan.steps_per_frame, clock.steps_per_decision)
    cycles_per_block = max(1, round(plan.block_s / clock.step_s / steps_per_cycle))
    steps_before = plan.steps_before_decision
    steps_after = min(plan.steps_per_frame, clock.steps_per_decision) - steps_before

    def go(
        states: TrafficState, num_steps: int | Int[Array, ""], num_tiles: Int[Array, ""], most_steps: int | None = None
    ) -> TrafficState:
        def one(state: TrafficState, world: World) -> TrafficState:
            return move_on(state, world, clock.step_s, num_steps, num_tiles, most_steps)

        return jax.vmap(one, in_axes=(0, axes))(states, worlds)

    def settle(states: TrafficState, plans: Bool[Array, ""], num_tiles: Int[Array, ""]) -> TrafficState:
        def one(state: TrafficState, world: World) -> TrafficState:
            return settle_lanes(state, world, clock, num_tiles, plans)

        return jax.vmap(one, in_axes=(0, axes))(states, worlds)

    def see(state: TrafficState, observed: ObserverState, world: World) -> tuple[Array, Array, ObserverState]:
        has_effects = world.effects is not None
        observed, sensor_memory = observed if has_effects else (observed, {})
        time_s = state.step.astype(jnp.float32) * clock.step_s
        with jax.named_scope("perceive"):
            state, seen_now, entry = perceive(state, world.road, sensor, subject_class, time_s)
        in_time = time_s <= end_s + 0.5 * clock.step_s
        seen_now = eqx.tree_at(lambda one: one.valid, seen_now, seen_now.valid & in_time)
        if world.effects is not None:
            with jax.named_scope("sense"):
                seen_now = appeared(world.effects, seen_now, state.vehicles, entry)
                seen_now, sensor_memory = sensed(world.effects, seen_now, sensor_memory, world.seed)
        with jax.named_scope("observe"):
            # a program of its own, which rounds alike whatever made the frame
            observed = observer.update(observed, materialise(seen_now))
        return state.vehicles.track, state.num_tracks, (observed, sensor_memory) if has_effects else observed

    def block(carry: tuple[TrafficState, ObserverState, RunRecord]) -> tuple[TrafficState, ObserverState, RunRecord]:
        states, observed, record = carry
        is_over = states.subject_left
        is_seen = states.step[0] >= first_seen_step

        def cycle(_: Int[Array, ""], carry: tuple[TrafficState, ObserverState]) -> Any:
            # no condition differs between runs, so branches are skipped; nor does num_tiles
            states, observed = carry
            num_tiles = tiles_for(jnp.max(states.head[:, -1]) + most_newcomers, plan.capacity)
            for _more in range(decisions_per_frame - 1):
                states = settle(go(states, steps_before, num_tiles), is_seen, num_tiles)
                states = go(states, steps_after, num_tiles)
            states = settle(go(states, steps_before, num_tiles), is_seen, num_tiles)

            def to_frame(number: Int[Array, ""], carry: tuple[TrafficState, ObserverState]) -> Any:
                states, observed = carry
                # one loop for any number of steps, so that a run is the same to the bit, seen or not
                num_steps = jnp.where(is_seen, jnp.where(number == 0, steps_after, plan.steps_per_frame), steps_unseen)
                states = go(states, num_steps, num_tiles, steps_unseen)
                unseen = states.vehicles.track, states.num_tracks, observed
                track, num_tracks, observed = jax.lax.cond(
                    is_seen,
                    lambda: jax.vmap(see, in_axes=(0, 0, axes))(states, observed, worlds),
                    lambda: unseen,
                )
                return eqx.tree_at(lambda s: (s.vehicles.track, s.num_tracks), states, (track, num_tracks)), observed

            return jax.lax.fori_loop(0, jnp.where(is_seen, frames_per_decision, 1), to_frame, (states, observed))

        states, observed = jax.lax.fori_loop(0, cycles_per_block, cycle, (states, observed))
        later = _record(states, record.num_on_road, record.num_vehicle_steps + steps_per_block * _num_on_road(states))
        kept = jax.tree.map(
            lambda old, new: jnp.where(is_over.reshape(-1, *[1] * (new.ndim - 1)), old, new), record, later
        )
        return states, observed, kept

    def goes_on(carry: tuple[TrafficState, ObserverState, RunRecord]) -> Bool[Array, ""]:
        states = carry[0]
        is_early = states.step[0].astype(jnp.float32) * clock.step_s < end_s
        return is_early & ~jnp.all(states.subject_left)

    num_runs = worlds.seed.shape[0]
    most_newcomers = decisions_per_frame * worlds.inflow.lane_row.size
    # whole blocks are seen or not, so that a run sees the same frames in whichever batch it is
    steps_per_block = cycles_per_block * steps_per_cycle
    steps_unseen = steps_after + (frames_per_decision - 1) * plan.steps_per_frame
    first_seen_step = jnp.floor(first_frame_s / clock.step_s / steps_per_block).astype(jnp.int32) * steps_per_block
    if states is None:
        states = jax.vmap(first, in_axes=(axes,), axis_size=num_runs)(worlds)
    start = observer.start()
    if worlds.effects is not None:
        start = start, start_of_sensing(blank_frame(worlds.road, sensor))
    observed = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_runs, *jnp.shape(leaf))), start)
    record = _record(states, _num_on_road(states), jnp.zeros((num_runs,), jnp.int32))
    _, observed, record = jax.lax.while_loop(goes_on, block, (states, observed, record))
    if worlds.effects is not None:
        observed = observed[0]
    return eqx.tree_at(lambda r: r.observed, record, jax.vmap(observer.finish)(observed))


def _record(states: TrafficState, num_on_road: Int[Array, " run"], num_vehicle_steps: Int[Array, " run"]) -> RunRecord:
    """Return what is known of runs by now; what they observed is filled in at the end."""
    overlaps = states.num_subject_overlaps
    return RunRecord(
        observed=jnp.zeros_like(states.step),
        num_arrived=states.num_arrived,
        num_inserted=states.num_inserted,
        num_on_road=jnp.maximum(num_on_road, _num_on_road(states)),
        num_vehicle_steps=num_vehicle_steps,
        num_collisions=states.num_collisions,
        num_subject_overlaps=jnp.zeros_like(states.step) if overlaps is None else overlaps,
        num_lost=states.num_lost,
        num_lane_changes=states.num_lane_changes,
        subject_entered=states.subject_inserted,
        subject_left=states.subject_left,
        is_finite=jnp.all(jnp.isfinite(states.vehicles.speed_mps), axis=1),
    )


def _num_on_road(states: TrafficState) -> Int[Array, " run"]:
    return states.head[:, -1] - (states.head.shape[1] - 1)
