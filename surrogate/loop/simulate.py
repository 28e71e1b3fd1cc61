"""Runs the road from empty to the subject vehicle's arrival, folding an observer over what it detects.

Nothing of the way is stored: the observer, given by the caller, turns each frame into its own small state. A batch of
runs shares one loop. That may end when most subject vehicles have arrived: the rest can go on in another batch, which
costs less than to wait for them.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.effects.apply import sense_frame, show_lane_changes, start_of_sensing
from surrogate.loop.moving import move_on
from surrogate.loop.recorded_parts import is_recorded
from surrogate.loop.run_state import Observer, ObserverState, RunPlan, RunRecord, RunState, record_of, vehicles_on_road
from surrogate.loop.several_subjects import all_have_left, perceive_all
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import World
from surrogate.road.perception import PerceptionFrame, Sensor, blank_frame
from surrogate.road.traffic_state import TrafficState
from surrogate.xla.materialise import materialise
from surrogate.xla.tiles import tiles_for


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
    """Records of a batch of runs, each from its beginning to its end.

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
    runs = at_start(worlds, axes, sensor, observer, plan, states)
    firsts_s = jnp.broadcast_to(first_frame_s, runs.is_over.shape)
    return go_on(runs, worlds, axes, sensor, observer, plan, firsts_s, end_s, jnp.zeros((), jnp.int32)).record


def at_start(
    worlds: World, axes: World, sensor: Sensor, observer: Observer, plan: RunPlan, states: TrafficState | None = None
) -> RunState:
    """State of runs at time 0; for the arguments see `observe_batch`."""
    num_runs = worlds.seed.shape[0]

    def first(world: World) -> TrafficState:
        return initial_state(world, plan.capacity, plan.clock)

    if states is None:
        states = jax.vmap(first, in_axes=(axes,), axis_size=num_runs)(worlds)
    start = observer.start()
    if worlds.effects is not None:
        start = start, start_of_sensing(blank_frame(worlds.road, sensor))
    leading = num_runs, *states.subject_inserted.shape[1:]
    observed = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (*leading, *jnp.shape(leaf))), start)
    seen = _finished(observer, observed if worlds.effects is None else observed[0], len(leading))
    record = record_of(states, seen, vehicles_on_road(states), jnp.zeros((num_runs,), jnp.int32))
    return RunState(states, observed, record, jnp.zeros((num_runs,), bool))


def go_on(
    runs: RunState,
    worlds: World,
    axes: World,
    sensor: Sensor,
    observer: Observer,
    plan: RunPlan,
    first_frame_s: Float[Array, " run"],
    end_s: Float[Array, ""],
    most_unfinished: Int[Array, ""],
) -> RunState:
    """State of the runs when all but a few have ended.

    What a run comes to does not depend on when it is interrupted, nor on the runs beside it.

    Args:
        runs: where they are.
        worlds: the runs; see `observe_batch` for this and what is not told here.
        axes: which leaves of them differ.
        sensor: the subject vehicles' sensors.
        observer: fold over their frames.
        plan: step lengths and room.
        first_frame_s: frames begin after this time, for each run.
        end_s: runs end then at the latest.
        most_unfinished: so many runs may be left.
    """
    loop = _Loop(worlds, axes, sensor, observer, plan, end_s)
    clock, frames = plan.clock, plan.frames

    def cycle(is_on: Bool[Array, " run"], is_seen: Bool[Array, ""], states: TrafficState, observed: Any) -> Any:
        # no condition differs between runs, so branches are skipped; nor does num_tiles
        num_tiles = tiles_for(jnp.max(is_on * states.head[:, -1]) + most_newcomers, plan.capacity)
        for _more in range(frames.decisions_per_frame - 1):
            states = loop.settle(loop.move(states, frames.steps_before, num_tiles), is_seen, num_tiles)
            states = loop.move(states, frames.steps_after, num_tiles)
        states = loop.settle(loop.move(states, frames.steps_before, num_tiles), is_seen, num_tiles)

        def to_frame(number: Int[Array, ""], carry: tuple[TrafficState, ObserverState]) -> Any:
            states, observed = carry
            # one loop for any number of steps, so that a run is the same to the bit, seen or not
            steps_seen = jnp.where(number == 0, frames.steps_after, plan.steps_per_frame)
            num_steps = jnp.where(is_seen, steps_seen, frames.steps_unseen)
            states = loop.move(states, num_steps, num_tiles, frames.steps_unseen)
            unseen = states.vehicles.track, states.num_tracks, observed
            track, num_tracks, observed = jax.lax.cond(
                is_seen,
                lambda: jax.vmap(loop.see, in_axes=(0, 0, axes))(states, observed, worlds),
                lambda: unseen,
            )
            return eqx.tree_at(lambda s: (s.vehicles.track, s.num_tracks), states, (track, num_tracks)), observed

        return jax.lax.fori_loop(0, jnp.where(is_seen, frames.frames_per_decision, 1), to_frame, (states, observed))

    def block(runs: RunState) -> RunState:
        record = runs.record
        is_on = ~runs.is_over
        is_seen = jnp.any(is_on & (runs.states.step >= first_seen_step))
        states, observed = jax.lax.fori_loop(
            0, frames.cycles_per_block, lambda _, carry: cycle(is_on, is_seen, *carry), (runs.states, runs.observed)
        )
        num_vehicle_steps = record.num_vehicle_steps + frames.steps_per_block * vehicles_on_road(states)
        later = record_of(states, record.observed, record.num_on_road, num_vehicle_steps)
        record = jax.tree.map(
            lambda old, new: jnp.where(runs.is_over.reshape(-1, *[1] * (new.ndim - 1)), old, new), record, later
        )
        is_late = states.step.astype(jnp.float32) * clock.step_s >= end_s
        # a run that has lost a vehicle is worth nothing any more
        has_left = all_have_left(states.subject_left)
        is_over = runs.is_over | has_left | is_late | (states.num_lost > 0)
        return RunState(states, observed, record, is_over)

    def is_short(runs: RunState) -> Bool[Array, ""]:
        return jnp.sum(~runs.is_over) > most_unfinished

    most_newcomers = frames.decisions_per_frame * jnp.sum(worlds.inflow.lane_row >= 0)
    # whole blocks are seen or not, so that a run sees the same frames in whichever batch it is
    first_seen_block = jnp.floor(first_frame_s / clock.step_s / frames.steps_per_block)
    first_seen_step = first_seen_block.astype(jnp.int32) * frames.steps_per_block
    runs = jax.lax.while_loop(is_short, block, runs)
    observed = runs.observed if worlds.effects is None else runs.observed[0]
    seen = _finished(observer, observed, runs.states.subject_inserted.ndim)
    return eqx.tree_at(lambda r: r.record.observed, runs, seen)


