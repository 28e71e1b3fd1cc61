"""Wiedemann's psycho-physical model of 1999 as VISSIM means it.

Sources: structure from the public demonstration by G. Liu (github.com/glgh/w99-demo, `js/model.js`), meaning and units
of the parameters from PTV VISSIM 2024's help, "Defining the Wiedemann 99 model parameters". VISSIM's own equations are
not published and the demonstration does not number its own; the numbers below are this module's. With the gap dx, the
leader's speed vl and acceleration al, dv = vl - v, and the acceleration a' of the step before:

    (1)  SDXc = CC0 + CC1 v_slower               safety distance; CC0 behind a standing leader
         v_slower = v                            if dv >= 0 or al < -1 m/s^2
         v_slower = vl + dv (r - 1/2)            else, with r of the driver, 0 < r < 1
    (2)  SDXo = SDXc + CC2                       largest gap while following
    (3)  SDXv = SDXo + CC3 (dv - CC4)            gap at which braking for a slower leader begins; CC3 < 0
    (4)  SDV  = 1e-4 CC6 dx^2                    speed difference that is not noticed at this gap
    (5)  SDVc = CC4 - SDV                        dv that is noticed as closing; 0 behind a standing leader; CC4 < 0
    (6)  SDVo = CC5 + SDV                        dv that is noticed as opening; SDV if v <= CC5

The first regime that applies decides:

    (7)  emergency,  dv < SDVo and dx <= SDXc:   a = min(al + dv^2 / (CC0 - dx), a')    if dv < 0 and dx > CC0
                                                 a = min(al + (dv - SDVo) / 2, a')      if dv < 0 and dx <= CC0
                                                 within [-10 + sqrt(v) / 2, -CC7]; -CC7 if dv >= 0; 0 if v = 0
    (8)  closing in, dv < SDVc and dx < SDXv:    a = max(dv^2 / (2 (SDXc - 0.1 - dx)), -10)
    (9)  following,  dv < SDVo and dx < SDXo:    a = min(a', -CC7) if a' <= 0, else min(max(a', CC7), v0 - v)
    (10) free:                                   a = min(a_max, dv^2 / (SDXo - dx), v0 - v) if SDXc < dx < SDXo
                                                 a = min(a_max, v0 - v) if dx >= SDXo; 0 if dx <= SDXc
    (11) a_max = CC8 + (CC9 - CC8) min(v, 80 km/h) / 80 km/h

What makes it differ from SUMO's model: CC9 acts (11); r belongs to the driver and counts behind leaders who do not
brake (1); the guards of (1) and (5) look at the leader's speed, that of (6) at the own one; (7) never brakes less than
before.

Deviation from the demonstration:
- (11): it has CC8 + CC9 v plus a random number. VISSIM's manual calls CC9 the acceleration at 80 km/h; it names two
  points, so the line between them is a choice, and above 80 km/h CC9 holds.
- v_slower is not negative: it may be in the demonstration, which then keeps less than CC0.
- Every divisor is kept at 0.1 m or more (1 mm in (7) and (10)) on the side that its regime needs, and the gap at 10 km
  or less, so that values and gradients stay finite where a regime does not apply or there is no leader.
Deviation from VISSIM:
- CC1 is one number for a class, not a distribution; drivers of a class differ by r and by their desired speed.
- There are no acceleration functions of vehicle types: CC8 and CC9 alone limit the acceleration.
- Where lane changing asks what a driver would do, r is 1/2.
- VISSIM's rules for stops, lower limits and gaps of lane changes are its own; SUMO's with `max_deceleration_mps2` take
  their place (see `Wiedemann99`).
"""

import dataclasses
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY
from surrogate.car_following.wiedemann99 import (
    HARDEST_BRAKING_MPS2,
    SPEED_OF_CC9_MPS,
    WIEDEMANN_99_ROWS,
    WIEDEMANN_99_SOURCE,
    Thresholds,
    Wiedemann99,
    seen_gap_m,
)
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry

Value = Float[Array, "..."]
LEADER_BRAKES_BELOW_MPS2 = -1.0
CLOSING_MARGIN_M = 0.1
SMALLEST_DIVISOR_M = 1e-3


