"""The model of Gazis, Herman and Rothery: drivers answer to a difference in speed, and to nothing else."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY, MAX_ACCELERATION, STOPS
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
SMALLEST_SPEED_MPS = 0.1  # else a driver who stands would stand for ever
SMALLEST_GAP_M = 0.1
FREE_EXPONENT = 4.0


class GazisHermanRothery(LateBrakingModel):
    """Gazis-Herman-Rothery model (GHR, General Motors).

    Source: Gazis, Herman & Rothery (1961), Oper. Res. 9, 545; a = alpha v^beta dv / h^gamma.
    Deviation: h is the gap instead of the spacing, so that it needs no vehicle length; there is no reaction time. The
    model has no free road and no equilibrium gap: without a leader, and wherever that is less, a driver accelerates to
    his desired speed as an IDM driver would.
    """

    jam_gap_m: Value  # for stops, not part of the model
    time_gap_s: Value  # for gaps of lane changes, not part of the model
    max_acceleration_mps2: Value  # on a free road
    max_deceleration_mps2: Value  # for stops and gaps of lane changes, not part of the model
    emergency_deceleration_mps2: Value  # physical bound
    sensitivity: Value  # alpha, m^gamma (m/s)^-beta / s
    speed_exponent: Value  # beta, of the own speed
    gap_exponent: Value  # gamma, of the gap

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the lesser of following and driving freely."""
        del step_s
        v = jnp.maximum(situation.speed_mps, SMALLEST_SPEED_MPS)
        share = v / jnp.maximum(situation.desired_speed_mps, SMALLEST_SPEED_MPS)
        free = self.max_acceleration_mps2 * (1.0 - share**FREE_EXPONENT)
        has_leader = situation.gap_m < jnp.inf
        gap = jnp.where(has_leader, jnp.maximum(situation.gap_m, SMALLEST_GAP_M), 1.0)
        gain = self.sensitivity * jnp.exp(self.speed_exponent * jnp.log(v) - self.gap_exponent * jnp.log(gap))
        follow = gain * (situation.leader_speed_mps - situation.speed_mps)
        return jnp.where(has_leader, jnp.minimum(follow, free), free)


GAZIS_HERMAN_ROTHERY = ModelEntry(
    "ghr", "model of Gazis, Herman and Rothery", GazisHermanRothery,
    (Parameter("sensitivity", 1.1, 0.01, 10.0, own_unit="m^gamma (m/s)^-beta / s"),
     Parameter("speed_exponent", 0.9, -1.0, 2.0), Parameter("gap_exponent", 1.0, -1.0, 3.0), MAX_ACCELERATION),
    EMERGENCY | STOPS,
)  # fmt: skip
