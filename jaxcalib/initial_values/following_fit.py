"""Driver parameters from leader-follower pairs: robust least squares, each driver with a desired speed of his own.

What the pairs show of car-following needs no simulation of traffic. Most moments obey the model; some do not, because
the driver makes room for somebody or prepares a lane change, so the loss forgets large residuals (Welsch), first
generously, then strictly (graduated non-convexity; Blake & Zisserman 1987, Visual Reconstruction). Starts spread over
the bounds, because a driver who hardly reacts at all is a local optimum; a population search and a scan along each
parameter end the fit, because models with thresholds (Wiedemann) have no slope there.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import differential_evolution
from scipy.stats.qmc import LatinHypercube

from jaxcalib.initial_values.following_loss import (
    FollowingData,
    ModelOf,
    following_data,
    least_rise,
    mean_loss,
)
from jaxcalib.initial_values.following_newton import anneal, best_factors, newton_step
from jaxcalib.initial_values.following_samples import FollowingSamples

SCALES_MPS2 = (0.25, 0.12, 0.06, 0.04)
LAST_SCALES = 2
NUM_STARTS = 1024
NUM_CHOSEN = 32
SCREENING_SAMPLES = 2400
SCREENING_VEHICLES = 48
CONTEST_SAMPLES = 12_000
POPULATION = 80
GENERATIONS = 120
POPULATION_SPREAD = 0.02  # of the bounds, for half of the first population
SCAN_SAMPLES = 30_000
SCAN_POINTS = 33
SCAN_CYCLES = 10
SCAN_WIDTH = 0.05
SCAN_SHRINKAGE = 0.6
JACKKNIFE_CYCLES = 5
JACKKNIFE_WIDTH = 0.02
GRADIENT_SAMPLES = 30_000
FLAT_LOSS = 1e-4  # a parameter whose whole range changes the loss by less is not shown by the pairs


@dataclass(frozen=True)
class FollowingFit:
    """What the pairs say of the drivers."""

    values: np.ndarray  # estimate of each parameter
    error: np.ndarray  # standard error of each, from the scatter between drives; inf where the pairs show nothing
    speed_factor: np.ndarray  # desired speed over limit of each vehicle
    speed_factor_error: np.ndarray  # its standard error
    # by how much the loss of a vehicle's moments, summed, rises at least where its driver wants more; moments whose
    # spans overlap count once. Nothing where his leader holds him back
    speed_factor_rise: np.ndarray
    explained_share: float  # share of moments that the model explains to within two of the last scales
    loss: float  # mean loss at the last scale, between 0 and 1


def fit_following(
    samples: FollowingSamples,
    limit_mps: np.ndarray,
    model_of: ModelOf,
    start: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    seed: int,
) -> FollowingFit:
    """Fit a model to leader-follower pairs.

    Args:
        samples: moments of car-following.
        limit_mps: speed limit at each of them.
        model_of: the model for parameter values.
        start: values to begin with, among others.
        lower: least values.
        upper: greatest values.
        seed: of the other starts.
    """
    data = following_data(samples, limit_mps)
    low, high = jnp.asarray(lower, jnp.float32), jnp.asarray(upper, jnp.float32)
    theta, factor = _contest(data, model_of, _starts(start, lower, upper, seed), low, high)
    full = jax.jit(lambda t, f, scale: newton_step(t, f, data, low, high, scale, model_of))
    moved = anneal(full, theta, factor, SCALES_MPS2[-LAST_SCALES:])
    last = full(moved.theta, moved.factor, jnp.asarray(SCALES_MPS2[-1], jnp.float32))
    newton = np.asarray(moved.theta, float)
    settled = _population_search(data, model_of, moved.factor, newton, lower, upper, seed)
    scan = _Scan(data.thin(SCAN_SAMPLES, data.num_vehicles), model_of, moved.factor, lower, upper)
    width = SCAN_WIDTH * (upper - lower)
    values, loss = min((scan.run(start, width, SCAN_CYCLES) for start in (newton, settled)), key=lambda found: found[1])
    return FollowingFit(
        values=values,
        error=np.where(scan.is_flat(values), np.inf, scan.errors(values)),
        speed_factor=np.asarray(moved.factor, float),
        speed_factor_error=1.0 / np.sqrt(np.maximum(np.asarray(last.factor_information, float), 1e-12)),
        speed_factor_rise=np.asarray(
            least_rise(model_of(jnp.asarray(values, jnp.float32)), moved.factor, data, SCALES_MPS2[-1]), float
        ),
        explained_share=float(last.explained_share),
        loss=loss,
    )


def loss_of_pairs(
    samples: FollowingSamples, limit_mps: np.ndarray, model_of: ModelOf, fit: FollowingFit
) -> Callable[[Array], Array]:
    """Return the mean loss of the pairs as a differentiable function of the parameters, desired speeds held."""
    data = following_data(samples, limit_mps)
    few = data.thin(GRADIENT_SAMPLES, data.num_vehicles)
    factor = jnp.asarray(fit.speed_factor, jnp.float32)
    return lambda theta: mean_loss(model_of(theta), factor, few, few.weight, SCALES_MPS2[-1])


def _starts(start: np.ndarray, lower: np.ndarray, upper: np.ndarray, seed: int) -> np.ndarray:
    cube = LatinHypercube(len(start), rng=np.random.default_rng(seed)).random(NUM_STARTS - 1)
    return np.vstack([start, lower + cube * (upper - lower)])


def _contest(
    data: FollowingData, model_of: ModelOf, starts: np.ndarray, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return parameters and desired speeds where the best of many starts leads."""
    screening = data.thin(SCREENING_SAMPLES, SCREENING_VEHICLES)
    few = data.thin(CONTEST_SAMPLES, data.num_vehicles)
    starts_f32 = jnp.asarray(starts, jnp.float32)
    screen = jax.jit(lambda all_starts: jax.lax.map(lambda t: best_factors(t, screening, model_of)[1], all_starts))
    chosen = starts_f32[jnp.argsort(screen(starts_f32))[:NUM_CHOSEN]]
    guess = jax.jit(lambda chosen: jax.lax.map(lambda t: best_factors(t, few, model_of)[0], chosen))
    look = jax.jit(
        jax.vmap(lambda t, f, scale: newton_step(t, f, few, low, high, scale, model_of), in_axes=(0, 0, None))
    )
    moved = anneal(look, chosen, guess(chosen), SCALES_MPS2)
    losses = look(moved.theta, moved.factor, jnp.asarray(SCALES_MPS2[-1], jnp.float32)).loss
    best = int(jnp.argmin(jnp.where(jnp.isfinite(losses), losses, jnp.inf)))
    return moved.theta[best], moved.factor[best]


