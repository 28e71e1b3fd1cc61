"""Refines driver parameters by gradients, as far as gradients can be trusted.

A closed-loop run is not smooth: a lane change happens or not. But two parts of what is minimised are: the response
surface of the moments, and the open-loop replay of the leader-follower pairs, which knows car-following far better than
the moments do. Their sum is minimised here with Adam; the replay is weighed so that its curvature agrees with the
errors that the jackknife over drives found. A parameter whose derivative by automatic differentiation differs from
central differences keeps its value: models with thresholds (Wiedemann) have such.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from jaxcalib.calibration.objective.evidence import Evidence
from jaxcalib.calibration.stages.search_box import SearchBox
from jaxcalib.initial_values.initial_point import InitialPoint
from jaxcalib.search.least_squares.response_surface import ResponseSurface

DIFFERENCE = 4e-3  # of the unit range
AGREEMENT = 0.1  # largest relative difference between both derivatives, of the larger of the two
SMALL_SLOPE = 0.05  # of the steepest; below it both count as flat
NUM_STEPS = 300
STEP_SIZE = 2e-3  # of the unit range


@dataclass(frozen=True)
class GradientRefinement:
    """What gradients made of a point."""

    unit: Float[np.ndarray, " parameter"]  # the refined point
    names: tuple[str, ...]  # parameters that the replay depends on
    is_usable: tuple[bool, ...]  # whether the derivative of each agrees with central differences
    disagreement: tuple[float, ...]  # relative difference of the two derivatives
    before: float  # misfit at the beginning
    after: float  # misfit at the end


def refine(
    start: Float[np.ndarray, " parameter"],
    initial: InitialPoint,
    evidence: Evidence,
    surface: ResponseSurface,
    box: SearchBox,
    num_moments: int,
) -> GradientRefinement | None:
    """Return a refined point; None where there is no replay to differentiate.

    Args:
        start: in the unit cube.
        initial: what the logs said, with the loss of their pairs.
        evidence: what is known of the parameters.
        surface: response of the whitened residuals in the box; the first `num_moments` are those of moments.
        box: where the surface lives.
        num_moments: residuals behind them are the evidence; that of the pairs is the replay itself here.
    """
    loss, drivers = initial.drivers.replay_loss, initial.drivers
    if loss is None:
        return None
    space = initial.space
    fitted = np.asarray([space.index(name) for name in drivers.fitted], int)
    to_values = _values_of(initial, fitted)
    at_logs = initial.space.unit_of(initial.values)
    replay = jax.jit(lambda unit: loss(to_values(unit)))
    slopes = jax.jit(jax.grad(lambda unit: loss(to_values(unit))))
    scale = _scale(replay, at_logs[fitted], initial.unit_error[fitted])
    if not np.isfinite(scale):
        return None

    of_others = ~(evidence.whitener[:, fitted] != 0.0).any(axis=1)
    whitener = jnp.asarray(evidence.whitener[of_others], jnp.float32)
    base, slope, curvature = (
        jnp.asarray(part[:num_moments], jnp.float32) for part in (surface.intercept, surface.slope, surface.curvature)
    )
    center = jnp.asarray(surface.center, jnp.float32)
    held, chosen = jnp.asarray(start, jnp.float32), jnp.asarray(box.chosen)
    lower, width = jnp.asarray(box.lower, jnp.float32), jnp.asarray(box.upper - box.lower, jnp.float32)

    def misfit(unit: Array) -> Array:
        z = ((unit[chosen] - lower) / width - center) / surface.radius
        residual = base + slope @ z + 0.5 * curvature @ z**2
        known = whitener @ (unit - jnp.asarray(evidence.unit, jnp.float32))
        return jnp.sum(residual**2) + jnp.sum(known**2) + scale * loss(to_values(unit[jnp.asarray(fitted)]))

    automatic = np.asarray(slopes(jnp.asarray(start[fitted], jnp.float32)), float)
    central = _central_differences(replay, start[fitted])
    larger = np.maximum(np.abs(automatic), np.abs(central))
    disagreement = np.abs(automatic - central) / np.maximum(larger, SMALL_SLOPE * max(float(larger.max()), 1e-12))
    is_usable = disagreement <= AGREEMENT
    moves = np.zeros(len(start), bool)
    moves[box.chosen] = True
    moves[fitted] = is_usable
    unit = _descend(misfit, held, jnp.asarray(moves))
    return GradientRefinement(
        unit=np.clip(np.asarray(unit, float), 0.0, 1.0),
        names=drivers.fitted,
        is_usable=tuple(bool(one) for one in is_usable),
        disagreement=tuple(float(one) for one in disagreement),
        before=float(misfit(held)),
        after=float(misfit(unit)),
    )


Carry = tuple[Array, optax.OptState, Array, Array]


def _descend(misfit: Callable[[Array], Array], start: Array, moves: Array) -> Array:
    """Return the best point on Adam's way down, within the unit cube."""
    optimiser = optax.adam(optax.cosine_decay_schedule(STEP_SIZE, NUM_STEPS))
    value_and_slope = jax.value_and_grad(misfit)

    def step(carry: Carry, _: None) -> tuple[Carry, None]:
        unit, state, best, least = carry
        value, slope = value_and_slope(unit)
        is_best = value < least
        best, least = jnp.where(is_best, unit, best), jnp.where(is_best, value, least)
        update, state = optimiser.update(jnp.where(moves, jnp.nan_to_num(slope), 0.0), state)
        update = jnp.asarray(update)
        return (jnp.clip(unit + jnp.where(moves, update, 0.0), 0.0, 1.0), state, best, least), None

    first = (start, optimiser.init(start), start, jnp.asarray(jnp.inf, jnp.float32))
    (_, _, best, _), _ = jax.jit(lambda carry: jax.lax.scan(step, carry, None, length=NUM_STEPS))(first)
    return best


