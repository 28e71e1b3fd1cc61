"""Many pairs as arrays of one shape, and the misfit of their gaps with its derivatives.

Drives of any length are cut into pieces of one number of steps, so that one program serves them all; from piece to
piece the followers and the sums so far are handed on. Nothing is stored of the way.
"""

import functools
from collections.abc import Iterable, Sequence
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxcalib.pair_fitting.recorded_pairs import STEP_S, RecordedPair
from surrogate.car_following.replay import LeaderMotion, ReplayState, after_speed, follow
from surrogate.vehicle.model_entry import ModelEntry
from surrogate.xla.materialise import materialise

DESIRED_SPEED = "desired_speed_mps"
SLOWEST_DESIRED_MPS, FASTEST_DESIRED_MPS = 3.0, 45.0
UNIFORM = 0.5  # drivers' random numbers: all are the middle one
SMALLEST_GAP_M = 0.5  # below it an error counts as at this gap
PIECE_STEPS = 512


class Piece(eqx.Module):
    """Some steps of pairs side by side; after its end a pair weighs nothing."""

    leader_mps: Array  # [step, pair]
    leader_acceleration_mps2: Array  # [step, pair]
    leader_advance_m: Array  # [step, pair]
    gap_m: Array  # recorded, [step, pair]
    weight: Array  # of each squared error of a gap, 1 / m^2, [step, pair]
    num_steps: Int[Array, ""]  # steps of the longest pair in this piece


class PairBatch(eqx.Module):
    """Pairs side by side."""

    first: ReplayState  # followers at the beginning, [pair]
    pieces: tuple[Piece, ...]  # one after the other


class Misfit(eqx.Module):
    """How far simulated gaps are from the recorded ones, in units of their weights."""

    total: Float[Array, " pair"]  # sum of squared residuals: the square of the mixed error
    gradient: Float[Array, "parameter pair"]  # half its derivative with respect to the point of the unit cube
    product: Float[Array, "parameter parameter pair"]  # the residuals' slopes, transposed, times themselves
    lag_product: Float[Array, " pair"]  # sum of products of neighbouring residuals
    smallest_gap_m: Float[Array, " pair"]  # of the simulated follower


