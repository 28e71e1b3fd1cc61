"""How much drivers dawdle, from how their speeds tremble: a mean does not tell dawdling from a lower acceleration."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxcalib.initial_values.following_fit import FollowingFit
from jaxcalib.initial_values.following_loss import FollowingData, ModelOf, residual
from jaxcalib.initial_values.following_samples import FollowingSamples
from surrogate.vehicle.car_following_model import CarFollowingModel

MEDIAN_OF_DIFFERENCES = 1.0 - np.sqrt(0.5)  # of two uniform numbers, taken without sign
FEWEST_TRIPLES = 200
SAME_SPEED_MPS = 1e-6


def dawdling_mps2(
    samples: FollowingSamples,
    data: FollowingData,
    model: CarFollowingModel,
    factor: Float[np.ndarray, " vehicle"],
) -> float | None:
    """Return the acceleration that dawdling takes away at most (Krauss' sigma times accel).

    Each step takes a new uniform share of it. What else a driver does changes slowly, so that the difference between
    what the model expects and what is seen differs from one step to the next but one by dawdling alone, and by noise
    of the logs: where drivers accelerate freely, noise in one speed enters two neighbouring steps with opposite signs,
    and neighbours differ by more of it than steps further apart. That much of it is taken off. Where the leader holds
    drivers back their own speed before does not matter to them, and noise there counts as dawdling: noise e of speeds
    that are dt apart as at most 3.5 e / dt.

    Args:
        samples: moments of following, one step each.
        data: the same samples.
        model: drivers who do not dawdle; only what changes from step to step has to be right about them.
        factor: desired speed over limit of each follower of the samples.

    Returns:
        That acceleration; None where too few moments follow each other, or where noise hides it.
    """
    lacking = np.asarray(residual(model, jnp.asarray(factor, jnp.float32)[data.vehicle], data), float)
    order = np.lexsort((np.arange(len(samples)), samples.vehicle))
    lacking, vehicle = lacking[order], samples.vehicle[order]
    before, after = samples.speed_mps[order], samples.later_speed_mps[order]
    is_next = (vehicle[1:] == vehicle[:-1]) & (np.abs(before[1:] - after[:-1]) < SAME_SPEED_MPS)
    is_third = is_next[1:] & is_next[:-1]
    if is_third.sum() < FEWEST_TRIPLES:
        return None
    neighbours = np.median(np.abs(lacking[1:-1] - lacking[:-2])[is_third]) / MEDIAN_OF_DIFFERENCES
    apart = np.median(np.abs(lacking[2:] - lacking[:-2])[is_third]) / MEDIAN_OF_DIFFERENCES
    # of noise e in each speed neighbours have 6 e² in their difference, others 4 e²; dawdling has the same in both
    square = 3.0 * apart**2 - 2.0 * max(neighbours, apart) ** 2
    return float(np.sqrt(square)) if square > 0.0 else None


def fit_beside_dawdling(
    fit: Callable[[ModelOf, list[int]], FollowingFit],
    model_of: ModelOf,
    names: Sequence[str],
    dawdled_mps2: float,
    accel_mps2: float,
) -> FollowingFit:
    """Fit everything but sigma, which follows from accel and from what dawdling is known to take away.

    Args:
        fit: fits a model of those of the parameters whose indices it is given.
        model_of: the model for values of all parameters.
        names: their SUMO names, with sigma among them.
        dawdled_mps2: what dawdling takes away at most.
        accel_mps2: accel where it is none of the parameters.
    """
    others = [index for index, name in enumerate(names) if name != "sigma"]
    at, accel = names.index("sigma"), names.index("accel") if "accel" in names else None

    def sigma_of(values: Array) -> Array:
        return jnp.minimum(1.0, dawdled_mps2 / (accel_mps2 if accel is None else values[others.index(accel)]))

    found = fit(lambda theta: model_of(jnp.insert(theta, at, sigma_of(theta))), others)
    sigma = float(sigma_of(jnp.asarray(found.values)))
    relative = 0.0 if accel is None else found.error[others.index(accel)] / found.values[others.index(accel)]
    return replace(found, values=np.insert(found.values, at, sigma), error=np.insert(found.error, at, sigma * relative))
