"""Fits a model to many pairs at once: a screen of many starts, then Levenberg-Marquardt from the best of them.

Every pair and every start is a lane of the same program. Derivatives are exact, by forward differentiation through the
closed loop: a pair has few parameters, so that a tangent for each costs less than going back through the drive, and the
same tangents give the uncertainty.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats.qmc import Sobol

from jaxcalib.pair_fitting.batch import Bounds, PairBatch, bounds_of, misfit, pair_batch, residuals
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair
from surrogate.model_entry import ModelEntry

NUM_SCREENED = 64
NUM_STARTS = 4
NUM_ITERATIONS = 12
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6
DAMPING_DOWN, DAMPING_UP = 0.2, 5.0
SHORTEST_BATCH = 256  # steps; lengths are rounded up to powers of 2 times that, so that few programs are compiled
LANE_STEPS = 1 << 19  # lanes times steps in one batch
AT_BOUND = 1e-3  # of the range
UNKNOWN_ERROR = 0.25  # of the range: a parameter with a larger standard error is not identified


@dataclass(frozen=True)
class PairFit:
    """What a pair says of its follower.

    Attributes:
        name: the pair's id.
        values: the model's parameters, then the desired speed.
        error: standard errors; inf where the pair says nothing.
        is_identified: whether the error is at most a quarter of the range and the value is not at a bound.
        mixed_error: of the gaps that were fitted.
        smallest_gap_m: of the fitted follower; below 0 it would have hit its leader.
    """

    name: str
    values: np.ndarray
    error: np.ndarray
    is_identified: np.ndarray
    mixed_error: float
    smallest_gap_m: float


def fit_pairs(
    entry: ModelEntry,
    pairs: Sequence[RecordedPair],
    seed: int = 0,
    on_pairs: Callable[[int], None] = lambda number: None,
) -> list[PairFit]:
    """Fit a model to each pair.

    Args:
        entry: the model.
        pairs: what to fit.
        seed: of the starts.
        on_pairs: told how many pairs are done.
    """
    bounds = bounds_of(entry)
    fits: dict[int, PairFit] = {}
    for chosen in _chunks(pairs):
        some = [pairs[index] for index in chosen]
        batch = _padded(pair_batch(some), _length_class(max(len(pair) for pair in some)))
        units = np.asarray(_search(entry, bounds, batch, seed))
        found = np.asarray(residuals(entry, bounds, jnp.asarray(units), batch), float)
        slopes = np.asarray(_slopes(entry, bounds, jnp.asarray(units), batch), float)
        for lane, index in enumerate(chosen):
            steps = len(pairs[index])
            fits[index] = _judged(pairs[index], bounds, units[lane], found[:steps, lane], slopes[:steps, lane])
        on_pairs(len(chosen))
    return [fits[index] for index in range(len(pairs))]


def mixed_errors(entry: ModelEntry, pairs: Sequence[RecordedPair], values: np.ndarray) -> np.ndarray:
    """Return the mixed error of each pair's gap for given values, [pair, parameter].

    Source: Kesting & Treiber (2008), Transp. Res. Rec. 2088, eq. (12).
    """
    bounds = bounds_of(entry)
    errors = np.empty(len(pairs))
    for chosen in _chunks(pairs):
        some = [pairs[index] for index in chosen]
        batch = _padded(pair_batch(some), _length_class(max(len(pair) for pair in some)))
        unit = (jnp.asarray(values[chosen], jnp.float32) - bounds.lower) / (bounds.upper - bounds.lower)
        errors[chosen] = np.sqrt(np.asarray(_misfits(entry, bounds, unit, batch), float))
    return errors


def _chunks(pairs: Sequence[RecordedPair]) -> list[list[int]]:
    """Return groups of pairs of similar length, small enough for one batch."""
    order = sorted(range(len(pairs)), key=lambda index: len(pairs[index]))
    groups: list[list[int]] = []
    for index in order:
        length = _length_class(len(pairs[index]))
        is_new = not groups or _length_class(len(pairs[groups[-1][0]])) != length
        if is_new or len(groups[-1]) >= max(1, LANE_STEPS // length // NUM_STARTS):
            groups.append([])
        groups[-1].append(index)
    return groups


def _length_class(steps: int) -> int:
    length = SHORTEST_BATCH
    while length < steps:
        length *= 2
    return length


def _padded(batch: PairBatch, length: int) -> PairBatch:
    """Return a batch of a length for which there is a program; what is added weighs nothing."""
    missing = length - batch.gap_m.shape[0]
    first = batch.first
    padded = jax.tree.map(
        lambda leaf: jnp.pad(leaf, ((0, missing), (0, 0))), eqx.tree_at(lambda b: b.first, batch, None)
    )
    return eqx.tree_at(lambda b: b.first, padded, first, is_leaf=lambda leaf: leaf is None)


@functools.partial(jax.jit, static_argnums=0)
def _misfits(entry: ModelEntry, bounds: Bounds, unit: Array, batch: PairBatch) -> Array:
    return misfit(entry, bounds, unit, batch)


@functools.partial(jax.jit, static_argnums=0)
def _slopes(entry: ModelEntry, bounds: Bounds, unit: Array, batch: PairBatch) -> Float[Array, "step pair parameter"]:
    """Return the derivative of each residual with respect to its pair's own parameters."""

    def along(direction: Array) -> Array:
        tangent = jnp.broadcast_to(direction, unit.shape)
        return jax.jvp(lambda at: residuals(entry, bounds, at, batch), (unit,), (tangent,))[1]

    return jnp.moveaxis(jax.vmap(along)(jnp.eye(unit.shape[1], dtype=unit.dtype)), 0, -1)


