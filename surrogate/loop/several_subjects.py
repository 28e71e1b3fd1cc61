"""Several subject vehicles on one road, which enter one after the other and detect each other like anybody else.

With one of them all that is kept of it is a number; with several the same arrays have an axis for them. Who they are is
told by their identities, in the order in which they depart.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.inflow.inflow import subject_identity
from surrogate.loop.world import World
from surrogate.road.perception import PerceptionFrame, Sensor, perceive
from surrogate.road.traffic_state import TrafficState, VehicleArrays


def perceive_all(
    state: TrafficState, world: World, sensor: Sensor, time_s: Float[Array, ""]
) -> tuple[TrafficState, PerceptionFrame, Int[Array, "*subject object"]]:
    """What `perceive` returns, with a leading axis for subject vehicles if there are several."""
    if not world.subject.num_subjects:
        return perceive(state, world.road, sensor, world.subject_class, time_s)

    def perceive_for(number: Array, track: Array, num_tracks: Array) -> tuple[Array, Array, PerceptionFrame, Array]:
        own = eqx.tree_at(lambda s: (s.vehicles.track, s.num_tracks), state, (track, num_tracks))
        identity = subject_identity(world.inflow.num_entrances) + number
        own, frame, entry = perceive(own, world.road, sensor, world.subject_class, time_s, identity)
        return own.vehicles.track, own.num_tracks, frame, entry

    numbers = jnp.arange(world.subject.num_subjects, dtype=jnp.int32)
    track, num_tracks, frames, entries = jax.vmap(perceive_for, in_axes=(0, 1, 0), out_axes=(1, 0, 0, 0))(
        numbers, state.vehicles.track, state.num_tracks
    )
    return eqx.tree_at(lambda s: (s.vehicles.track, s.num_tracks), state, (track, num_tracks)), frames, entries


def who_left(leaves: Bool[Array, " vehicle"], vehicles: VehicleArrays, world: World) -> Bool[Array, "*subject"]:
    """Whether each subject vehicle is among the vehicles that leave the road."""
    leaves = leaves & world.is_subject(vehicles)
    if not world.subject.num_subjects:
        return jnp.any(leaves)
    numbers = jnp.arange(world.subject.num_subjects, dtype=jnp.int32)
    identities = subject_identity(world.inflow.num_entrances) + numbers
    return jnp.any(leaves & (vehicles.identity == identities[:, None]), axis=1)


def all_have_left(left: Bool[Array, " run *subject"]) -> Bool[Array, " run"]:
    """In which runs no subject vehicle is left to wait for."""
    return left if left.ndim == 1 else jnp.all(left, axis=1)
