"""The asymmetric optimal velocity relative velocity model: a cruise control that brakes unlike it speeds up."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY, JAM_GAP, MAX_ACCELERATION, TIME_GAP
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
FARTHEST_GAP_M = 1e4


class AsymmetricOptimalVelocity(LateBrakingModel):
    """Asymmetric optimal velocity relative velocity model (AOVRV).

    Source: Shang, Rosenblad & Stern (2022), IEEE Trans. Intell. Transp. Syst.; a = k1 (s - eta - T v) + k2 dv, with
    gains of their own for dv <= 0 and dv > 0.
    Deviation: the published model follows only; the lesser of it and a proportional cruise control counts.
    """

    jam_gap_m: Value  # eta
    time_gap_s: Value  # T
    max_acceleration_mps2: Value  # physical bound
    max_deceleration_mps2: Value  # for stops and gaps of lane changes, not part of the model
    emergency_deceleration_mps2: Value  # physical bound
    accelerating_gap_rate_1ps2: Value  # k1 while the leader is faster
    accelerating_speed_rate_1ps: Value  # k2 while the leader is faster
    decelerating_gap_rate_1ps2: Value  # k1 else
    decelerating_speed_rate_1ps: Value  # k2 else
    cruise_rate_1ps: Value  # gain of the cruise control that holds the desired speed

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the lesser of following and cruising, up to the physical bound."""
        del step_s
        v = situation.speed_mps
        dv = situation.leader_speed_mps - v
        gap = jnp.minimum(situation.gap_m, FARTHEST_GAP_M)
        excess = gap - self.jam_gap_m - self.time_gap_s * v
        opening = self.accelerating_gap_rate_1ps2 * excess + self.accelerating_speed_rate_1ps * dv
        closing = self.decelerating_gap_rate_1ps2 * excess + self.decelerating_speed_rate_1ps * dv
        follow = jnp.where(dv > 0.0, opening, closing)
        cruise = self.cruise_rate_1ps * (situation.desired_speed_mps - v)
        wanted = jnp.where(situation.gap_m < jnp.inf, jnp.minimum(follow, cruise), cruise)
        return jnp.minimum(wanted, self.max_acceleration_mps2)


ASYMMETRIC_OPTIMAL_VELOCITY = ModelEntry(
    "aovrv", "asymmetric optimal velocity relative velocity model", AsymmetricOptimalVelocity,
    (JAM_GAP, TIME_GAP, Parameter("accelerating_gap_rate_1ps2", 0.08, 0.001, 0.5),
     Parameter("accelerating_speed_rate_1ps", 0.3, 0.0, 2.0),
     Parameter("decelerating_gap_rate_1ps2", 0.09, 0.001, 0.5),
     Parameter("decelerating_speed_rate_1ps", 0.5, 0.0, 2.0), MAX_ACCELERATION),
    EMERGENCY | {"cruise_rate_1ps": 0.4, "max_deceleration_mps2": 3.0},
)  # fmt: skip
