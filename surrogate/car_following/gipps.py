"""Gipps' model: the lesser of what the driver wants and what lets him stop behind a leader who brakes."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY, JAM_GAP, MAX_ACCELERATION, MAX_DECELERATION
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
FARTHEST_GAP_M = 1e6
SMALLEST_SPEED_MPS = 1e-3


class Gipps(LateBrakingModel):
    """Gipps' model.

    Source: Gipps (1981), Transp. Res. B 15, 105, eq. (1).
    Deviation: the published model sets a new speed once per reaction time; here a driver approaches that speed within
    a reaction time, step by step, so that the model does not depend on the step.
    """

    jam_gap_m: Value  # gap kept at standstill
    time_gap_s: Value  # reaction time tau; in equilibrium the time gap is half as long again
    max_acceleration_mps2: Value
    max_deceleration_mps2: Value  # b, the deceleration that the driver is ready to use; a positive number
    emergency_deceleration_mps2: Value  # physical bound, not part of the published model
    leader_deceleration_mps2: Value  # b-hat, what he expects of his leader; a positive number

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration towards the speed of eq. (1)."""
        del step_s
        v, vl, tau = situation.speed_mps, situation.leader_speed_mps, self.time_gap_s
        b = self.max_deceleration_mps2
        share = v / jnp.maximum(situation.desired_speed_mps, SMALLEST_SPEED_MPS)
        free = v + 2.5 * self.max_acceleration_mps2 * tau * (1.0 - share) * jnp.sqrt(0.025 + share)
        room = jnp.minimum(situation.gap_m, FARTHEST_GAP_M) - self.jam_gap_m
        square = b * (b * tau * tau + 2.0 * room - v * tau + vl * vl / self.leader_deceleration_mps2)
        safe = jnp.sqrt(jnp.maximum(square, SMALLEST_SPEED_MPS**2)) - b * tau
        return (jnp.minimum(free, safe) - v) / tau


GIPPS = ModelEntry(
    "gipps", "Gipps' model", Gipps,
    (JAM_GAP, Parameter("time_gap_s", 0.8, 0.2, 2.5), MAX_ACCELERATION, MAX_DECELERATION,
     Parameter("leader_deceleration_mps2", 3.0, 0.5, 8.0)),
    EMERGENCY,
)  # fmt: skip
