"""The improved IDM and, with coolness, the ACC model: an IDM that keeps its time gap and does not panic."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import BASIC, EMERGENCY, KESTING_TREIBER
from surrogate.car_following.idm import SMALLEST_GAP_M, SMALLEST_RATIO, Idm, idm_dynamic_gap_m
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
SMALLEST_SHARE = 1e-3  # of gap ratio and of free acceleration, where their powers would overflow
FARTHEST_GAP_M = 1e4


class ImprovedIdm(Idm):
    """Improved intelligent driver model; with coolness above 0 the ACC model.

    Attributes:
        coolness: 0 for the improved IDM alone, near 1 for a driver who trusts that the leader will not brake harder.

    Source: Treiber & Kesting (2013), Traffic Flow Dynamics, eqs. (11.22) to (11.26), as restated by SUMO's
    `MSCFModel_EIDM`; its noise, action points and jerk limits are not part of the model.
    Deviation: behind a standing leader the constant-acceleration heuristic brakes as for a place to stand (the printed
    case distinction gives 0/0 there), and without a leader the heuristic does not count.
    """

    coolness: Value

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration, not clipped."""
        del step_s
        improved = self.improved_acceleration(situation)
        heuristic = self.constant_acceleration_heuristic(situation)
        b = self.max_deceleration_mps2
        cool = (1.0 - self.coolness) * improved + self.coolness * (heuristic + b * jnp.tanh((improved - heuristic) / b))
        return jnp.where((improved >= heuristic) | (situation.gap_m == jnp.inf), improved, cool)

    def improved_acceleration(self, situation: FollowingSituation) -> Value:
        """Return the acceleration of the improved IDM, eqs. (11.22) and (11.23)."""
        v, v0 = situation.speed_mps, jnp.maximum(situation.desired_speed_mps, SMALLEST_GAP_M)
        a, b, delta = self.max_acceleration_mps2, self.max_deceleration_mps2, self.acceleration_exponent
        desired_gap_m = self.jam_gap_m + idm_dynamic_gap_m(self, v, situation.leader_speed_mps)
        ratio = desired_gap_m / jnp.maximum(situation.gap_m, SMALLEST_GAP_M)
        slow = a * (1.0 - _power(jnp.minimum(v / v0, 1.0), delta))
        fast = -b * (1.0 - _power(v0 / jnp.maximum(v, v0), a * delta / b))
        too_close = a * (1.0 - ratio * ratio)
        exponent = 2.0 * a / jnp.maximum(slow, SMALLEST_SHARE * a)
        approaching = slow * (1.0 - _power(jnp.clip(ratio, SMALLEST_SHARE, 1.0), exponent))
        below = jnp.where(ratio >= 1.0, too_close, approaching)
        above = jnp.where(ratio >= 1.0, fast + too_close, fast)
        return jnp.where(v <= v0, below, above)

    def constant_acceleration_heuristic(self, situation: FollowingSituation) -> Value:
        """Return the hardest acceleration that is safe if nobody changes his own, eq. (11.24)."""
        v, vl = situation.speed_mps, situation.leader_speed_mps
        gap = jnp.clip(situation.gap_m, SMALLEST_GAP_M, FARTHEST_GAP_M)
        al = jnp.minimum(situation.leader_acceleration_mps2, self.max_acceleration_mps2)
        leader_stops_first = vl * (v - vl) < -2.0 * gap * al
        divisor = jnp.where(leader_stops_first, vl * vl - 2.0 * gap * al, 1.0)
        closing = jnp.maximum(v - vl, 0.0)
        return jnp.where(leader_stops_first, v * v * al / divisor, al - closing * closing / (2.0 * gap))


def _power(base: Value, exponent: Value) -> Value:
    return jnp.exp(exponent * jnp.log(jnp.maximum(base, SMALLEST_RATIO)))


IMPROVED_IDM = ModelEntry(
    "iidm", "improved intelligent driver model", ImprovedIdm,
    BASIC, EMERGENCY | {"acceleration_exponent": 4.0, "coolness": 0.0}, KESTING_TREIBER,
)  # fmt: skip
ACC = ModelEntry(
    "acc", "improved IDM with the constant-acceleration heuristic", ImprovedIdm,
    (*BASIC, Parameter("coolness", 0.99, 0.0, 1.0)), EMERGENCY | {"acceleration_exponent": 4.0}, KESTING_TREIBER,
)  # fmt: skip
