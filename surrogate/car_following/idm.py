"""The intelligent driver model, as Treiber published it and as SUMO 1.28 computes it (they agree at a 0.1-s step)."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import BASIC, EMERGENCY, KESTING_TREIBER
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
SMALLEST_RATIO = 1e-9  # of speed to desired speed
SMALLEST_GAP_M = 0.001  # SUMO's NUMERICAL_EPS; keeps the interaction term finite when vehicles touch
NO_STOP_CLOSER_THAN_M = 0.01  # SUMO: with less than this ahead, the vehicle stands


class Idm(CarFollowingModel):
    """Intelligent driver model.

    Source: Treiber, Hennecke & Helbing (2000), Phys. Rev. E 62, 1805.
    """

    jam_gap_m: Value  # s0
    time_gap_s: Value  # T
    max_acceleration_mps2: Value
    max_deceleration_mps2: Value  # b, the comfortable deceleration; a positive number
    emergency_deceleration_mps2: Value  # physical bound, not part of the published model
    acceleration_exponent: Value  # delta, dimensionless

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the IDM acceleration; see `idm_acceleration`."""
        del step_s
        return idm_acceleration(self, situation, situation.gap_m, situation.leader_speed_mps, self.jam_gap_m)

    def stop_acceleration(self, situation: FollowingSituation, distance_m: Value, step_s: float) -> Value:
        """Return the IDM acceleration towards a standing obstacle, without the jam gap.

        Source: `MSCFModel_IDM::stopSpeed`: the place to stand is exact, so SUMO keeps no jam gap to it.
        """
        brake = idm_acceleration(self, situation, distance_m, jnp.zeros_like(distance_m), jnp.zeros_like(distance_m))
        stand = -situation.speed_mps / step_s
        return jnp.where(distance_m < NO_STOP_CLOSER_THAN_M, stand, brake)

    def slow_acceleration(
        self, situation: FollowingSituation, distance_m: Value, target_speed_mps: Value, step_s: float
    ) -> Value:
        """Brake for a lower limit as for a standing obstacle that stays ahead, no harder than comfortably.

        Source: `MSCFModel_IDM::freeSpeed`: the obstacle is no closer than the secure gap at the lower speed, and
        within that gap the speed is cut to the limit.
        """
        least = self.secure_gap_m(target_speed_mps, jnp.zeros_like(target_speed_mps), target_speed_mps, step_s)
        obstacle_m = jnp.maximum(distance_m, least)
        brake = idm_acceleration(self, situation, obstacle_m, jnp.zeros_like(obstacle_m), jnp.zeros_like(obstacle_m))
        brake = jnp.where(situation.speed_mps > target_speed_mps, brake, jnp.inf)
        cut = (target_speed_mps - situation.speed_mps) / step_s
        brake = jnp.where(distance_m < least, jnp.minimum(brake, cut), brake)
        return jnp.maximum(brake, -self.max_deceleration_mps2)

    def secure_gap_m(
        self, speed_mps: Value, leader_speed_mps: Value, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the dynamic part of the IDM's desired gap.

        Source: `MSCFModel_IDM::getSecureGap` (since SUMO 1.0, issue 2462).
        """
        del leader_deceleration_mps2, step_s
        return idm_dynamic_gap_m(self, speed_mps, leader_speed_mps)

    def insertion_speed_mps(
        self, situation: FollowingSituation, leader_deceleration_mps2: Value, step_s: float
    ) -> Value:
        """Return the wanted speed where its dynamic gap fits, else the speed one step later.

        Source: `MSCFModel_IDM::insertionFollowSpeed`: else nobody could enter at his desired speed.
        """
        del leader_deceleration_mps2
        wanted = situation.speed_mps
        fits = idm_dynamic_gap_m(self, wanted, situation.leader_speed_mps) <= situation.gap_m - self.jam_gap_m
        later = jnp.maximum(0.0, wanted + step_s * self.acceleration(situation, step_s))
        return jnp.where(fits, wanted, jnp.minimum(later, wanted))


def idm_dynamic_gap_m(model: Idm, speed_mps: Value, leader_speed_mps: Value) -> Value:
    """Return the part of the IDM's desired gap that depends on speed, floored at 0."""
    v, dv = speed_mps, speed_mps - leader_speed_mps
    braking = 2.0 * jnp.sqrt(model.max_acceleration_mps2 * model.max_deceleration_mps2)
    return jnp.maximum(0.0, v * model.time_gap_s + v * dv / braking)


def idm_acceleration(
    model: Idm, situation: FollowingSituation, gap_m: Value, leader_speed_mps: Value, jam_gap_m: Value
) -> Value:
    """Return the IDM acceleration [m/s^2], unclipped.

    Args:
        model: parameters.
        situation: speed and desired speed are taken from it.
        gap_m: bumper-to-bumper gap to the leader; inf means no leader.
        leader_speed_mps: speed of that leader.
        jam_gap_m: gap kept at standstill.

    Source: Treiber et al. (2000), eqs. (2) and (3).
    Deviation: the dynamic part of the desired gap is floored at 0 (Treiber & Kesting 2013, ch. 11), and the gap at
    0.001 m, as in SUMO.
    """
    desired_gap_m = jam_gap_m + idm_dynamic_gap_m(model, situation.speed_mps, leader_speed_mps)
    speed_ratio = situation.speed_mps / jnp.maximum(situation.desired_speed_mps, SMALLEST_GAP_M)
    # as exponential of a logarithm: XLA has both for many values at once, but calls the C library for each power
    free_road = jnp.exp(model.acceleration_exponent * jnp.log(jnp.maximum(speed_ratio, SMALLEST_RATIO)))
    interaction = (desired_gap_m / jnp.maximum(gap_m, SMALLEST_GAP_M)) ** 2
    return model.max_acceleration_mps2 * (1.0 - free_road - interaction)


IDM = ModelEntry(
    "idm", "intelligent driver model", Idm,
    (*BASIC, Parameter("acceleration_exponent", 4.0, 1.0, 10.0, traffic=(1.0, 8.0))),
    EMERGENCY, KESTING_TREIBER,
)  # fmt: skip
