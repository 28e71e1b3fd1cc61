"""Wiedemann's psycho-physical model of 1999: its ten parameters, and what SUMO 1.28 computes from them.

SUMO (`MSCFModel_W99`) and VISSIM give the same parameters different rules, so there are two models: `Wiedemann99Sumo`
here, which a calibration that is confirmed in SUMO needs, and `wiedemann99_vissim.Wiedemann99Vissim`.
"""

import abc
import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.car_following.common_parameters import EMERGENCY
from surrogate.car_following.late_braking import LateBrakingModel
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry, Parameter

Value = Float[Array, "..."]
SPEED_OF_CC9_MPS = 80.0 / 3.6
HARDEST_BRAKING_MPS2 = 10.0
TOUCHING_SHARE = 0.1
FARTHEST_GAP_M = 1e4


class Wiedemann99(LateBrakingModel):
    """The ten parameters; the CC number comes first in each name because everybody knows it."""

    habit_fields: ClassVar[Mapping[str, str]] = MappingProxyType(
        {
            "cc1_time_gap_s": "time_gap",
            "cc8_standstill_acceleration_mps2": "acceleration",
            "max_deceleration_mps2": "deceleration",
        }
    )
    cc0_standstill_gap_m: Value  # gap at standstill
    cc1_time_gap_s: Value  # desired time gap (a gap, though manuals call it headway)
    cc2_following_variation_m: Value  # how far the gap may open beyond the desired one
    cc3_following_threshold_s: Value  # when braking for a slower leader begins; negative
    cc4_negative_speed_threshold_mps: Value  # closing speed noticed while following; negative
    cc5_positive_speed_threshold_mps: Value  # opening speed noticed while following; positive
    cc6_oscillation_speed_dependency: Value  # how the thresholds grow with distance, 1e-4 1/(m s)
    cc7_oscillation_acceleration_mps2: Value  # acceleration while following
    cc8_standstill_acceleration_mps2: Value  # acceleration from standstill
    cc9_acceleration_at_80kmh_mps2: Value  # acceleration at 80 km/h. SUMO never uses it.
    max_deceleration_mps2: Value  # SUMO's decel, for safe gaps and stops
    emergency_deceleration_mps2: Value  # physical bound

    @property
    def jam_gap_m(self) -> Value:  # pyright: ignore[reportIncompatibleVariableOverride]
        """CC0."""
        return self.cc0_standstill_gap_m

    @property
    def time_gap_s(self) -> Value:  # pyright: ignore[reportIncompatibleVariableOverride]
        """CC1."""
        return self.cc1_time_gap_s

    @property
    def max_acceleration_mps2(self) -> Value:  # pyright: ignore[reportIncompatibleVariableOverride]
        """CC8, the bound that SUMO applies."""
        return self.cc8_standstill_acceleration_mps2

    @abc.abstractmethod
    def follow_acceleration(self, situation: FollowingSituation) -> Value:
        """Return the acceleration of the four regimes."""

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration of the four regimes."""
        del step_s
        return self.follow_acceleration(situation)

    def stop_reaction_time_s(self, step_s: float) -> Value:
        """Return one step.

        Source: `MSCFModel_W99::stopSpeed`, SUMO 1.28 (measured: the earlier version also followed a standing leader).
        The secure gap is that of `MSCFModel`, as the gaps in SUMO 1.28's lane-change output show; its sources of 2020
        took the perception threshold SDXv where that was larger.
        """
        return jnp.full((), step_s)


class Wiedemann99Sumo(Wiedemann99):
    """W99 as SUMO 1.28 computes it.

    Source: `MSCFModel_W99::followSpeed`.
    Deviation from VISSIM, all SUMO's: (a) the free acceleration is CC8 + CC9 v plus a random number, which the bound
    CC8 then cuts, so that vehicles always accelerate with CC8; CC9 still counts where lane changing asks how fast a
    lane will be; (b) the speed of the slower vehicle is randomised only behind a leader who accelerates with 1 m/s^2
    or more; (c) the guard of SDVc looks at the own speed, that of SDVo at the leader's; (d) braking while too close is
    bounded by 0, not by the last acceleration; (e) the random number is drawn each step; (f) who would come closer than
    a tenth of CC0 stands.
    Measured: SDXc is CC0 behind a standing leader, unlike in SUMO's sources of 2020, and (f), each step by step against
    SUMO 1.28 (experiments/fidelity).
    """

    def acceleration(self, situation: FollowingSituation, step_s: float) -> Value:
        """Return the acceleration of the four regimes, or that to a standstill, (f)."""
        wanted = self.follow_acceleration(situation)
        next_mps = jnp.maximum(situation.speed_mps + step_s * wanted, 0.0)
        touches = situation.gap_m - step_s * next_mps < TOUCHING_SHARE * self.cc0_standstill_gap_m
        return jnp.where(touches, jnp.minimum(wanted, -situation.speed_mps / step_s), wanted)

    def follow_acceleration(self, situation: FollowingSituation) -> Value:
        """Return the acceleration of the four regimes, in SUMO's order."""
        v, vl, al = situation.speed_mps, situation.leader_speed_mps, situation.leader_acceleration_mps2
        dv, dx = vl - v, seen_gap_m(situation)
        cc4, cc5 = self.cc4_negative_speed_threshold_mps, self.cc5_positive_speed_threshold_mps
        slower = jnp.where((dv >= 0.0) | (al < 1.0), v, vl + dv * (situation.uniform - 0.5))
        sdxc = self.cc0_standstill_gap_m + jnp.where(vl > 0.0, self.cc1_time_gap_s * jnp.maximum(0.0, slower), 0.0)
        sdxo = sdxc + self.cc2_following_variation_m
        sdv = self.cc6_oscillation_speed_dependency * dx * dx * 1e-4
        thresholds = Thresholds(
            sdxc_m=sdxc,
            sdxo_m=sdxo,
            sdxv_m=sdxo + self.cc3_following_threshold_s * (dv - cc4),
            sdvc_mps=jnp.where(v > 0.0, cc4 - sdv, 0.0),
            sdvo_mps=sdv + jnp.where(vl > cc5, cc5, 0.0),
        )
        free = self.cc8_standstill_acceleration_mps2 + situation.uniform
        free = free + self.cc9_acceleration_at_80kmh_mps2 * jnp.minimum(v, SPEED_OF_CC9_MPS)
        return _regime_acceleration(self, situation, thresholds, free)


