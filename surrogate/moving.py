"""Moves all vehicles by some steps in which everybody stays in his lane."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from surrogate.kinematics import move
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.materialise import materialise
from surrogate.neighbours import leader_at, own_leader, second_leader
from surrogate.subject.replay import Replay, impose, overlaps
from surrogate.tiles import Tile, all_tiles, for_each_tile
from surrogate.traffic_state import TrafficState, VehicleArrays, with_changes
from surrogate.vehicle_class import select_by_class
from surrogate.world import World


def move_on(
    state: TrafficState, world: World, step_s: float, num_steps: int, num_tiles: Int[Array, ""] | int | None = None
) -> TrafficState:
    """Return the state after some steps in which everybody stays in his lane.

    Args:
        state: the state.
        world: the run.
        step_s: length of a step.
        num_steps: how many.
        num_tiles: tiles that hold vehicles, see `surrogate.tiles`; all unless given.
    """
    num_entries = state.vehicles.row.shape[0]
    num_tiles = all_tiles(num_entries) if num_tiles is None else num_tiles
    cooperative = []
    for vehicle_class in world.classes:
        model = vehicle_class.lane_change
        cooperative.append(jnp.clip(model.cooperative_speed, 0.0, 1.0) if isinstance(model, Lc2013) else jnp.ones(()))

    def one_step(_: int, carry: _Progress) -> _Progress:
        motion, step, num_collisions, num_overlaps = carry
        vehicles = motion.of(state.vehicles)
        leader, beside = materialise(own_leader(vehicles)), None
        if state.manoeuvres is not None:
            beside = materialise(leader_at(state.manoeuvres.second_leader, vehicles))
        second = None if world.effects is None else materialise(second_leader(leader))

        def one_tile(tile: Tile, carry: tuple[_Motion, Array]) -> tuple[_Motion, Array]:
            motion, num_collisions = carry
            before = tile(motion)
            vehicles = before.of(tile(state.vehicles))
            cooperative_speed = select_by_class(cooperative, vehicles.vehicle_class)
            after, has_collided = move(
                vehicles,
                tile(leader),
                world.classes,
                cooperative_speed,
                world.seed,
                step,
                step_s,
                world.effects,
                tile(second),
                tile(beside),
            )
            after = jax.tree.map(lambda new, old: jnp.where(tile.is_new, new, old), _Motion.from_(after), before)
            return tile.write(motion, after), num_collisions + jnp.sum(has_collided & tile.is_new)

        motion, num_collisions = for_each_tile(one_tile, num_tiles, num_entries, (motion, num_collisions))
        if isinstance(world.driver, Replay) and num_overlaps is not None:
            is_subject = world.is_subject(state.vehicles)
            length_m = select_by_class([one.length_m for one in world.classes], state.vehicles.vehicle_class)
            vehicles = impose(world.driver, motion.of(state.vehicles), is_subject, step + 1, step_s)
            num_overlaps = num_overlaps + overlaps(vehicles, is_subject, length_m)
            motion = _Motion.from_(vehicles)
        return motion, step + 1, num_collisions, num_overlaps

    with jax.named_scope("move"):
        carry = (_Motion.from_(state.vehicles), state.step, state.num_collisions, state.num_subject_overlaps)
        motion, *counts = jax.lax.fori_loop(0, num_steps, one_step, carry)
    moved = (motion.of(state.vehicles), *counts)
    return eqx.tree_at(
        lambda s: (s.vehicles, s.step, s.num_collisions, s.num_subject_overlaps),
        state,
        moved,
        is_leaf=lambda leaf: leaf is None,
    )


class _Motion(eqx.Module):
    """What changes of vehicles that stay in their lanes."""

    position_m: Float[Array, " vehicle"]
    speed_mps: Float[Array, " vehicle"]
    acceleration_mps2: Float[Array, " vehicle"]
    personal: dict[str, dict[str, Array]] | None

    @classmethod
    def from_(cls, vehicles: VehicleArrays) -> "_Motion":
        """Take it from vehicles."""
        return cls(vehicles.position_m, vehicles.speed_mps, vehicles.acceleration_mps2, vehicles.personal)

    def of(self, vehicles: VehicleArrays) -> VehicleArrays:
        """Return the vehicles with this motion."""
        return with_changes(
            vehicles,
            position_m=self.position_m,
            speed_mps=self.speed_mps,
            acceleration_mps2=self.acceleration_mps2,
            personal=self.personal,
        )


_Progress = tuple[_Motion, Array, Array, Array | None]  # motion, step, collisions, overlaps of a replayed vehicle
