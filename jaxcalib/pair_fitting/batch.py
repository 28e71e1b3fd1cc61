"""Many pairs as arrays of one shape, and the misfit of their gaps with its derivatives.

The loop over time ends with the longest pair of a batch, so that one program serves batches of any length; it adds up
what a least-squares step needs and stores nothing of the way.
"""

import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair
from surrogate.model_entry import ModelEntry
from surrogate.replay import LeaderMotion, ReplayState, follow

DESIRED_SPEED = "desired_speed_mps"
SLOWEST_DESIRED_MPS, FASTEST_DESIRED_MPS = 3.0, 45.0
UNIFORM = 0.5  # drivers' random numbers: all are the middle one
SMALLEST_GAP_M = 0.5  # below it an error counts as at this gap


class PairBatch(eqx.Module):
    """Pairs side by side; after its end a pair weighs nothing.

    Attributes:
        leader_mps: [step, pair].
        leader_acceleration_mps2: [step, pair].
        leader_advance_m: [step, pair].
        gap_m: recorded, [step, pair].
        weight: of each squared error of a gap, 1 / m^2, [step, pair].
        first: follower at the beginning.
        num_steps: steps of the longest pair.
    """

    leader_mps: Array
    leader_acceleration_mps2: Array
    leader_advance_m: Array
    gap_m: Array
    weight: Array
    first: ReplayState
    num_steps: Int[Array, ""]


class Misfit(eqx.Module):
    """How far simulated gaps are from the recorded ones, in units of their weights.

    Attributes:
        total: sum of squared residuals: the square of the mixed error.
        gradient: half its derivative with respect to the point of the unit cube.
        product: the residuals' slopes, transposed, times themselves.
        lag_product: sum of products of neighbouring residuals.
        smallest_gap_m: of the simulated follower.
    """

    total: Float[Array, " pair"]
    gradient: Float[Array, "parameter pair"]
    product: Float[Array, "parameter parameter pair"]
    lag_product: Float[Array, " pair"]
    smallest_gap_m: Float[Array, " pair"]


def pair_batch(pairs: Sequence[RecordedPair], length: int) -> PairBatch:
    """Return pairs as arrays.

    Args:
        pairs: the pairs.
        length: of the arrays, at least that of the longest pair.

    The weights make the sum of squares the square of the mixed error: Kesting & Treiber (2008), Transp. Res. Rec.
    2088, eq. (12): errors relative to the geometric mean of the recorded gap and its mean.
    """

    def padded(values: list[np.ndarray], fill_last: bool = True) -> Array:
        columns = [np.pad(one, (0, length - len(one)), mode="edge" if fill_last else "constant") for one in values]
        return jnp.asarray(np.stack(columns, axis=1), jnp.float32)

    weights = []
    for pair in pairs:
        gap = np.maximum(pair.gap_m, SMALLEST_GAP_M)
        weights.append(1.0 / (gap * gap.mean()) / len(pair))
    follower = [pair.follower_mps[0] for pair in pairs]
    accelerations = [np.append(0.0, np.diff(pair.leader_mps) / STEP_S) for pair in pairs]
    return PairBatch(
        leader_mps=padded([pair.leader_mps for pair in pairs]),
        leader_acceleration_mps2=padded(accelerations, fill_last=False),
        leader_advance_m=padded([pair.leader_advance_m for pair in pairs], fill_last=False),
        gap_m=padded([pair.gap_m for pair in pairs]),
        weight=padded(weights, fill_last=False),
        first=ReplayState(
            jnp.asarray(follower, jnp.float32),
            jnp.zeros(len(pairs), jnp.float32),
            jnp.asarray([pair.gap_m[0] for pair in pairs], jnp.float32),
        ),
        num_steps=jnp.asarray(max(len(pair) for pair in pairs), jnp.int32),
    )


class Bounds(eqx.Module):
    """Ranges of what is fitted: the model's parameters, then the desired speed."""

    lower: Float[Array, " parameter"]
    upper: Float[Array, " parameter"]

    def values(self, unit: Float[Array, "... parameter"]) -> Float[Array, "... parameter"]:
        """Return values for points of the unit cube."""
        return self.lower + unit * (self.upper - self.lower)