@dataclasses.dataclass(frozen=True)
class Thresholds:
    """The perception thresholds of a driver, named as in Wiedemann's equations."""

    sdxc_m: Value  # least gap that is kept while following
    sdxo_m: Value  # largest gap while following
    sdxv_m: Value  # gap at which braking for a slower leader begins
    sdvc_mps: Value  # leader's speed less own that is noticed as closing
    sdvo_mps: Value  # leader's speed less own that is noticed as opening


def seen_gap_m(situation: FollowingSituation) -> Value:
    """Return the gap, finite without a leader: thresholds stay finite, and every regime but "free" stays closed."""
    return jnp.minimum(situation.gap_m, FARTHEST_GAP_M)


def _regime_acceleration(
    model: Wiedemann99, situation: FollowingSituation, thresholds: Thresholds, free: Value
) -> Value:
    """Return the acceleration of the regime that the thresholds select.

    The regimes, in the order in which they are tried: too close (increase the distance), closing in (brake), following
    (oscillate), free (accelerate or keep the speed).
    """
    v, vl, al = situation.speed_mps, situation.leader_speed_mps, situation.leader_acceleration_mps2
    dv, dx, last = vl - v, seen_gap_m(situation), situation.acceleration_mps2
    cc0, cc7 = model.cc0_standstill_gap_m, model.cc7_oscillation_acceleration_mps2
    sdxc, sdxo = thresholds.sdxc_m, thresholds.sdxo_m
    # every divisor is kept away from 0 on the side that its own regime needs; elsewhere the value is not used
    away = jnp.minimum(cc0 - dx, -1e-3)
    closing = jnp.where(
        dx > cc0,
        jnp.minimum(al + dv * dv / away, jnp.zeros_like(v)),
        jnp.minimum(al + 0.5 * (dv - thresholds.sdvo_mps), jnp.zeros_like(v)),
    )
    closing = jnp.where(dv < 0.0, closing, 0.0)
    too_close = jnp.where(
        closing > -cc7, -cc7, jnp.maximum(closing, -HARDEST_BRAKING_MPS2 + 0.5 * jnp.sqrt(jnp.maximum(v, 1e-6)))
    )
    too_close = jnp.where(vl > 0.0, too_close, 0.0)
    room = sdxc - dx - 0.1
    brake = 0.5 * dv * dv / jnp.where(jnp.abs(room) < 1e-3, jnp.where(room < 0.0, -1e-3, 1e-3), room)
    brake = jnp.clip(brake, -HARDEST_BRAKING_MPS2, HARDEST_BRAKING_MPS2)
    follow = jnp.where(last <= 0.0, jnp.minimum(last, -cc7), jnp.maximum(last, cc7))
    opening = jnp.minimum(dv * dv / jnp.maximum(sdxo - dx, 1e-3), free)
    keep = jnp.where(dx > sdxc, jnp.where(dx < sdxo, opening, free), 0.0)
    is_too_close = (dv < thresholds.sdvo_mps) & (dx <= sdxc)
    is_closing = (dv < thresholds.sdvc_mps) & (dx < thresholds.sdxv_m)
    is_following = (dv < thresholds.sdvo_mps) & (dx < sdxo)
    return jnp.where(is_too_close, too_close, jnp.where(is_closing, brake, jnp.where(is_following, follow, keep)))


