"""The state of a batch of runs: what is known of them by now, and all that it takes to go on with them."""

from typing import Any, NamedTuple, Protocol

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from surrogate.loop.world import Clock
from surrogate.road.perception import PerceptionFrame
from surrogate.road.traffic_state import TrafficState

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
        """Result of the drive."""
        ...


class RunRecord(eqx.Module):
    """What is left of a run, up to the end of the block in which its subject vehicle arrives.

    What happens later depends on how long others of the batch drive, and is nobody's business.
    """

    observed: Array  # what the observer made of the drive; of each drive if there are several subject vehicles
    num_arrived: Int[Array, " entrance"]  # vehicles that asked to enter, per entrance
    num_inserted: Int[Array, " entrance"]  # vehicles that entered, per entrance
    num_on_road: Int[Array, ""]  # most vehicles on the road at once, sampled at each block's end
    num_vehicle_steps: Int[Array, ""]  # vehicles on the road, summed over steps; counted at the ends of blocks
    num_collisions: Int[Array, ""]  # vehicle steps with overlapping vehicles
    # steps in which a subject vehicle that repeats its log overlaps another vehicle
    num_subject_overlaps: Int[Array, ""]
    num_lost: Int[Array, ""]  # newcomers that found the arrays full; a run with any is not valid
    num_lane_changes: Int[Array, " reason"]  # lane changes on the whole road by reason
    # whether the subject vehicle, each of them if there are several, found its way onto the road
    subject_entered: Bool[Array, "*subject"]
    subject_left: Bool[Array, "*subject"]  # whether it reached its destination
    is_finite: Bool[Array, ""]  # whether all positions and speeds are finite at the end


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

    @property
    def frames(self) -> "FramePlan":
        """How steps, decisions and frames interleave."""
        per_decision, per_frame = self.clock.steps_per_decision, self.steps_per_frame
        per_cycle, steps_before = max(per_frame, per_decision), self.steps_before_decision
        return FramePlan(
            decisions_per_frame=max(1, per_frame // per_decision),
            frames_per_decision=max(1, per_decision // per_frame),
            steps_before=steps_before,
            steps_after=min(per_frame, per_decision) - steps_before,
            cycles_per_block=max(1, round(self.block_s / self.clock.step_s / per_cycle)),
            steps_per_cycle=per_cycle,
            steps_per_frame=per_frame,
        )


class FramePlan(NamedTuple):
    """How steps, decisions and frames interleave; a cycle ends with a frame, a block is a number of cycles."""

    decisions_per_frame: int  # decisions from one frame to the next; 1 if frames are more frequent
    frames_per_decision: int  # frames from one decision to the next; 1 if decisions are more frequent
    steps_before: int  # steps from a frame to the decision
    steps_after: int  # steps from there to the next frame or, if it is farther, the next decision's part
    cycles_per_block: int  # cycles in a block
    steps_per_cycle: int  # steps in a cycle
    steps_per_frame: int  # steps from frame to frame

    @property
    def steps_per_block(self) -> int:
        """Steps in a block."""
        return self.cycles_per_block * self.steps_per_cycle

    @property
    def steps_unseen(self) -> int:
        """Steps from a decision to the end of its cycle."""
        return self.steps_after + (self.frames_per_decision - 1) * self.steps_per_frame


class RunState(eqx.Module):
    """State of a batch of runs. All leaves have a leading axis for runs, and one run's part stands for itself."""

    states: TrafficState  # their roads
    # what the observer has seen so far, and what the sensors remember where effects are modelled
    observed: ObserverState
    record: RunRecord  # what is known of the runs by now
    is_over: Bool[Array, " run"]  # which of them have ended


def record_of(
    states: TrafficState, observed: Array, num_on_road: Int[Array, " run"], num_vehicle_steps: Int[Array, " run"]
) -> RunRecord:
    """Record of runs so far.

    Args:
        states: their roads.
        observed: what the observer made of the drives.
        num_on_road: most vehicles on the road at once before.
        num_vehicle_steps: vehicle steps by now.
    """
    overlaps = states.num_subject_overlaps
    return RunRecord(
        observed=observed,
        num_arrived=states.num_arrived,
        num_inserted=states.num_inserted,
        num_on_road=jnp.maximum(num_on_road, vehicles_on_road(states)),
        num_vehicle_steps=num_vehicle_steps,
        num_collisions=states.num_collisions,
        num_subject_overlaps=jnp.zeros_like(states.step) if overlaps is None else overlaps,
        num_lost=states.num_lost,
        num_lane_changes=states.num_lane_changes,
        subject_entered=states.subject_inserted,
        subject_left=states.subject_left,
        is_finite=jnp.all(jnp.isfinite(states.vehicles.speed_mps), axis=1),
    )


def vehicles_on_road(states: TrafficState) -> Int[Array, " run"]:
    """Number of vehicles on the road of each run."""
    return states.head[:, -1] - (states.head.shape[1] - 1)
