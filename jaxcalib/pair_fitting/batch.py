"""Many pairs as arrays of one length, and the misfit of their gaps with its derivatives."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
    """

    leader_mps: Array
    leader_acceleration_mps2: Array
    leader_advance_m: Array
    gap_m: Array
    weight: Array
    first: ReplayState


def pair_batch(pairs: Sequence[RecordedPair]) -> PairBatch:
    """Return pairs as arrays.

    The weights make the sum of squares the square of the mixed error: Kesting & Treiber (2008), Transp. Res. Rec.
    2088, eq. (12): errors relative to the geometric mean of the recorded gap and its mean.
    """
    length = max(len(pair) for pair in pairs)

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


def residuals(
    entry: ModelEntry, bounds: Bounds, unit: Float[Array, "pair parameter"], batch: PairBatch
) -> Float[Array, "step pair"]:
    """Return simulated less recorded gaps in units of their weights, each pair with parameters of its own.

    The follower begins where the recorded one does and then sees only its leader and its own past (closed loop).
    """
    values = bounds.values(unit)
    model = entry.build({one.name: values[:, place] for place, one in enumerate(entry.parameters)})

    def step(state: ReplayState, at: tuple[Array, ...]) -> tuple[ReplayState, Array]:
        speed, acceleration, advance = at
        motion = LeaderMotion(speed, acceleration, advance)
        return follow(model, state, motion, values[:, -1], jnp.full_like(speed, UNIFORM), STEP_S), state.gap_m

    series = (batch.leader_mps, batch.leader_acceleration_mps2, batch.leader_advance_m)
    gaps = jax.lax.scan(step, batch.first, series)[1]
    return jnp.sqrt(batch.weight) * (gaps - batch.gap_m)


def misfit(
    entry: ModelEntry, bounds: Bounds, unit: Float[Array, "pair parameter"], batch: PairBatch
) -> Float[Array, " pair"]:
    """Return the squared mixed error of each pair's simulated gap."""
    return jnp.sum(residuals(entry, bounds, unit, batch) ** 2, axis=0)
