"""An observer that writes down each frame, and the corridor's engine with it: one program for the tests that run it."""

import equinox as eqx
import jax
import jax.numpy as jnp

from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.loop.world import Clock
from surrogate.road.perception import PerceptionFrame, Sensor

END_S, FRAME_S = 260.0, 0.5
NUM_FRAMES = round(END_S / FRAME_S) + 1
AHEAD_M, BEHIND_M, OBJECTS_PER_ROW = 140.0, 110.0, 24
LENGTH_M, NOWHERE_M = 4.8, 1e6
COLUMNS = (
    "time", "position", "speed", "objects", "offsets", "speeds", "rows", "lateral", "smallest_gap", "others",
    "others_offsets", "largest_track",
)  # fmt: skip
COLUMN = {name: number for number, name in enumerate(COLUMNS)}
OFFSETS = slice(len(COLUMNS), None)


class FrameTrace(eqx.Module):
    """Writes each frame into the row of its time: sums in which every bit of it counts, and where others are.

    `others` are the objects that are no subject vehicles. Behind the columns of sums come their offsets, `NOWHERE_M`
    where there is none.
    """

    num_objects: int = eqx.field(static=True)

    def start(self) -> jax.Array:
        return jnp.zeros((NUM_FRAMES, len(COLUMNS) + self.num_objects), jnp.float32)

    def update(self, state: jax.Array, frame: PerceptionFrame) -> jax.Array:
        weight = 1.0 + 0.37 * jnp.arange(frame.object_valid.shape[0])
        there = jnp.where(frame.object_valid, weight, 0.0)
        others = frame.object_valid & ~frame.object_is_subject
        pair = frame.object_valid[:-1] & frame.object_valid[1:] & (frame.object_row[:-1] == frame.object_row[1:])
        gap_m = frame.object_offset_m[:-1] - LENGTH_M - frame.object_offset_m[1:]
        sums = jnp.stack(
            [
                frame.time_s,
                frame.subject_position_m,
                frame.subject_speed_mps,
                jnp.sum(frame.object_valid, dtype=jnp.float32),
                jnp.sum(there * frame.object_offset_m),
                jnp.sum(there * frame.object_speed_mps),
                jnp.sum(there * frame.object_row),
                jnp.sum(there * frame.object_lateral_m),
                jnp.min(jnp.where(pair, gap_m, NOWHERE_M)),
                jnp.sum(others, dtype=jnp.float32),
                jnp.sum(jnp.where(others, frame.object_offset_m * (1.0 + frame.object_row), 0.0)),
                jnp.max(jnp.where(others, frame.object_track, -1)).astype(jnp.float32),
            ]
        )
        row = jnp.concatenate([sums, jnp.where(others, frame.object_offset_m, NOWHERE_M)])
        number = jnp.round(frame.time_s / FRAME_S).astype(jnp.int32)
        return jnp.where(frame.valid, state.at[number].set(row), state)

    def finish(self, state: jax.Array) -> jax.Array:
        return state


def corridor_engine(
    template: WorldTemplate, clock: Clock | None = None, capacity: int = 300, runs_per_device: int = 3
) -> JaxSimulator:
    return JaxSimulator(
        template=template,
        observer=FrameTrace(template.road.num_rows * OBJECTS_PER_ROW),
        sensor=Sensor(jnp.asarray(AHEAD_M, jnp.float32), jnp.asarray(BEHIND_M, jnp.float32), OBJECTS_PER_ROW),
        clock=clock or Clock(step_s=0.1, steps_per_decision=10),
        end_s=END_S,
        capacity=capacity,
        runs_per_device=runs_per_device,
    )