def _population_search(
    data: FollowingData,
    model_of: ModelOf,
    factor: Array,
    around: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    seed: int,
) -> np.ndarray:
    """Return the best of a differential evolution that begins around a point in half of its members.

    In the other half each value is kept with even chance and drawn from the bounds otherwise, so that thresholds are
    sought while what Newton's method has settled stays.
    """
    few = data.thin(CONTEST_SAMPLES, data.num_vehicles)
    rng = np.random.default_rng(seed)

    def loss(theta: Array) -> Array:
        return mean_loss(model_of(theta), factor, few, few.weight, SCALES_MPS2[-1])

    losses = jax.jit(jax.vmap(loss))

    def evaluate(columns: np.ndarray) -> np.ndarray:
        values = np.asarray(losses(jnp.asarray(columns.T, jnp.float32)), float)
        return np.where(np.isfinite(values), values, 1.0)

    near = around + POPULATION_SPREAD * (upper - lower) * rng.standard_normal((POPULATION, len(around)))
    far = lower + LatinHypercube(len(around), rng=rng).random(POPULATION) * (upper - lower)
    is_far = (np.arange(POPULATION)[:, None] >= POPULATION // 2) & (rng.random(far.shape) < 0.5)
    first = np.clip(np.where(is_far, far, near), lower, upper)
    first[0] = around
    found = differential_evolution(
        evaluate, list(zip(lower, upper, strict=True)), maxiter=GENERATIONS, vectorized=True,
        init=first,  # pyright: ignore[reportArgumentType]  # an array is allowed too
        updating="deferred", polish=False, tol=1e-9, rng=rng,
    )  # fmt: skip
    return found.x


class _Scan:
    """Looks along one parameter after the other, closer each time."""

    def __init__(
        self, data: FollowingData, model_of: ModelOf, factor: Array, lower: np.ndarray, upper: np.ndarray
    ) -> None:
        self._data, self._lower, self._upper = data, lower, upper

        def loss(theta: Array, weight: Array) -> Array:
            return mean_loss(model_of(theta), factor, data, weight, SCALES_MPS2[-1])

        self._losses = jax.jit(jax.vmap(loss, in_axes=(0, None)))

    def run(
        self, theta: np.ndarray, width: np.ndarray, cycles: int, weight: Array | None = None
    ) -> tuple[np.ndarray, float]:
        """Return the best values found and their loss."""
        theta, width, best = theta.copy(), width.copy(), np.inf
        weight = self._data.weight if weight is None else weight
        for _ in range(cycles):
            for index in range(len(theta)):
                grid = theta[index] + width[index] * np.linspace(-1.0, 1.0, SCAN_POINTS)
                grid = np.clip(grid, self._lower[index], self._upper[index])
                losses = self._along(theta, index, grid, weight)
                theta[index], best = grid[np.argmin(losses)], float(losses.min())
            width *= SCAN_SHRINKAGE
        return theta, best

    def is_flat(self, theta: np.ndarray) -> np.ndarray:
        """Return for each parameter whether its whole range makes no difference."""
        ranges = zip(self._lower, self._upper, strict=True)
        grids = [np.linspace(low, high, SCAN_POINTS) for low, high in ranges]
        weight = self._data.weight
        return np.asarray([np.ptp(self._along(theta, i, grid, weight)) < FLAT_LOSS for i, grid in enumerate(grids)])

    def errors(self, theta: np.ndarray) -> np.ndarray:
        """Return standard errors from leaving out one drive at a time (jackknife)."""
        drive, weight = np.asarray(self._data.drive), np.asarray(self._data.weight)
        drives = np.unique(drive)
        if len(drives) < 2:
            return np.full(len(theta), np.inf)
        width = JACKKNIFE_WIDTH * (self._upper - self._lower)
        estimates = [
            self.run(theta, width, JACKKNIFE_CYCLES, jnp.asarray(np.where(drive == left_out, 0.0, weight)))[0]
            for left_out in drives
        ]
        spread = np.asarray(estimates) - np.mean(estimates, axis=0)
        return np.sqrt((len(drives) - 1) / len(drives) * np.sum(spread**2, axis=0))

    def _along(self, theta: np.ndarray, index: int, grid: np.ndarray, weight: Array) -> np.ndarray:
        points = np.repeat(theta[None], len(grid), axis=0)
        points[:, index] = grid
        losses = np.asarray(self._losses(jnp.asarray(points, jnp.float32), weight), float)
        return np.where(np.isfinite(losses), losses, np.inf)