class Wiedemann99Vissim(Wiedemann99):
    """W99 as VISSIM means it; sources, equations and deviations are in the module's text."""

    draws_once_per_driver: ClassVar[bool] = True

    @property
    def max_acceleration_mps2(self) -> Value:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The larger of CC8 and CC9, for (11) may rise or fall with speed."""
        return jnp.maximum(self.cc8_standstill_acceleration_mps2, self.cc9_acceleration_at_80kmh_mps2)

    def follow_acceleration(self, situation: FollowingSituation) -> Value:
        """Return the acceleration of the four regimes, (7) to (10)."""
        v, vl, al = situation.speed_mps, situation.leader_speed_mps, situation.leader_acceleration_mps2
        dv, last = vl - v, situation.acceleration_mps2
        dx = seen_gap_m(situation)
        cc0, cc7 = self.cc0_standstill_gap_m, self.cc7_oscillation_acceleration_mps2
        t = thresholds(self, situation)

        # (7)
        before_cc0_mps2 = al + dv * dv / jnp.minimum(cc0 - dx, -SMALLEST_DIVISOR_M)
        within_cc0_mps2 = al + 0.5 * (dv - t.sdvo_mps)
        emergency = jnp.minimum(jnp.where(dx > cc0, before_cc0_mps2, within_cc0_mps2), last)
        hardest = -HARDEST_BRAKING_MPS2 + 0.5 * jnp.sqrt(jnp.maximum(v, 1e-6))
        emergency = jnp.minimum(jnp.maximum(jnp.where(dv < 0.0, emergency, 0.0), hardest), -cc7)
        emergency = jnp.where(v > 0.0, emergency, 0.0)
        # (8)
        closing = 0.5 * dv * dv / jnp.minimum(t.sdxc_m - CLOSING_MARGIN_M - dx, -CLOSING_MARGIN_M)
        closing = jnp.maximum(closing, -HARDEST_BRAKING_MPS2)
        # (9)
        room_mps2 = situation.desired_speed_mps - v
        following = jnp.where(last <= 0.0, jnp.minimum(last, -cc7), jnp.minimum(jnp.maximum(last, cc7), room_mps2))
        # (10)
        catching_up = dv * dv / jnp.maximum(t.sdxo_m - dx, SMALLEST_DIVISOR_M)
        free = free_acceleration_mps2(self, v)
        free = jnp.minimum(jnp.where(dx < t.sdxo_m, jnp.minimum(catching_up, free), free), room_mps2)
        free = jnp.where(dx > t.sdxc_m, free, 0.0)

        is_emergency = (dv < t.sdvo_mps) & (dx <= t.sdxc_m)
        is_closing = (dv < t.sdvc_mps) & (dx < t.sdxv_m)
        is_following = (dv < t.sdvo_mps) & (dx < t.sdxo_m)
        return jnp.where(
            is_emergency, emergency, jnp.where(is_closing, closing, jnp.where(is_following, following, free))
        )


def thresholds(model: Wiedemann99Vissim, situation: FollowingSituation) -> Thresholds:
    """Return the perception thresholds, equations (1) to (6)."""
    v, vl = situation.speed_mps, situation.leader_speed_mps
    dv = vl - v
    dx = seen_gap_m(situation)
    cc4, cc5 = model.cc4_negative_speed_threshold_mps, model.cc5_positive_speed_threshold_mps
    is_alert = (dv >= 0.0) | (situation.leader_acceleration_mps2 < LEADER_BRAKES_BELOW_MPS2)
    slower_mps = jnp.maximum(0.0, jnp.where(is_alert, v, vl + dv * (situation.uniform - 0.5)))
    sdxc = model.cc0_standstill_gap_m + jnp.where(vl > 0.0, model.cc1_time_gap_s * slower_mps, 0.0)
    sdxo = sdxc + model.cc2_following_variation_m
    sdxv = sdxo + model.cc3_following_threshold_s * (dv - cc4)
    sdv = 1e-4 * model.cc6_oscillation_speed_dependency * dx * dx
    return Thresholds(
        sdxc_m=sdxc,
        sdxo_m=sdxo,
        sdxv_m=sdxv,
        sdvc_mps=jnp.where(vl > 0.0, cc4 - sdv, 0.0),
        sdvo_mps=sdv + jnp.where(v > cc5, cc5, 0.0),
    )


def free_acceleration_mps2(model: Wiedemann99Vissim, speed_mps: Value) -> Value:
    """Return the acceleration wanted on a free road, equation (11)."""
    share = jnp.minimum(speed_mps, SPEED_OF_CC9_MPS) / SPEED_OF_CC9_MPS
    standstill = model.cc8_standstill_acceleration_mps2
    return standstill + share * (model.cc9_acceleration_at_80kmh_mps2 - standstill)


def vissim_from_sumo(model: Wiedemann99) -> Wiedemann99Vissim:
    """Return VISSIM's model with the parameters of another W99, e.g. the one that SUMO's attributes give."""
    return Wiedemann99Vissim(**{field.name: getattr(model, field.name) for field in dataclasses.fields(model)})  # pyright: ignore[reportCallIssue]


WIEDEMANN_99_VISSIM = ModelEntry(
    "w99-vissim", "Wiedemann 99 as VISSIM means it", Wiedemann99Vissim,
    WIEDEMANN_99_ROWS, EMERGENCY, WIEDEMANN_99_SOURCE,
)  # fmt: skip