# SUMO takes decel for stops and lane changes only, so pairs do not show it
WIEDEMANN_99_ROWS = (
    Parameter("cc0_standstill_gap_m", 1.5, 0.5, 5.0, is_logarithmic=True),
    Parameter("cc1_time_gap_s", 0.9, 0.3, 3.0, traffic=(0.4, 3.0), is_logarithmic=True),
    Parameter("cc2_following_variation_m", 4.0, 0.5, 15.0, traffic=(1.0, 15.0), is_logarithmic=True),
    Parameter("cc3_following_threshold_s", -8.0, -30.0, -2.0, traffic=(-20.0, -3.0)),
    Parameter("cc4_negative_speed_threshold_mps", -0.35, -2.0, -0.05, traffic=(-2.0, -0.02)),
    Parameter("cc5_positive_speed_threshold_mps", 0.35, 0.05, 2.0, traffic=(0.02, 2.0)),
    Parameter("cc6_oscillation_speed_dependency", 11.44, 0.5, 20.0, traffic=(0.0, 20.0), own_unit="1e-4/(m s)"),
    Parameter("cc7_oscillation_acceleration_mps2", 0.25, 0.02, 1.0, traffic=(0.02, 1.2), is_logarithmic=True),
    Parameter("cc8_standstill_acceleration_mps2", 2.5, 0.5, 4.0, traffic=(0.5, 5.0), is_logarithmic=True),
    Parameter("cc9_acceleration_at_80kmh_mps2", 1.5, 0.3, 3.0, traffic=(0.1, 4.0), is_logarithmic=True),
    Parameter("max_deceleration_mps2", 4.5, 1.0, 9.0, is_logarithmic=True, step=0.12, is_fitted=False),
)
WIEDEMANN_99_SOURCE = "bounds of PTV's and pvctools' calibrations"
WIEDEMANN_99_SUMO = ModelEntry(
    "w99-sumo128", "Wiedemann 99 as SUMO 1.28 computes it", Wiedemann99Sumo,
    WIEDEMANN_99_ROWS, EMERGENCY, WIEDEMANN_99_SOURCE,
)  # fmt: skip
