"""SUMO's default model: Krauss with SUMO's discrete braking distances."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import BASIC, EMERGENCY, KESTING_TREIBER
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.car_following.safe_speed import emergency_follow_speed_mps, safe_follow_speed_mps
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]


class Krauss(LateBrakingModel):
    """Krauss' model: as fast as is safe, with random dawdling.

    Source: Krauss (1998), Microscopic modeling of traffic flow, DLR-FB 98-08; `MSCFModel_Krauss` of SUMO 1.28.
    """

    jam_gap_m: Value  # gap kept at standstill (minGap)
    time_gap_s: Value  # reaction time tau
    max_acceleration_mps2: Value
    max_deceleration_mps2: Value  # deceleration b that a driver is ready to use, and expects of his leader
    emergency_deceleration_mps2: Value  # physical bound
    imperfection: Value  # sigma, share of the acceleration that dawdling may take away

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration to the safe speed, less the dawdling."""
        v, vl, b = situation.speed_mps, situation.leader_speed_mps, self.max_deceleration_mps2
        gap = situation.gap_m - self.jam_gap_m
        safe = safe_follow_speed_mps(gap, vl, b, b, self.time_gap_s, step_s)
        safe = emergency_follow_speed_mps(safe, v, gap, vl, b, b, self.emergency_deceleration_mps2, step_s)
        fastest = jnp.minimum(v + self.max_acceleration_mps2 * step_s, situation.desired_speed_mps)
        wanted = jnp.minimum(safe, fastest)
        # SUMO's dawdle2: below one step of acceleration the speed itself is the scale
        scale = jnp.where(wanted < self.max_acceleration_mps2 * step_s, wanted, self.max_acceleration_mps2 * step_s)
        dawdled = jnp.maximum(0.0, wanted - self.imperfection * scale * situation.uniform)
        return (dawdled - v) / step_s


# dawdling is chance, which the replay of a pair leaves out
KRAUSS = ModelEntry(
    "krauss", "Krauss' model as SUMO computes it, without dawdling", Krauss,
    (*BASIC, Parameter("imperfection", 0.0, 0.0, 1.0, is_fitted=False)), EMERGENCY, KESTING_TREIBER,
)  # fmt: skip
