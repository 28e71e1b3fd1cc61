"""Vehicles arrive in bunches, as behind a traffic light, at the same mean flow."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from surrogate.effects.base import ActsOn, Arrivals, Dial, Effect
from surrogate.keyed_random import Purpose, uniform

SIZE = 14
HEADWAY_S = 1.4  # in each lane, within a platoon
REGULAR_SHARE = 0.6  # of a headway in a platoon; the rest is random
STRIDE = 1 << 20


def _arrival(dial: Dial, gap: Float[Array, " entrance"], arrivals: Arrivals) -> Float[Array, " entrance"]:
    """Return the demand to the next arrival: short within a platoon, longer before its first vehicle.

    Arrivals are taken in blocks of the platoon's size, each a platoon or not; the mean over a block stays 1.
    """
    entrance = jnp.arange(gap.shape[0], dtype=jnp.int32)
    block = arrivals.arrival // SIZE
    is_platoon = uniform(arrivals.seed, entrance * STRIDE + block, 0, Purpose.PLATOON) < dial.strength
    lanes = jnp.maximum(arrivals.num_lanes, 1).astype(gap.dtype)
    within = jnp.minimum(1.0, HEADWAY_S / lanes * arrivals.demand_vehps)
    first = gap * (SIZE - (SIZE - 1) * within)
    later = within * (REGULAR_SHARE + (1.0 - REGULAR_SHARE) * gap)
    bunched = jnp.where(arrivals.arrival % SIZE == 0, first, later)
    return jnp.where(is_platoon & arrivals.is_mainline, bunched, gap)


PLATOONED_ARRIVALS = Effect(
    name="platooned_arrivals",
    title="vehicles arrive in platoons",
    unit="share of the mainline's vehicles that arrive in platoons of 14",
    weak=0.2,
    medium=0.4,
    strong=0.6,
    acts_on=ActsOn.DEMAND,
    source="bunched headways, Cowan (1975), M3; headways of followers of 1.32 s: Wasielewski (1979)",
    arrival=_arrival,
)
