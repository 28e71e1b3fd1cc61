"""Fits a model to many pairs at once: a screen of many starts, then Levenberg-Marquardt from the best of them.

Every pair and every start is a lane of the same two programs, one for the screen and one with derivatives. These are
exact, by forward differentiation through the closed loop: a pair has few parameters, so that a tangent for each costs
less than going back through the drive, and the same tangents give the uncertainty. Tiles of lanes of like length run
in as many threads as there are cores; after a few steps only the best starts of each pair go on. The screen looks at
stretches of long pairs; where lanes are left, the last steps try several dampings side by side.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float
from scipy.stats.qmc import Sobol

from jaxcalib.pair_fitting.batch import Bounds, Misfit, bounds_of, misfit, misfit_and_slopes, pair_batch, single
from jaxcalib.pair_fitting.recorded_pairs import RecordedPair
from jaxcalib.pair_fitting.stretches import stretches_of
from jaxcalib.search.least_squares.levenberg_marquardt import DAMPING_FACTORS, Descent, begin, descend
from surrogate.vehicle.model_entry import ModelEntry

NUM_SCREENED = 128  # points of the unit cube for each pair
POINTS_AT_ONCE, PAIRS_AT_ONCE = 32, 64  # of the program that screens
NUM_STARTS = 4  # of each pair: the best points, and the model's usual values
LANES = 80  # of the program with derivatives: a step costs nearly as much however few are used, and 128 a third more
FIRST_STEPS = 4
NUM_KEPT = 1  # of each pair's starts after the first steps; 6 and 2 give the same errors for 1.7 times the work
LAST_STEPS, LAST_STEPS_SIDE_BY_SIDE = 8, 5  # the latter where all dampings are tried at once
NUM_THREADS = len(os.sched_getaffinity(0))
AT_BOUND = 1e-3  # of the range
UNKNOWN_ERROR = 0.25  # of the range: a parameter with a larger standard error is not identified


@dataclass(frozen=True)
class PairFit:
    """What a pair says of its follower."""

    name: str  # the pair's id
    values: np.ndarray  # the model's parameters, then the desired speed
    error: np.ndarray  # standard errors; inf where the pair says nothing
    is_identified: np.ndarray  # whether the error is at most a quarter of the range and the value is not at a bound
    mixed_error: float  # of the gaps that were fitted
    smallest_gap_m: float  # of the fitted follower; below 0 it would have hit its leader


def fit_pairs(
    entry: ModelEntry,
    pairs: Sequence[RecordedPair],
    seed: int = 0,
    on_pairs: Callable[[int], None] = lambda number: None,
) -> list[PairFit]:
    """Fit a model to each pair."""
    everyone = np.arange(len(pairs))
    with ThreadPoolExecutor(NUM_THREADS) as threads:
        search = _Search(entry, bounds_of(entry), pairs, threads)
        usual = _usual(search)
        compiled = threads.submit(search.evaluator(everyone[:LANES]), usual[:, :LANES])  # while points are screened
        starts = np.concatenate([usual[:, None], _screened(search, seed)], axis=1)
        compiled.result()
        lanes = np.repeat(everyone, NUM_STARTS)
        first = search.begin(lanes, np.moveaxis(starts, 1, 2).reshape(len(usual), -1))
        best = _best_of_each(lanes, np.asarray(first.found.total), NUM_KEPT)
        last = search.end(lanes[best], first.take(best), lambda number: on_pairs(number // NUM_KEPT))
        found = last.take(_best_of_each(lanes[best], np.asarray(last.found.total), 1))
    of_lane = [jax.tree.map(lambda leaf, lane=lane: leaf[..., lane], found.found) for lane in everyone]
    return [_judged(pair, search.bounds, found.unit[:, lane], of_lane[lane]) for lane, pair in enumerate(pairs)]


def mixed_errors(entry: ModelEntry, pairs: Sequence[RecordedPair], values: np.ndarray) -> np.ndarray:
    """Return the mixed error of each pair's gap for given values, [pair, parameter].

    Source: Kesting & Treiber (2008), Transp. Res. Rec. 2088, eq. (12).
    """
    bounds = bounds_of(entry)
    lower, upper = np.asarray(bounds.lower, float), np.asarray(bounds.upper, float)
    with ThreadPoolExecutor(NUM_THREADS) as threads:
        search = _Search(entry, bounds, pairs, threads)
        unit = ((values - lower) / (upper - lower)).T
        # as many times as the program that screens takes points: another program would cost more than that
        return np.sqrt(search.misfits(np.broadcast_to(unit[:, None], (len(lower), POINTS_AT_ONCE, len(pairs))))[0])


@dataclass(frozen=True)
class _Search:
    """The two programs for some pairs, in tiles of one shape; spare lanes repeat a pair."""

    entry: ModelEntry
    bounds: Bounds
    pairs: Sequence[RecordedPair]
    threads: ThreadPoolExecutor

    def misfits(self, units: Float[np.ndarray, "parameter point pair"]) -> Float[np.ndarray, "point pair"]:
        """Return the misfit of each pair at points of its own, a multiple of `POINTS_AT_ONCE`."""

        def of_tile(tile: np.ndarray) -> np.ndarray:
            lanes = np.pad(np.arange(len(tile)), (0, PAIRS_AT_ONCE - len(tile)), mode="edge")
            batch = pair_batch([self.pairs[index] for index in tile], lanes)
            parts = np.split(units[:, :, tile[lanes]], units.shape[1] // POINTS_AT_ONCE, axis=1)
            found = [misfit(self.entry, self.bounds, single(part), batch) for part in parts]
            return np.concatenate([np.asarray(one, float) for one in found])[:, : len(tile)]

        total = np.empty(units.shape[1:])
        tiles = self._tiles(np.arange(len(self.pairs)), PAIRS_AT_ONCE)
        for tile, found in zip(tiles, self.threads.map(of_tile, tiles), strict=True):
            total[:, tile] = found
        return total

    def evaluator(self, chosen: np.ndarray) -> Callable[[np.ndarray], Misfit]:
        """Return what gives the misfit and its derivatives for a tile of lanes, each with a pair, at its points."""
        distinct, lanes = np.unique(np.pad(chosen, (0, LANES - len(chosen)), mode="edge"), return_inverse=True)
        batch = pair_batch([self.pairs[index] for index in distinct], lanes)

        def evaluate(unit: np.ndarray) -> Misfit:
            spare = np.pad(unit, ((0, 0), (0, LANES - unit.shape[1])), mode="edge")
            found = misfit_and_slopes(self.entry, self.bounds, single(spare), batch)
            return jax.tree.map(lambda leaf: np.asarray(leaf, float)[..., : unit.shape[1]], found)

        return evaluate

    def begin(self, lanes: np.ndarray, start: Float[np.ndarray, "parameter lane"]) -> Descent[Misfit]:
        """Return where the first steps lead from points; `lanes` are the pairs."""

        def of_tile(tile: np.ndarray) -> Descent[Misfit]:
            evaluate = self.evaluator(lanes[tile])
            return descend(evaluate, begin(start[:, tile], evaluate(start[:, tile])), FIRST_STEPS)

        return self._over_tiles(of_tile, lanes)

    def end(self, lanes: np.ndarray, start: Descent[Misfit], on_lanes: Callable[[int], None]) -> Descent[Misfit]:
        """Return where the last steps lead from where a descent stands."""

        def of_tile(tile: np.ndarray) -> Descent[Misfit]:
            if len(DAMPING_FACTORS) * len(tile) > LANES:
                return descend(self.evaluator(lanes[tile]), start.take(tile), LAST_STEPS)
            number = len(DAMPING_FACTORS)  # spare lanes cost nothing
            evaluate = self.evaluator(np.tile(lanes[tile], number))
            return descend(evaluate, start.take(tile), LAST_STEPS_SIDE_BY_SIDE, number)

        return self._over_tiles(of_tile, lanes, on_lanes)

    def _over_tiles(
        self,
        of_tile: Callable[[np.ndarray], Descent[Misfit]],
        lanes: np.ndarray,
        on_lanes: Callable[[int], None] = lambda number: None,
    ) -> Descent[Misfit]:
        tiles = self._tiles(lanes, LANES)
        found = []
        for tile, one in zip(tiles, self.threads.map(of_tile, tiles), strict=True):
            found.append(one)
            on_lanes(len(tile))
        order = np.argsort(np.concatenate(tiles))
        return jax.tree.map(lambda *leaves: np.concatenate(leaves, axis=-1)[..., order], *found)

    def _tiles(self, lanes: np.ndarray, size: int) -> list[np.ndarray]:
        """Return places of lanes of like length, in groups; the longest come first, so that threads end together."""
        lengths = [len(self.pairs[index]) for index in lanes]
        order = np.argsort(lengths, kind="stable")
        size = min(size, -(-len(order) // NUM_THREADS))  # few lanes keep all cores busy, too
        return [order[place : place + size] for place in range(0, len(order), size)][::-1]


def _usual(search: _Search) -> Float[np.ndarray, "parameter pair"]:
    """Return the model's usual values; each driver wants to go a little faster than his leader ever does."""
    lower, upper = np.asarray(search.bounds.lower, float), np.asarray(search.bounds.upper, float)
    values = np.asarray([one.usual for one in search.entry.parameters] + [0.0])
    usual = np.tile(((values - lower) / (upper - lower))[:, None], (1, len(search.pairs)))
    fastest = np.asarray([pair.leader_mps.max() for pair in search.pairs])
    usual[-1] = np.clip((1.1 * fastest + 2.0 - lower[-1]) / (upper[-1] - lower[-1]), 0.0, 1.0)
    return usual


def _screened(search: _Search, seed: int) -> Float[np.ndarray, "parameter start pair"]:
    """Return the best points of a Sobol sequence for each pair, by stretches of it."""
    num_parameters = len(search.bounds.lower)
    cube = Sobol(num_parameters, rng=np.random.default_rng(seed)).random(NUM_SCREENED).T
    stretches = stretches_of(search.pairs)
    on_stretches = replace(search, pairs=stretches.parts)
    of_parts = on_stretches.misfits(np.broadcast_to(cube[:, :, None], (*cube.shape, len(stretches.parts))))
    total = stretches.summed(of_parts)
    order = np.argsort(np.where(np.isfinite(total), total, np.inf), axis=0, kind="stable")
    return cube[:, order[: NUM_STARTS - 1]]


def _best_of_each(lanes: np.ndarray, total: np.ndarray, count: int) -> np.ndarray:
    """Return the places of each pair's best lanes, best first, pair after pair."""
    order = np.lexsort((np.where(np.isfinite(total), total, np.inf), lanes))
    num_lanes = np.bincount(lanes)
    begins = np.append(0, np.cumsum(num_lanes)[:-1])
    return order[(begins[:, None] + np.arange(count)).ravel()]


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