@functools.partial(jax.jit, static_argnums=(0, 3))
def _search(entry: ModelEntry, bounds: Bounds, batch: PairBatch, seed: int) -> Float[Array, "pair parameter"]:
    """Return the best point of the unit cube found for each pair."""
    num_pairs, num_parameters = batch.gap_m.shape[1], len(entry.parameters) + 1
    usual = jnp.asarray([one.usual for one in entry.parameters] + [0.0], jnp.float32)
    usual = (usual - bounds.lower) / (bounds.upper - bounds.lower)
    fastest = jnp.max(batch.leader_mps, axis=0)
    wanted = (1.1 * fastest + 2.0 - bounds.lower[-1]) / (bounds.upper[-1] - bounds.lower[-1])
    usual = jnp.broadcast_to(usual, (num_pairs, num_parameters)).at[:, -1].set(jnp.clip(wanted, 0.0, 1.0))
    cube = jnp.asarray(Sobol(num_parameters, rng=np.random.default_rng(seed)).random(NUM_SCREENED), jnp.float32)
    screened = jax.lax.map(
        lambda point: misfit(entry, bounds, jnp.broadcast_to(point, (num_pairs, num_parameters)), batch), cube
    )
    screened = jnp.where(jnp.isfinite(screened), screened, jnp.inf)
    best = jnp.argsort(screened, axis=0)[: NUM_STARTS - 1]  # [start, pair]
    starts = jnp.concatenate([usual[None], cube[best]])
    lanes = jax.tree.map(lambda leaf: jnp.tile(leaf, (1,) * (leaf.ndim - 1) + (NUM_STARTS,)), batch)
    unit, total = _descend(entry, bounds, lanes, starts.reshape(-1, num_parameters))
    total = jnp.where(jnp.isfinite(total), total, jnp.inf).reshape(NUM_STARTS, num_pairs)
    unit = unit.reshape(NUM_STARTS, num_pairs, num_parameters)
    return unit[jnp.argmin(total, axis=0), jnp.arange(num_pairs)]


