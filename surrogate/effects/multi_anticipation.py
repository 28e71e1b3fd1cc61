"""Drivers look at two vehicles ahead and answer to a mixture of their speeds."""

import equinox as eqx
import jax.numpy as jnp

from surrogate.car_following.base import FollowingSituation
from surrogate.effects.base import ActsOn, Dial, Effect, Moment
from surrogate.neighbours import shift_down

LOOK_AHEAD_M = 150.0


def _perceive(dial: Dial, situation: FollowingSituation, moment: Moment) -> FollowingSituation:
    vehicles = moment.vehicles
    first, second = shift_down(vehicles.vehicle_class, -1), shift_down(shift_down(vehicles.vehicle_class, -1), -1)
    position = shift_down(shift_down(vehicles.position_m, jnp.inf), jnp.inf)
    speed = shift_down(shift_down(vehicles.speed_mps, 0.0), 0.0)
    # a head in between opens the row, and what is before it belongs to another
    is_seen = (first >= 0) & (second >= 0) & (position - vehicles.position_m <= LOOK_AHEAD_M) & moment.is_background
    share = jnp.where(is_seen, dial.strength, 0.0)
    mixed = situation.leader_speed_mps + share * (speed - situation.leader_speed_mps)
    return eqx.tree_at(lambda s: s.leader_speed_mps, situation, mixed)


MULTI_ANTICIPATION = Effect(
    name="multi_anticipation",
    title="drivers look beyond their leader",
    unit="weight of the second leader's speed, 0 to 1",
    weak=0.25,
    medium=0.45,
    strong=0.7,
    acts_on=ActsOn.PERCEPTION,
    source=(
        "spatial anticipation of the human driver model, Treiber, Kesting & Helbing (2006), cond-mat/0404736, "
        "reduced to the speed of the second leader"
    ),
    perceive=_perceive,
)
