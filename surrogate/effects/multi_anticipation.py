"""Drivers look at two vehicles ahead and answer to a mixture of their speeds."""

import equinox as eqx
import jax.numpy as jnp

from surrogate.effects.base import ActsOn, Dial, Effect, Moment
from surrogate.vehicle.car_following_model import FollowingSituation

LOOK_AHEAD_M = 150.0


def _perceive(dial: Dial, situation: FollowingSituation, moment: Moment) -> FollowingSituation:
    second = moment.second_leader
    assert second is not None
    is_near = second.position_m - moment.vehicles.position_m <= LOOK_AHEAD_M
    share = jnp.where(second.exists & is_near & moment.is_background, dial.strength, 0.0)
    mixed = situation.leader_speed_mps + share * (second.speed_mps - situation.leader_speed_mps)
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