def pair_batch(
    pairs: Sequence[RecordedPair], lanes: np.ndarray | None = None, piece_steps: int = PIECE_STEPS
) -> PairBatch:
    """Return pairs as arrays.

    Args:
        pairs: the pairs.
        lanes: place of a pair for each lane of the arrays; None for each pair once.
        piece_steps: steps of a piece.

    The weights make the sum of squares the square of the mixed error: Kesting & Treiber (2008), Transp. Res. Rec.
    2088, eq. (12): errors relative to the geometric mean of the recorded gap and its mean.
    """
    longest = max(len(pair) for pair in pairs)
    num_pieces = -(-longest // piece_steps)

    def padded(values: Iterable[np.ndarray], mode: Literal["edge", "constant"]) -> np.ndarray:
        length = num_pieces * piece_steps
        columns = [np.pad(column, (0, length - len(column)), mode=mode) for column in values]
        stacked = np.stack(columns, axis=1).astype(np.float32)
        return stacked if lanes is None else stacked[:, lanes]

    weights = []
    for pair in pairs:
        gap = recorded_gap_m(pair)
        weights.append(1.0 / (gap * gap.mean()) / len(pair))
    leader_mps = padded((pair.leader_mps for pair in pairs), "edge")
    acceleration_mps2 = padded((np.append(0.0, np.diff(pair.leader_mps) / STEP_S) for pair in pairs), "constant")
    advance_m = padded((pair.leader_advance_m for pair in pairs), "constant")
    gap_m = padded((pair.gap_m for pair in pairs), "edge")
    weight = padded(weights, "constant")
    pieces = []
    for begin in range(0, longest, piece_steps):
        at = slice(begin, begin + piece_steps)
        pieces.append(
            Piece(
                leader_mps=single(leader_mps[at]),
                leader_acceleration_mps2=single(acceleration_mps2[at]),
                leader_advance_m=single(advance_m[at]),
                gap_m=single(gap_m[at]),
                weight=single(weight[at]),
                num_steps=jax.device_put(np.int32(min(piece_steps, longest - begin))),
            )
        )
    speed = np.asarray([pair.follower_mps[0] for pair in pairs])
    gap = np.asarray([pair.gap_m[0] for pair in pairs])
    if lanes is not None:
        speed, gap = speed[lanes], gap[lanes]
    first = ReplayState(single(speed), single(np.zeros_like(speed)), single(gap))
    return PairBatch(first, tuple(pieces))


def recorded_gap_m(pair: RecordedPair) -> Float[np.ndarray, " step"]:
    """Return the gaps that errors are relative to."""
    return np.maximum(pair.gap_m, SMALLEST_GAP_M)


def single(values: np.ndarray) -> Array:
    """Return values in single precision where programs want them.

    `jnp.asarray` and its like would compile a program for each shape; together they took longer than a search.
    """
    return jax.device_put(np.asarray(values, np.float32))


class Bounds(eqx.Module):
    """Ranges of what is fitted: the model's parameters, then the desired speed."""

    lower: Float[Array, " parameter"]
    upper: Float[Array, " parameter"]

    def values(self, unit: Float[Array, "... parameter"]) -> Float[Array, "... parameter"]:
        """Return values for points of the unit cube."""
        return self.lower + unit * (self.upper - self.lower)


def bounds_of(entry: ModelEntry) -> Bounds:
    """Return the ranges of a model."""
    lower = [parameter.lower for parameter in entry.parameters] + [SLOWEST_DESIRED_MPS]
    upper = [parameter.upper for parameter in entry.parameters] + [FASTEST_DESIRED_MPS]
    return Bounds(single(np.asarray(lower)), single(np.asarray(upper)))


def misfit(
    entry: ModelEntry, bounds: Bounds, units: Float[Array, "parameter point pair"], batch: PairBatch
) -> Float[Array, "point pair"]:
    """Return the squared mixed error of each pair's simulated gap at each point of the unit cube.

    The follower begins where the recorded one does and then sees only its leader and its own past (closed loop).
    """
    shape = units.shape[1:]
    state = jax.tree.map(lambda leaf: jax.device_put(np.broadcast_to(np.asarray(leaf), shape)), batch.first)
    total = jax.device_put(np.zeros(shape, units.dtype))
    for piece in batch.pieces:
        state, total = _misfit_of_piece(entry, bounds, units, piece, (state, total))
    return total


def misfit_and_slopes(
    entry: ModelEntry, bounds: Bounds, unit: Float[Array, "parameter pair"], batch: PairBatch
) -> Misfit:
    """Return the misfit of each pair with its exact derivatives, by forward differentiation along the closed loop."""
    num_parameters, num_pairs = unit.shape
    nothing, flat = jax.device_put((np.zeros(num_pairs, unit.dtype), np.zeros(unit.shape, unit.dtype)))
    product = jax.device_put(np.zeros((num_parameters, *unit.shape), unit.dtype))
    found = Misfit(nothing, flat, product, nothing, jax.device_put(np.full(num_pairs, np.inf, unit.dtype)))
    carry = batch.first, ReplayState(flat, flat, flat), nothing, found
    for piece in batch.pieces:
        carry = _slopes_of_piece(entry, bounds, unit, piece, carry)
    return carry[3]


@functools.partial(jax.jit, static_argnums=0)
def _misfit_of_piece(
    entry: ModelEntry, bounds: Bounds, units: Array, piece: Piece, before: tuple[ReplayState, Array]
) -> tuple[ReplayState, Array]:
    def step(time: Int[Array, ""], carry: tuple[ReplayState, Array]) -> tuple[ReplayState, Array]:
        state, total = carry
        return _follow(entry, bounds, units, piece, time, state), total + _residual(piece, time, state.gap_m) ** 2

    return jax.lax.fori_loop(0, piece.num_steps, step, before)


Sums = tuple[ReplayState, ReplayState, Array, Misfit]


@functools.partial(jax.jit, static_argnums=0)
def _slopes_of_piece(entry: ModelEntry, bounds: Bounds, unit: Array, piece: Piece, before: Sums) -> Sums:
    """Return the followers after a piece, their tangents, their last residuals, and the sums so far.

    A step's new speed is differentiated once, backwards, with respect to all that it depends on; each parameter's
    tangent then takes three products. (Forward differentiation of the whole step did the model's arithmetic again for
    each parameter and took twice as long.)
    """

    def step(time: Int[Array, ""], carry: Sums) -> Sums:
        state, tangents, last, found = carry
        residual = _residual(piece, time, state.gap_m)
        slope = jnp.sqrt(piece.weight[time]) * tangents.gap_m
        moved, backwards = jax.vjp(lambda s, u: _follow(entry, bounds, u, piece, time, s).speed_mps, state, unit)
        speed, by_state, by_parameter = materialise((moved, *backwards(jnp.ones_like(moved))))
        speed_slope = materialise(
            by_parameter
            + by_state.speed_mps * tangents.speed_mps
            + by_state.acceleration_mps2 * tangents.acceleration_mps2
            + by_state.gap_m * tangents.gap_m
        )
        is_within = piece.weight[time] > 0.0
        later = Misfit(
            total=found.total + residual**2,
            gradient=found.gradient + slope * residual,
            product=found.product + slope[:, None] * slope[None],
            lag_product=found.lag_product + residual * last,
            smallest_gap_m=jnp.where(is_within, jnp.minimum(found.smallest_gap_m, state.gap_m), found.smallest_gap_m),
        )
        return (
            after_speed(state, speed, piece.leader_advance_m[time], STEP_S),
            after_speed(tangents, speed_slope, jnp.zeros_like(speed), STEP_S),
            residual,
            later,
        )

    return jax.lax.fori_loop(0, piece.num_steps, step, before)


def _residual(piece: Piece, time: Int[Array, ""], gap_m: Array) -> Array:
    return jnp.sqrt(piece.weight[time]) * (gap_m - piece.gap_m[time])


def _follow(
    entry: ModelEntry, bounds: Bounds, units: Array, piece: Piece, time: Int[Array, ""], state: ReplayState
) -> ReplayState:
    """Return the followers one step later; each has parameters of its own in the unit cube, [parameter, ...]."""
    ranges = (-1, *[1] * (units.ndim - 1))
    values = bounds.lower.reshape(ranges) + units * (bounds.upper - bounds.lower).reshape(ranges)
    model = entry.build({parameter.name: values[index] for index, parameter in enumerate(entry.parameters)})
    leader = LeaderMotion(piece.leader_mps[time], piece.leader_acceleration_mps2[time], piece.leader_advance_m[time])
    return follow(model, state, leader, values[-1], jnp.full_like(state.speed_mps, UNIFORM), STEP_S)