class _Loop(NamedTuple):
    """What is done again and again with a batch of runs; for the fields see `observe_batch`."""

    worlds: World
    axes: World
    sensor: Sensor
    observer: Observer
    plan: RunPlan
    end_s: Float[Array, ""]

    def move(
        self,
        states: TrafficState,
        num_steps: int | Int[Array, ""],
        num_tiles: Int[Array, ""],
        most_steps: int | None = None,
    ) -> TrafficState:
        """Let time pass on all roads."""

        def move_one(state: TrafficState, world: World) -> TrafficState:
            return move_on(state, world, self.plan.clock.step_s, num_steps, num_tiles, most_steps)

        return jax.vmap(move_one, in_axes=(0, self.axes))(states, self.worlds)

    def settle(self, states: TrafficState, plans: Bool[Array, ""], num_tiles: Int[Array, ""]) -> TrafficState:
        """Make a decision on all roads."""

        def settle_one(state: TrafficState, world: World) -> TrafficState:
            return settle_lanes(state, world, self.plan.clock, num_tiles, plans)

        return jax.vmap(settle_one, in_axes=(0, self.axes))(states, self.worlds)

    def see(self, state: TrafficState, observed: ObserverState, world: World) -> tuple[Array, Array, ObserverState]:
        """Tracks, their number and what the observer has seen after one more frame of one run."""
        has_effects = world.effects is not None
        observed, sensor_memory = observed if has_effects else (observed, {})
        step_s = self.plan.clock.step_s
        time_s = state.step.astype(jnp.float32) * step_s
        with jax.named_scope("perceive"):
            state, frame, entry = perceive_all(state, world, self.sensor, time_s)
        in_time = time_s <= self.end_s + 0.5 * step_s
        frame = eqx.tree_at(lambda f: f.valid, frame, frame.valid & in_time)

        # sensors work all along, whatever is kept of what they tell
        is_kept = None
        if world.recorded_m is not None:
            is_kept = is_recorded(world.recorded_m, frame.subject_position_m)

        def watch(frame: PerceptionFrame, entry: Array, observed: ObserverState, memory: Any, is_kept: Any) -> Any:
            if world.effects is not None:
                with jax.named_scope("sense"):
                    frame = show_lane_changes(world.effects, frame, state.vehicles, entry)
                    frame, memory = sense_frame(world.effects, frame, memory, world.seed)
            if is_kept is not None:
                frame = eqx.tree_at(lambda f: f.valid, frame, frame.valid & is_kept)
            with jax.named_scope("observe"):
                # a program of its own, which rounds alike whatever made the frame
                return self.observer.update(observed, materialise(frame)), memory

        if world.subject.num_subjects:
            watch = jax.vmap(watch)
        observed, sensor_memory = watch(frame, entry, observed, sensor_memory, is_kept)
        return state.vehicles.track, state.num_tracks, (observed, sensor_memory) if has_effects else observed


def _finished(observer: Observer, observed: ObserverState, num_axes: int) -> Array:
    """What drives come to; runs, and subject vehicles if there are several, are leading axes."""
    finish = jax.vmap(observer.finish)
    return (jax.vmap(finish) if num_axes > 1 else finish)(observed)
