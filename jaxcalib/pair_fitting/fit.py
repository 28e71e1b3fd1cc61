"""Fits a model to many pairs at once: a screen of many starts, then Levenberg-Marquardt from the best of them.

Every pair and every start is a lane of the same two programs, one for the screen and one with derivatives. These are
exact, by forward differentiation through the closed loop: a pair has few parameters, so that a tangent for each costs
less than going back through the drive, and the same tangents give the uncertainty. The steps themselves are small
linear algebra outside, so that nothing more is to be compiled.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats.qmc import Sobol

from jaxcalib.pair_fitting.batch import Bounds, Misfit, PairBatch, bounds_of, misfit, misfit_and_slopes, pair_batch
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair
from surrogate.model_entry import ModelEntry

NUM_SCREENED = 64
NUM_STARTS = 4
NUM_ITERATIONS = 12
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6
DAMPING_DOWN, DAMPING_UP = 0.2, 5.0
MOST_PLACES = 1 << 20  # pairs times steps in one batch
SHORTEST_BATCH = 256  # steps; lengths of arrays are powers of 2 times that
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
    for chosen, batch in batches(pairs):
        units, found = _search(entry, bounds, batch, seed)
        for lane, index in enumerate(chosen):
            of_lane = jax.tree.map(lambda leaf, lane=lane: leaf[..., lane], found)
            fits[index] = _judged(pairs[index], bounds, units[lane], of_lane)
        on_pairs(len(chosen))
    return [fits[index] for index in range(len(pairs))]


def mixed_errors(entry: ModelEntry, pairs: Sequence[RecordedPair], values: np.ndarray) -> np.ndarray:
    """Return the mixed error of each pair's gap for given values, [pair, parameter].

    Source: Kesting & Treiber (2008), Transp. Res. Rec. 2088, eq. (12).
    """
    bounds = bounds_of(entry)
    lower, upper = np.asarray(bounds.lower, float), np.asarray(bounds.upper, float)
    errors = np.empty(len(pairs))
    for chosen, batch in batches(pairs):
        unit = _filled((values[chosen] - lower) / (upper - lower), batch)
        total = _misfits(entry, bounds, jnp.broadcast_to(unit, (NUM_STARTS, *unit.shape)), batch)[0]
        errors[chosen] = np.sqrt(np.asarray(total, float)[: len(chosen)])
    return errors


def batches(pairs: Sequence[RecordedPair]) -> Iterator[tuple[list[int], PairBatch]]:
    """Yield groups of pairs of similar length, with arrays of one shape for all groups; spare lanes repeat a pair."""
    length = SHORTEST_BATCH
    while length < max(len(pair) for pair in pairs):
        length *= 2
    lanes = min(len(pairs), max(1, MOST_PLACES // length))
    order = sorted(range(len(pairs)), key=lambda index: len(pairs[index]))
    for begin in range(0, len(order), lanes):
        chosen = order[begin : begin + lanes]
        spare = [chosen[-1]] * (lanes - len(chosen))
        yield chosen, pair_batch([pairs[index] for index in (*chosen, *spare)], length)


def _filled(unit: np.ndarray, batch: PairBatch) -> Array:
    """Return points for all lanes of a batch; spare ones repeat the last."""
    missing = batch.gap_m.shape[1] - len(unit)
    return jnp.asarray(np.pad(unit, ((0, missing), (0, 0)), mode="edge"), jnp.float32)


@functools.partial(jax.jit, static_argnums=0)
def _misfits(
    entry: ModelEntry, bounds: Bounds, units: Float[Array, "start pair parameter"], batch: PairBatch
) -> Float[Array, "start pair"]:
    return jax.vmap(lambda unit: misfit(entry, bounds, unit, batch))(units)


@functools.partial(jax.jit, static_argnums=0)
def _misfits_and_slopes(
    entry: ModelEntry, bounds: Bounds, units: Float[Array, "start pair parameter"], batch: PairBatch
) -> Misfit:
    return jax.vmap(lambda unit: misfit_and_slopes(entry, bounds, unit, batch))(units)


def _search(entry: ModelEntry, bounds: Bounds, batch: PairBatch, seed: int) -> tuple[np.ndarray, Misfit]:
    """Return the best point of the unit cube found for each pair, [pair, parameter], and the misfit there."""
    num_pairs, num_parameters = batch.gap_m.shape[1], len(entry.parameters) + 1
    lower, upper = np.asarray(bounds.lower, float), np.asarray(bounds.upper, float)
    usual = (np.asarray([one.usual for one in entry.parameters] + [0.0]) - lower) / (upper - lower)
    fastest = np.asarray(batch.leader_mps, float).max(axis=0)
    usual = np.tile(usual, (num_pairs, 1))
    usual[:, -1] = np.clip((1.1 * fastest + 2.0 - lower[-1]) / (upper[-1] - lower[-1]), 0.0, 1.0)
    cube = Sobol(num_parameters, rng=np.random.default_rng(seed)).random(NUM_SCREENED)
    screened = []
    for points in cube.reshape(-1, NUM_STARTS, 1, num_parameters):
        units = np.broadcast_to(points, (NUM_STARTS, num_pairs, num_parameters))
        screened.append(np.asarray(_misfits(entry, bounds, jnp.asarray(units, jnp.float32), batch), float))
    totals = np.concatenate(screened)
    best = np.argsort(np.where(np.isfinite(totals), totals, np.inf), axis=0)[: NUM_STARTS - 1]  # [start, pair]
    units, found = _descend(
        lambda units: _misfits_and_slopes(entry, bounds, jnp.asarray(units, jnp.float32), batch),
        np.concatenate([usual[None], cube[best]]),
    )
    chosen = np.argmin(np.where(np.isfinite(found.total), found.total, np.inf), axis=0)
    lanes = np.arange(num_pairs)
    return units[chosen, lanes], jax.tree.map(lambda leaf: np.moveaxis(leaf[chosen, ..., lanes], 0, -1), found)


def _descend(evaluate: Callable[[np.ndarray], Misfit], units: np.ndarray) -> tuple[np.ndarray, Misfit]:
    """Return where Levenberg-Marquardt steps within the unit cube lead, and the misfit there.

    Args:
        evaluate: from points, [start, pair, parameter], to their misfits.
        units: where to begin.
    """

    def evaluated(units: np.ndarray) -> Misfit:
        return jax.tree.map(lambda leaf: np.asarray(leaf, float), evaluate(units))

    found = evaluated(units)
    damping = np.full(units.shape[:2], FIRST_DAMPING)
    for _ in range(NUM_ITERATIONS):
        there = np.clip(units + np.nan_to_num(_step(units, found, damping)), 0.0, 1.0)
        later = evaluated(there)
        is_better = later.total < found.total  # false for what is no number
        damping = np.clip(damping * np.where(is_better, DAMPING_DOWN, DAMPING_UP), LEAST_DAMPING, MOST_DAMPING)
        units = np.where(is_better[..., None], there, units)
        found = jax.tree.map(
            lambda new, old, better=is_better: np.where(
                better.reshape(len(better), *[1] * (new.ndim - 2), better.shape[1]), new, old
            ),
            later,
            found,
        )
    return units, found


def _step(units: np.ndarray, found: Misfit, damping: np.ndarray) -> np.ndarray:
    """Return damped Gauss-Newton steps; a parameter at a bound that it would cross stays."""
    gradient = np.moveaxis(np.nan_to_num(found.gradient), 1, -1)
    product = np.moveaxis(np.nan_to_num(found.product), (1, 2), (-2, -1))
    free = ~(((units <= 0.0) & (gradient > 0.0)) | ((units >= 1.0) & (gradient < 0.0)))
    diagonal = np.diagonal(product, axis1=-2, axis2=-1)
    scale = damping[..., None] * np.maximum(diagonal, 1e-4 * diagonal.max(axis=-1, keepdims=True)) + 1e-12
    matrix = np.where(free[..., :, None] & free[..., None, :], product, 0.0)
    matrix = matrix + np.eye(units.shape[-1]) * np.where(free, scale, 1.0)[..., None, :]
    return np.linalg.solve(matrix, np.where(free, -gradient, 0.0)[..., None])[..., 0]


def _judged(pair: RecordedPair, bounds: Bounds, unit: np.ndarray, found: Misfit) -> PairFit:
    """Return a fit with its uncertainty.

    Neighbouring residuals are alike, so that a record counts as many observations as an autoregressive series of first
    order with the same correlation does: n (1 - r) / (1 + r).
    """
    lower, upper = np.asarray(bounds.lower, float), np.asarray(bounds.upper, float)
    total, steps = float(found.total), len(pair)
    lag = float(np.clip(found.lag_product / max(total, 1e-12), 0.0, 0.999))
    effective = steps * (1.0 - lag) / (1.0 + lag)
    product = np.asarray(found.product) * effective / steps
    freedom = max(effective - len(unit), 1.0)
    variance = np.diag(np.linalg.pinv(product, hermitian=True)) * total * (effective / steps) / freedom
    is_flat = np.diag(product) < 1e-9 * np.diag(product).max(initial=1e-30)
    error = np.where(is_flat | (variance <= 0.0), np.inf, np.sqrt(np.maximum(variance, 0.0)))
    inside = (unit > AT_BOUND) & (unit < 1.0 - AT_BOUND)
    return PairFit(
        name=pair.name,
        values=lower + unit * (upper - lower),
        error=error * (upper - lower),
        is_identified=inside & (error <= UNKNOWN_ERROR),
        mixed_error=float(np.sqrt(total)),
        smallest_gap_m=float(found.smallest_gap_m),
    )