def bounds_of(entry: ModelEntry) -> Bounds:
    """Return the ranges of a model."""
    lower = [one.lower for one in entry.parameters] + [SLOWEST_DESIRED_MPS]
    upper = [one.upper for one in entry.parameters] + [FASTEST_DESIRED_MPS]
    return Bounds(jnp.asarray(lower, jnp.float32), jnp.asarray(upper, jnp.float32))


def misfit(
    entry: ModelEntry, bounds: Bounds, unit: Float[Array, "pair parameter"], batch: PairBatch
) -> Float[Array, " pair"]:
    """Return the squared mixed error of each pair's simulated gap.

    The follower begins where the recorded one does and then sees only its leader and its own past (closed loop).
    """

    def step(time: Int[Array, ""], carry: tuple[ReplayState, Array]) -> tuple[ReplayState, Array]:
        state, total = carry
        return _follow(entry, bounds, unit, batch, time, state), total + _residual(batch, time, state.gap_m) ** 2

    start = batch.first, jnp.zeros_like(batch.first.gap_m)
    return jax.lax.fori_loop(0, batch.num_steps, step, start)[1]


def misfit_and_slopes(
    entry: ModelEntry, bounds: Bounds, unit: Float[Array, "pair parameter"], batch: PairBatch
) -> Misfit:
    """Return the misfit of each pair with its exact derivatives, by forward differentiation along the closed loop."""
    num_pairs, num_parameters = unit.shape
    directions = jnp.broadcast_to(jnp.eye(num_parameters, dtype=unit.dtype)[:, None], (num_parameters, *unit.shape))
    nothing = jnp.zeros((num_pairs,), jnp.float32)

    def step(time: Int[Array, ""], carry: tuple[ReplayState, ReplayState, Array, Misfit]) -> Any:
        state, tangents, last, found = carry
        residual = _residual(batch, time, state.gap_m)
        slope = jnp.sqrt(batch.weight[time]) * tangents.gap_m

        def along(tangent: ReplayState, direction: Array) -> ReplayState:
            advance = functools.partial(_follow, entry, bounds, batch=batch, time=time)
            return jax.jvp(lambda s, u: advance(unit=u, state=s), (state, unit), (tangent, direction))[1]

        later = Misfit(
            total=found.total + residual**2,
            gradient=found.gradient + slope * residual,
            product=found.product + slope[:, None] * slope[None],
            lag_product=found.lag_product + residual * last,
            smallest_gap_m=jnp.where(
                batch.weight[time] > 0.0, jnp.minimum(found.smallest_gap_m, state.gap_m), found.smallest_gap_m
            ),
        )
        moved = _follow(entry, bounds, unit, batch, time, state)
        return moved, jax.vmap(along)(tangents, directions), residual, later

    first = Misfit(
        total=nothing,
        gradient=jnp.zeros((num_parameters, num_pairs)),
        product=jnp.zeros((num_parameters, num_parameters, num_pairs)),
        lag_product=nothing,
        smallest_gap_m=jnp.full((num_pairs,), jnp.inf),
    )
    still = jax.tree.map(lambda leaf: jnp.zeros((num_parameters, *leaf.shape), leaf.dtype), batch.first)
    return jax.lax.fori_loop(0, batch.num_steps, step, (batch.first, still, nothing, first))[3]


def _residual(batch: PairBatch, time: Int[Array, ""], gap_m: Array) -> Array:
    return jnp.sqrt(batch.weight[time]) * (gap_m - batch.gap_m[time])


def _follow(
    entry: ModelEntry, bounds: Bounds, unit: Array, batch: PairBatch, time: Int[Array, ""], state: ReplayState
) -> ReplayState:
    """Return the followers one step later, each with parameters of its own."""
    values = bounds.values(unit)
    model = entry.build({one.name: values[:, place] for place, one in enumerate(entry.parameters)})
    leader = LeaderMotion(batch.leader_mps[time], batch.leader_acceleration_mps2[time], batch.leader_advance_m[time])
    return follow(model, state, leader, values[:, -1], jnp.full_like(leader.speed_mps, UNIFORM), STEP_S)