def _values_of(initial: InitialPoint, fitted: np.ndarray) -> Callable[[Array], Array]:
    """Return the map from the unit cube to values, differentiable."""
    space = initial.space
    low, high = space.lower[fitted], space.upper[fitted]
    is_log = np.asarray([space.ranges[place].is_logarithmic for place in fitted])
    safe_low, safe_high = np.where(is_log, low, 1.0), np.where(is_log, high, 2.0)

    def values(unit: Array) -> Array:
        in_logs = jnp.asarray(safe_low) * jnp.exp(unit * jnp.asarray(np.log(safe_high / safe_low)))
        return jnp.where(jnp.asarray(is_log), in_logs, jnp.asarray(low) + unit * jnp.asarray(high - low))

    return values


def _scale(replay: Callable[[Array], Array], at: np.ndarray, error: np.ndarray) -> float:
    """Return the weight of the replay at which its curvature is that of the errors, in the middle of the parameters."""
    ratios = []
    for place in range(len(at)):
        if not np.isfinite(error[place]):
            continue
        step = np.zeros(len(at))
        step[place] = max(error[place], DIFFERENCE)
        values = [float(replay(jnp.asarray(at + sign * step, jnp.float32))) for sign in (-1.0, 0.0, 1.0)]
        curvature = (values[0] - 2.0 * values[1] + values[2]) / step[place] ** 2
        if curvature > 0.0:
            ratios.append(2.0 / error[place] ** 2 / curvature)
    return float(np.median(ratios)) if ratios else float("nan")


def _central_differences(replay: Callable[[Array], Array], at: np.ndarray) -> np.ndarray:
    slopes = []
    for place in range(len(at)):
        step = np.zeros(len(at))
        step[place] = DIFFERENCE
        ahead, behind = (float(replay(jnp.asarray(at + sign * step, jnp.float32))) for sign in (1.0, -1.0))
        slopes.append((ahead - behind) / (2.0 * DIFFERENCE))
    return np.asarray(slopes)
