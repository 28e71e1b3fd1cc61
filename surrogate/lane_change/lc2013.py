"""SUMO's default lane-change model LC2013, for all vehicles at once.

Four motives, in this order: strategic (the route needs another lane), cooperative (make room for somebody who must
change), speed gain, keep right. Source: `MSLCM_LC2013.cpp` and `MSLaneChanger.cpp` of SUMO; J. Erdmann (2015), "SUMO's
lane-changing model", in Modeling Mobility with Open Data, Springer. Names of rules in the comments are SUMO's.

Deviations, each because vehicles decide together here and one after the other there:
- decisions fall at a fixed interval, not at each 0.1-s step; memories integrate over that interval;
- what a vehicle is told by another (make room, do not accelerate) reaches it at the same decision from ahead and from
  behind, in SUMO from ahead only;
- the gain of the two sides is remembered apart, as SUMO 1.28 does; its sources of 2022, with one memory for both,
  do not reproduce 1.28 (compared step by step on 75,000 vehicle steps);
- rules for stopped vehicles, pedestrians, roundabouts and opposite lanes are left out: no road that this simulator
  accepts has them.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.vehicle.lane_change_model import LaneChangeModel

Value = Float[Array, " vehicle"]


class Lc2013(LaneChangeModel):
    """Parameters of LC2013; the names are those of SUMO's attributes without the prefix "lc"."""

    strategic: Float[Array, "..."]  # eagerness to change for the route; scales the distance at which it becomes urgent
    cooperative: Float[Array, "..."]  # readiness to change lane for somebody else, 0 to 1
    cooperative_speed: Float[Array, "..."]  # readiness to adapt the speed for somebody else, 0 to 1
    speed_gain: Float[Array, "..."]  # eagerness to change for speed
    speed_gain_right: Float[Array, "..."]  # the same to the right, relative to the left
    speed_gain_remain_time_s: Float[Array, "..."]  # shortest time for which a lane must be of use to be taken for speed
    keep_right: Float[Array, "..."]  # eagerness to go back to the right
    assertive: Float[Array, "..."]  # required gaps are divided by this
    look_ahead_left: Float[Array, "..."]  # factor on the strategic distance to the left

    def route_parameters(self) -> "Lc2013":
        """Return the record itself."""
        return self


def route_only(
    strategic: Float[Array, "..."], assertive: Float[Array, "..."], look_ahead_left: Float[Array, "..."]
) -> Lc2013:
    """Return a record for models whose own motives take the place of LC2013's."""
    neutral = jnp.ones((), jnp.float32)
    return Lc2013(
        strategic=strategic,
        cooperative=neutral,
        cooperative_speed=neutral,
        speed_gain=neutral,
        speed_gain_right=neutral,
        speed_gain_remain_time_s=neutral,
        keep_right=neutral,
        assertive=assertive,
        look_ahead_left=look_ahead_left,
    )


class Memory(eqx.Module):
    """LC2013's memories of its free motives."""

    gain_left: Value  # gain in speed that the left lane promises, integrated over time
    gain_right: Value  # the same for the right lane
    keep_right: Value  # obligation to keep right, integrated over time; <= 0
