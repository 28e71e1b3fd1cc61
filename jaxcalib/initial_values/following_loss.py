"""How well a model explains leader-follower pairs: a loss that forgets large residuals."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxcalib.initial_values.following_samples import FollowingSamples
from surrogate.car_following.replay import ReplayStart, replay
from surrogate.vehicle.car_following_model import CarFollowingModel

CHANGE_BORDERS_MPS2 = (0.06, 0.15, 0.3, 0.6, 1.2)
GREATEST_BALANCE = 100.0
HIGHER_FACTORS = (0.04, 0.08, 0.15, 0.3)  # by which a driver may want more than seems

Theta = Float[Array, " parameter"]
ModelOf = Callable[[Theta], CarFollowingModel]


class FollowingData(eqx.Module):
    """Samples as the loss needs them."""

    start: ReplayStart  # the followers
    leader_speed_mps: Float[Array, "step sample"]  # speeds of their leaders
    later_speed_mps: Float[Array, " sample"]  # speed of each follower at the end
    limit_mps: Float[Array, " sample"]  # speed limit
    vehicle: Int[Array, " sample"]  # number of the follower, from 0
    drive: Int[Array, " sample"]  # index of the drive
    weight: Float[Array, " sample"]  # weight of each sample
    step_s: float = eqx.field(static=True)  # length of a step
    num_vehicles: int = eqx.field(static=True)  # number of followers

    @property
    def span_s(self) -> float:
        """Time between a sample's two moments."""
        return self.step_s * self.leader_speed_mps.shape[0]

    def thin(self, num_samples: int, num_vehicles: int) -> "FollowingData":
        """Return about so many samples of about so many vehicles, evenly chosen."""
        vehicle = np.asarray(self.vehicle)
        stride = max(1, self.num_vehicles // num_vehicles)
        kept = np.flatnonzero(vehicle % stride == 0)
        kept = kept[:: max(1, len(kept) // num_samples)]
        return jax.tree.map(lambda leaf: leaf[..., kept], self)

    def per_vehicle(self, values: Array) -> Array:
        """Return sums over the samples of each vehicle."""
        return jax.ops.segment_sum(values, self.vehicle, num_segments=self.num_vehicles)


def following_data(samples: FollowingSamples, limit_mps: np.ndarray) -> FollowingData:
    """Return samples as the loss needs them; followers are numbered in the order of their numbers in the samples."""
    vehicles, vehicle = np.unique(samples.vehicle, return_inverse=True)

    def f32(values: np.ndarray) -> Array:
        return jnp.asarray(values, jnp.float32)

    return FollowingData(
        start=ReplayStart(
            speed_mps=f32(samples.speed_mps),
            acceleration_mps2=f32(samples.acceleration_mps2),
            gap_m=f32(samples.gap_m),
            leader_acceleration_mps2=f32(samples.leader_acceleration_mps2),
            desired_speed_mps=f32(limit_mps),
        ),
        leader_speed_mps=f32(samples.leader_speed_mps.T),
        later_speed_mps=f32(samples.later_speed_mps),
        limit_mps=f32(limit_mps),
        vehicle=jnp.asarray(vehicle, jnp.int32),
        drive=jnp.asarray(samples.drive, jnp.int32),
        weight=f32(_balance(samples)),
        step_s=samples.step_s,
        num_vehicles=len(vehicles),
    )


def residual(model: CarFollowingModel, factor_of: Float[Array, " sample"], data: FollowingData) -> Array:
    """Return the error of the mean acceleration between a sample's two moments.

    Args:
        model: the drivers.
        factor_of: desired speed over limit of each sample's driver.
        data: the samples.
    """
    start = eqx.tree_at(lambda s: s.desired_speed_mps, data.start, factor_of * data.limit_mps)
    half = jnp.full_like(data.limit_mps, 0.5)
    last, _ = replay(model, start, data.leader_speed_mps, half, data.step_s)
    return (last.speed_mps - data.later_speed_mps) / data.span_s


def forgiving(error: Array, scale_mps2: float | Array) -> Array:
    """Return a loss between 0 and 1 that no longer grows where an error is far beyond the scale (Welsch)."""
    return 1.0 - jnp.exp(-0.5 * (error / scale_mps2) ** 2)


def mean_loss(
    model: CarFollowingModel, factor: Float[Array, " vehicle"], data: FollowingData, weight: Array, scale: float
) -> Array:
    """Return the mean loss under the given weights of the samples."""
    error = residual(model, factor[data.vehicle], data)
    return jnp.sum(weight * forgiving(error, scale)) / jnp.sum(weight)


@eqx.filter_jit
def least_rise(
    model: CarFollowingModel, factor: Float[Array, " vehicle"], data: FollowingData, scale: float
) -> Float[Array, " vehicle"]:
    """Return by how much each vehicle's loss rises at least if its driver wants more than what explains him best.

    Losses are summed over moments, of which those whose spans overlap count as one. Where a leader holds the driver
    back it does not rise: whatever he wants beyond that explains him as well.

    Args:
        model: the drivers.
        factor: desired speed over limit of each vehicle that explains it best.
        data: the samples.
        scale: of the loss, in m/s².
    """

    def loss(more: Float[Array, ""]) -> Float[Array, " vehicle"]:
        error = residual(model, (factor + more)[data.vehicle], data)
        return data.per_vehicle(forgiving(error, scale)) / data.leader_speed_mps.shape[0]

    losses = jax.lax.map(loss, jnp.asarray((0.0, *HIGHER_FACTORS), jnp.float32))
    return jnp.min(losses[1:] - losses[0], axis=0)


def _balance(samples: FollowingSamples) -> np.ndarray:
    """Return weights that count steady and changing moments alike.

    Most moments are steady, and a driver who hardly reacts at all explains them as well as the true one.
    """
    span_s = samples.step_s * samples.leader_speed_mps.shape[1]
    change = np.abs(samples.later_speed_mps - samples.speed_mps) / span_s
    kind = np.digitize(change, CHANGE_BORDERS_MPS2)
    count = np.bincount(kind, minlength=len(CHANGE_BORDERS_MPS2) + 1)
    weight = 1.0 / np.maximum(count[kind], len(kind) / GREATEST_BALANCE)
    return weight / weight.mean()
