"""Rules by which the surrogate's lane-change models accept a gap, each over the whole range of one of its parameters.

A rule says yes or no. Its *strictness* is the parameter that scales what it demands, the other way round where more of
it demands less; the least strict rule accepts almost everything. The strictest rule by which a driver would still have
gone is his *margin*: how good the gap is in the eyes of the model, from which its ROC follows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from experiments.fidelity.recorded_decisions import RecordedDecisions, situations
from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from surrogate.car_following.registry import car_following_model
from surrogate.lane_change.gap_acceptance import Ego, Following, blocked
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.lane_change.mobil import Appraisal, Mobil, OldFollower, appraise
from surrogate.lane_change.registry import lane_change_model
from surrogate.lane_change.vissim import Vissim
from surrogate.vehicle.lane_change_model import LaneChangeModel, Side
from surrogate.vehicle.vehicle_class import VehicleClass

STEP_S = 0.1
NUM_LEVELS = 400
MOST_SHARE = 50.0  # of the secure gap; the least is its reciprocal

Accepts = Callable[[VehicleClass, Ego, Side, Following], Bool[Array, " decision"]]


@dataclass(frozen=True)
class GapRule:
    """One rule."""

    name: str  # model, and the car-following model whose gaps or accelerations it asks for
    drivers: VehicleClass  # parameters as the model's source states them
    parameter: str  # what is varied
    place: Callable[[Any], Any]  # where it is in `drivers`
    levels: Float[np.ndarray, " level"]  # its values, from the strictest to the least strict
    accepts: Accepts  # whether drivers go

    def stated(self, decisions: RecordedDecisions) -> Bool[np.ndarray, " decision"]:
        """Return whether each driver goes by the rule as it stands."""
        return np.asarray(self.accepts(self.drivers, *situations(decisions, self.drivers)))

    def at_all_levels(self, decisions: RecordedDecisions) -> Bool[np.ndarray, "level decision"]:
        """Return whether each driver goes, at each level."""
        asked = situations(decisions, self.drivers)

        def at(level: Array) -> Array:
            return self.accepts(eqx.tree_at(self.place, self.drivers, level), *asked)

        return np.asarray(jax.jit(jax.vmap(at))(jnp.asarray(self.levels, jnp.float32)))


def gap_rules() -> tuple[GapRule, ...]:
    """Return the rules of all lane-change models.

    LC2013: SUMO's defaults of a passenger car. MOBIL: a_th and b_safe of its paper, IDM as in the registry; nobody is
    known to follow in the own lane, so politeness is 0. Its safety criterion looks at the new follower only; the whole
    model also at what the driver himself gains. VISSIM: its defaults, W99 as in the registry; its rule for a free
    change, and for a necessary one at the last place for it, where most braking is accepted.
    """
    shares = np.geomspace(MOST_SHARE, 1.0 / MOST_SHARE, NUM_LEVELS)
    secure = tuple(
        GapRule(
            f"LC2013, {model}",
            vehicle_class(attribute_values({}, model), model),
            "lcAssertive",
            lambda c: c.lane_change.assertive,
            1.0 / shares,
            _secure_gaps,
        )
        for model in ("Krauss", "IDM", "W99")
    )
    passenger = secure[0].drivers
    mobil = lane_change_model("mobil").build({"politeness": 0.0, "keep_right_bias_mps2": 0.0})
    idm = _with_models(passenger, mobil, "idm")
    w99 = _with_models(passenger, lane_change_model("vissim").build(), "w99-vissim")
    return (
        *secure,
        GapRule(
            "MOBIL safety, IDM", idm, "safe_deceleration_mps2", lambda c: c.lane_change.safe_deceleration_mps2,
            np.linspace(-1.5, 9.0, NUM_LEVELS), _is_safe,
        ),
        GapRule(
            "MOBIL, IDM", idm, "changing_threshold_mps2", lambda c: c.lane_change.changing_threshold_mps2,
            np.linspace(12.0, -12.0, NUM_LEVELS), _wants,
        ),
        *(
            GapRule(
                f"VISSIM, {kind}, W99", w99, "safety_distance_factor", lambda c: c.lane_change.safety_distance_factor,
                shares, partial(_vissim_gaps, is_necessary=kind == "necessary"),
            )
            for kind in ("free", "necessary")
        ),
    )  # fmt: skip


def _with_models(drivers: VehicleClass, lane_change: LaneChangeModel, car_following: str) -> VehicleClass:
    models = (lane_change, car_following_model(car_following).build())
    return eqx.tree_at(lambda c: (c.lane_change, c.car_following), drivers, models)


def _secure_gaps(drivers: VehicleClass, ego: Ego, side: Side, following: Following) -> Array:
    assert isinstance(drivers.lane_change, Lc2013)
    return ~blocked(ego, side, following, drivers.lane_change.assertive, STEP_S).at_all


def _appraisal(drivers: VehicleClass, ego: Ego, side: Side, following: Following) -> Appraisal:
    assert isinstance(drivers.lane_change, Mobil)
    speed = ego.speed_mps
    nobody = OldFollower(
        exists=jnp.zeros_like(side.is_open), gap_m=jnp.full_like(speed, jnp.inf), speed_mps=jnp.zeros_like(speed),
        acceleration_mps2=jnp.zeros_like(speed), max_speed_mps=jnp.full_like(speed, jnp.inf),
        vehicle_class=jnp.zeros_like(side.follower_class),
    )  # fmt: skip
    return appraise(drivers.lane_change, ego, side, nobody, following, False, STEP_S)


def _is_safe(drivers: VehicleClass, ego: Ego, side: Side, following: Following) -> Array:
    return _appraisal(drivers, ego, side, following).is_safe


def _wants(drivers: VehicleClass, ego: Ego, side: Side, following: Following) -> Array:
    return _appraisal(drivers, ego, side, following).wants


def _vissim_gaps(drivers: VehicleClass, ego: Ego, side: Side, following: Following, is_necessary: bool) -> Array:
    assert isinstance(drivers.lane_change, Vissim)
    here = eqx.tree_at(lambda e: e.need.remaining_m, ego, jnp.zeros_like(ego.speed_mps))
    return ~drivers.lane_change.blocked(here, side, following, jnp.full_like(side.is_open, is_necessary)).at_all
