"""What SUMO's models share beside following a leader: stops, lower limits and the gaps that lane changes need."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.safe_speed import krauss_secure_gap_m, late_braking_speed_mps, safe_stop_speed_mps
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation

Value = Float[Array, "..."]


class LateBrakingModel(CarFollowingModel):
    """A model whose driver brakes with `max_deceleration_mps2`, as late as that is in time.

    Source: `MSCFModel::stopSpeed`, `freeSpeed` and `getSecureGap` of SUMO 1.28, which most of its models inherit.
    """

    def stop_reaction_time_s(self, step_s: float) -> Value:
        """Return how long the driver goes on before he brakes for a place to stand."""
        del step_s
        return self.time_gap_s

    def stop_acceleration(self, situation: FollowingSituation, distance_m: Value, step_s: float) -> Value:
        """Return the acceleration to the speed from which the vehicle still stands in time."""
        reaction_s = self.stop_reaction_time_s(step_s)
        safe_mps = safe_stop_speed_mps(distance_m, self.max_deceleration_mps2, reaction_s, step_s)
        return (safe_mps - situation.speed_mps) / step_s

    def slow_acceleration(
        self, situation: FollowingSituation, distance_m: Value, target_speed_mps: Value, step_s: float
    ) -> Value:
        """Brake so late that the lower limit is just met."""
        bound = late_braking_speed_mps(distance_m, target_speed_mps, self.max_deceleration_mps2, step_s)
        accelerate = jnp.maximum((bound - situation.speed_mps) / step_s, -self.max_deceleration_mps2)
        return jnp.where(distance_m == jnp.inf, jnp.inf, accelerate)

    def secure_gap_m(
        self, speed_mps: Value, leader_speed_mps: Value, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the Krauss gap."""
        return krauss_secure_gap_m(
            speed_mps,
            leader_speed_mps,
            self.max_deceleration_mps2,
            leader_deceleration_mps2,
            self.time_gap_s,
            step_s,
        )
