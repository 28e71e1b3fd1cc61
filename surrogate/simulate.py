"""Runs the road from empty to the subject vehicle's arrival, folding an observer over what it detects.

Nothing of the way is stored: the observer, given by the caller, turns each frame into its own small state.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.perception import PerceptionFrame, Sensor, perceive
from surrogate.step import Clock, World, advance, initial_state
from surrogate.traffic_state import TrafficState

ObserverState = Any


class Observer(eqx.Module):
    """A fold over perception frames.

    Attributes:
        initial: state before the first frame.
        update: (state, frame) -> state; frames that are not valid must leave the state as it is.
    """

    initial: ObserverState
    update: Callable[[ObserverState, PerceptionFrame], ObserverState] = eqx.field(static=True)


class RunRecord(eqx.Module):
    """What is left of a run.

    Attributes:
        observed: final state of the observer.
        num_arrived: vehicles that asked to enter, per entrance.
        num_inserted: vehicles that entered, per entrance.
        num_on_road: vehicles on the road at the end.
        num_collisions: vehicle steps with overlapping vehicles.
        num_lost: newcomers that found the arrays full; a run with any is not valid.
        num_lane_changes: lane changes on the whole road by reason.
        subject_left: whether the subject vehicle reached its destination.
        end_s: when the run ended.
    """

    observed: ObserverState
    num_arrived: Int[Array, " entrance"]
    num_inserted: Int[Array, " entrance"]
    num_on_road: Int[Array, ""]
    num_collisions: Int[Array, ""]
    num_lost: Int[Array, ""]
    num_lane_changes: Int[Array, " reason"]
    subject_left: Array
    end_s: Float[Array, ""]


def warm_up(world: World, capacity: int, clock: Clock, num_decisions: int) -> TrafficState:
    """Return the state after `num_decisions` decision intervals from an empty road."""

    def body(_: int, state: TrafficState) -> TrafficState:
        return advance(state, world, clock)

    return jax.lax.fori_loop(0, num_decisions, body, initial_state(world, capacity))


def observe(
    state: TrafficState,
    observed: ObserverState,
    world: World,
    sensor: Sensor,
    clock: Clock,
    observer: Observer,
    num_decisions: int,
) -> tuple[TrafficState, ObserverState]:
    """Return state and observer after `num_decisions` more intervals, each ending with a frame."""

    def body(_: int, carry: tuple[TrafficState, ObserverState]) -> tuple[TrafficState, ObserverState]:
        state, observed = carry
        state = advance(state, world, clock)
        time_s = state.step.astype(jnp.float32) * clock.step_s
        with jax.named_scope("perceive"):
            state, frame = perceive(state, world.road, sensor, len(world.classes) - 1, time_s)
        with jax.named_scope("observe"):
            observed = observer.update(observed, frame)
        return state, observed

    return jax.lax.fori_loop(0, num_decisions, body, (state, observed))


def record(state: TrafficState, observed: ObserverState, clock: Clock) -> RunRecord:
    """Return what is left of a run."""
    return RunRecord(
        observed=observed,
        num_arrived=state.num_arrived,
        num_inserted=state.num_inserted,
        num_on_road=state.head[-1] - (state.head.shape[0] - 1),
        num_collisions=state.num_collisions,
        num_lost=state.num_lost,
        num_lane_changes=state.num_lane_changes,
        subject_left=state.subject_left,
        end_s=state.step.astype(jnp.float32) * clock.step_s,
    )