def _descend(entry: ModelEntry, bounds: Bounds, batch: PairBatch, unit: Array) -> tuple[Array, Array]:
    """Return where Levenberg-Marquardt steps within the unit cube lead, and the misfit there."""
    num_parameters = unit.shape[1]

    def normal(unit: Array) -> tuple[Array, Array, Array]:
        """Return misfit, half its gradient, and the product of the slopes."""
        residual = residuals(entry, bounds, unit, batch)
        slope = _slopes(entry, bounds, unit, batch)
        gradient = jnp.einsum("tp,tpk->pk", residual, slope)
        return jnp.sum(residual**2, axis=0), gradient, jnp.einsum("tpk,tpl->pkl", slope, slope)

    def iterate(_: int, carry: tuple[Array, ...]) -> tuple[Array, ...]:
        unit, total, gradient, product, damping = carry
        is_stuck = ((unit <= 0.0) & (gradient > 0.0)) | ((unit >= 1.0) & (gradient < 0.0))
        free = ~is_stuck
        both = free[:, :, None] & free[:, None, :]
        diagonal = jnp.diagonal(product, axis1=1, axis2=2)
        scale = damping[:, None] * jnp.maximum(diagonal, 1e-4 * jnp.max(diagonal, axis=1, keepdims=True)) + 1e-12
        matrix = jnp.where(both, product, 0.0) + jnp.eye(num_parameters) * jnp.where(free, scale, 1.0)[:, None, :]
        step = jnp.linalg.solve(matrix, jnp.where(free, -gradient, 0.0)[..., None])[..., 0]
        there = jnp.clip(unit + jnp.nan_to_num(step), 0.0, 1.0)
        later = normal(there)
        is_better = later[0] < total  # false for what is no number

        def chosen(new: Array, old: Array) -> Array:
            return jnp.where(is_better.reshape(-1, *[1] * (new.ndim - 1)), new, old)

        damping = jnp.clip(damping * jnp.where(is_better, DAMPING_DOWN, DAMPING_UP), LEAST_DAMPING, MOST_DAMPING)
        kept = (chosen(new, old) for new, old in zip(later, (total, gradient, product), strict=True))
        return (chosen(there, unit), *kept, damping)

    first = (unit, *normal(unit), jnp.full(unit.shape[0], FIRST_DAMPING))
    unit, total, *_ = jax.lax.fori_loop(0, NUM_ITERATIONS, iterate, first)
    return unit, total


def _judged(pair: RecordedPair, bounds: Bounds, unit: np.ndarray, residual: np.ndarray, slope: np.ndarray) -> PairFit:
    """Return a fit with its uncertainty.

    Neighbouring residuals are alike, so that a record counts as many observations as an autoregressive series of first
    order with the same correlation does: n (1 - r) / (1 + r).
    """
    lower, upper = np.asarray(bounds.lower, float), np.asarray(bounds.upper, float)
    total = float(np.sum(residual**2))
    lag = float(np.clip(np.sum(residual[1:] * residual[:-1]) / max(total, 1e-12), 0.0, 0.999))
    effective = len(residual) * (1.0 - lag) / (1.0 + lag)
    product = slope.T @ slope * effective / len(residual)
    freedom = max(effective - len(unit), 1.0)
    variance = np.diag(np.linalg.pinv(product, hermitian=True)) * total * (effective / len(residual)) / freedom
    is_flat = np.diag(product) < 1e-9 * np.diag(product).max(initial=1e-30)
    error = np.where(is_flat | (variance <= 0.0), np.inf, np.sqrt(np.maximum(variance, 0.0)))
    inside = (unit > AT_BOUND) & (unit < 1.0 - AT_BOUND)
    gaps = residual / np.sqrt(1.0 / (np.maximum(pair.gap_m, 0.5) * np.maximum(pair.gap_m, 0.5).mean()) / len(pair))
    return PairFit(
        name=pair.name,
        values=lower + unit * (upper - lower),
        error=error * (upper - lower),
        is_identified=inside & (error <= UNKNOWN_ERROR),
        mixed_error=float(np.sqrt(total)),
        smallest_gap_m=float((gaps + pair.gap_m).min()),
    )
