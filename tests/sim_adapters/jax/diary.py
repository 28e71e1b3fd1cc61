"""An observer that is small: eight numbers in which every frame and every vehicle seen has a part."""

import equinox as eqx
import jax
import jax.numpy as jnp

from surrogate.road.perception import PerceptionFrame

LENGTH_M = 4.8


class Diary(eqx.Module):
    """Writes down what depends on every vehicle around, and the smallest gap between two in one row."""

    def start(self) -> jax.Array:
        return jnp.asarray([0.0, 0.0, 0.0, 0.0, 0.0, jnp.inf, -jnp.inf, jnp.inf], jnp.float32)

    def update(self, state: jax.Array, frame: PerceptionFrame) -> jax.Array:
        there = frame.object_valid
        pair = there[:-1] & there[1:] & (frame.object_row[:-1] == frame.object_row[1:])
        gap = frame.object_offset_m[:-1] - LENGTH_M - frame.object_offset_m[1:]
        sums = state[:5] + jnp.stack(
            [
                jnp.ones(()),
                jnp.sum(there),
                frame.subject_speed_mps,
                jnp.sum(jnp.where(there, frame.object_speed_mps, 0.0)),
                jnp.sum(frame.object_offset_m * (1.0 + frame.object_row)),
            ]
        )
        bounds = jnp.stack(
            [
                jnp.minimum(state[5], frame.time_s),
                jnp.maximum(state[6], frame.time_s),
                jnp.minimum(state[7], jnp.min(jnp.where(pair, gap, jnp.inf))),
            ]
        )
        return jnp.where(frame.valid, jnp.concatenate([sums, bounds]), state)

    def finish(self, state: jax.Array) -> jax.Array:
        # a drive without any frame has no smallest gap
        return jnp.where(state[0] > 0, state, 0.0)
