"""Gauss-Newton on leader-follower pairs, with a desired speed of his own for each driver."""

from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxcalib.initial_values.following_loss import FollowingData, ModelOf, Theta, forgiving, residual

STEPS_PER_SCALE = 6
SPEED_FACTOR_PRIOR = (1.0, 0.25)  # mean and standard deviation; only drivers who show nothing of it stay there
SPEED_FACTOR_BOUNDS = (0.3, 2.0)
FACTOR_GRID = (0.6, 1.4, 81)  # desired speeds over limit to begin with; an accelerating driver tells 1 %
FIRST_SCALE_MPS2 = 0.15
DAMPING = 1e-4
LONGEST_STEP = 0.3  # of the bounds


class NewtonStep(eqx.Module):
    """Where a step leads, and what was known before it."""

    theta: Theta  # parameters
    factor: Float[Array, " vehicle"]  # desired speed over limit of each vehicle
    loss: Float[Array, ""]  # loss before the step
    explained_share: Float[Array, ""]  # share of samples whose error was below two scales
    factor_information: Float[Array, " vehicle"]  # 1 / variance of each vehicle's factor


def newton_step(
    theta: Theta,
    factor: Float[Array, " vehicle"],
    data: FollowingData,
    lower: Theta,
    upper: Theta,
    scale: float | Array,
    model_of: ModelOf,
) -> NewtonStep:
    """Return one step of iteratively reweighted Gauss-Newton.

    The desired speeds couple to the parameters but not to one another, so they are eliminated (Schur complement).
    """
    factor_of = factor[data.vehicle]
    error, by_factor = jax.jvp(lambda f: residual(model_of(theta), f, data), (factor_of,), (jnp.ones_like(factor_of),))

    def along(direction: Theta) -> Float[Array, " sample"]:
        return jax.jvp(lambda t: residual(model_of(t), factor_of, data), (theta,), (direction,))[1]

    by_theta = jax.vmap(along)(jnp.eye(theta.shape[0])).T
    weight = data.weight * jnp.exp(-0.5 * (error / scale) ** 2)
    precision = (scale / SPEED_FACTOR_PRIOR[1]) ** 2
    factor_information = data.per_vehicle(weight * by_factor**2) + precision
    factor_gradient = data.per_vehicle(weight * by_factor * error) + precision * (factor - SPEED_FACTOR_PRIOR[0])
    coupling = data.per_vehicle((weight * by_factor)[:, None] * by_theta)
    information = by_theta.T @ (weight[:, None] * by_theta) - coupling.T @ (coupling / factor_information[:, None])
    gradient = by_theta.T @ (weight * error) - coupling.T @ (factor_gradient / factor_information)
    damped = information + DAMPING * jnp.diag(jnp.diag(information) + 1e-6)
    longest = LONGEST_STEP * (upper - lower)
    change = jnp.clip(-jnp.linalg.solve(damped, gradient), -longest, longest)
    new_theta = jnp.clip(theta + change, lower, upper)
    factor_change = -(factor_gradient + coupling @ (new_theta - theta)) / factor_information
    return NewtonStep(
        theta=new_theta,
        factor=jnp.clip(factor + jnp.clip(factor_change, -0.1, 0.1), *SPEED_FACTOR_BOUNDS),
        loss=jnp.sum(data.weight * forgiving(error, scale)),
        explained_share=jnp.mean((jnp.abs(error) < 2.0 * scale).astype(jnp.float32)),
        factor_information=factor_information / scale**2,
    )


def anneal(
    step: Callable[[Theta, Array, Array], NewtonStep], theta: Theta, factor: Array, scales: Sequence[float]
) -> NewtonStep:
    """Return where steps lead as the scale shrinks (graduated non-convexity)."""
    moved = None
    for scale in scales:
        for _ in range(STEPS_PER_SCALE):
            moved = step(theta, factor, jnp.asarray(scale, jnp.float32))
            theta, factor = moved.theta, moved.factor
    assert moved is not None
    return moved


def best_factors(theta: Theta, data: FollowingData, model_of: ModelOf) -> tuple[Float[Array, " vehicle"], Array]:
    """Return for each vehicle the desired speed, out of a grid, that explains most, and the loss that is left."""
    grid = jnp.linspace(*FACTOR_GRID, dtype=jnp.float32)
    model = model_of(theta)

    def loss(factor: Float[Array, ""]) -> Float[Array, " vehicle"]:
        error = residual(model, jnp.full_like(data.limit_mps, factor), data)
        return data.per_vehicle(data.weight * forgiving(error, FIRST_SCALE_MPS2))

    losses = jax.lax.map(loss, grid)
    return grid[jnp.argmin(losses, axis=0)], jnp.sum(jnp.min(losses, axis=0))
