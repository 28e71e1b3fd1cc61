"""The full velocity difference model: an optimal speed for each gap, and an answer to the difference in speed."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY, JAM_GAP, MAX_ACCELERATION, STOPS
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
FARTHEST_GAP_M = 1e4


class FullVelocityDifference(LateBrakingModel):
    """Full velocity difference model (FVD, VDIFF).

    Source: Jiang, Wu & Zhu (2001), Phys. Rev. E 64, 017101, with the optimal speed in the form that
    Treiber & Kesting (2013), eq. (10.22), give it: V(s) = v0 (tanh(s/b - beta) + tanh beta) / (1 + tanh beta).
    Deviation: s is the gap less the jam gap, and v0 the driver's own desired speed.
    """

    jam_gap_m: Value  # gap kept at standstill
    time_gap_s: Value  # for stops and gaps of lane changes, not part of the model
    max_acceleration_mps2: Value  # physical bound, not part of the published model
    max_deceleration_mps2: Value  # for stops and gaps of lane changes, not part of the model
    emergency_deceleration_mps2: Value  # physical bound
    relaxation_rate_1ps: Value  # alpha, how fast the speed approaches the optimal one
    speed_difference_rate_1ps: Value  # lambda_0
    interaction_gap_m: Value  # S_c, the gap beyond which the difference in speed does not count
    gap_scale_m: Value  # b, over which the optimal speed rises
    form_factor: Value  # beta

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration, up to the physical bound."""
        del step_s
        v = situation.speed_mps
        optimal = self.optimal_speed_mps(situation.gap_m, situation.desired_speed_mps)
        counts = situation.gap_m < self.interaction_gap_m
        answer = jnp.where(counts, self.speed_difference_rate_1ps * (situation.leader_speed_mps - v), 0.0)
        return jnp.minimum(self.relaxation_rate_1ps * (optimal - v) + answer, self.max_acceleration_mps2)

    def optimal_speed_mps(self, gap_m: Value, desired_speed_mps: Value) -> Value:
        """Return the speed that fits a gap."""
        room = jnp.clip(gap_m - self.jam_gap_m, 0.0, FARTHEST_GAP_M)
        share = jnp.tanh(room / self.gap_scale_m - self.form_factor) + jnp.tanh(self.form_factor)
        return desired_speed_mps * share / (1.0 + jnp.tanh(self.form_factor))


FULL_VELOCITY_DIFFERENCE = ModelEntry(
    "fvd", "full velocity difference model", FullVelocityDifference,
    (JAM_GAP, Parameter("relaxation_rate_1ps", 0.4, 0.02, 2.0), Parameter("speed_difference_rate_1ps", 0.6, 0.0, 2.0),
     Parameter("interaction_gap_m", 120.0, 20.0, 200.0), Parameter("gap_scale_m", 15.0, 2.0, 60.0),
     Parameter("form_factor", 1.5, 0.0, 4.0), MAX_ACCELERATION),
    EMERGENCY | {name: STOPS[name] for name in ("time_gap_s", "max_deceleration_mps2")},
)  # fmt: skip
