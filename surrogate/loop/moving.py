"""Moves all vehicles by some steps in which everybody stays in his lane.

A vehicle asks about nobody but the two before it, so a tile can make all steps before the next tile makes its first: it
only leaves behind where its last vehicles were at each step.
"""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.lane_change.lc2013 import Lc2013
from surrogate.loop.kinematics import move
from surrogate.loop.world import World
from surrogate.road.neighbours import Neighbour, leader_at, nobody, own_leader, second_leader
from surrogate.road.traffic_state import TrafficState, VehicleArrays, with_changes
from surrogate.subject.logged_drive import LoggedMotion, impose, overlaps
from surrogate.vehicle.vehicle_class import select_by_class
from surrogate.xla.materialise import materialise
from surrogate.xla.tiles import Tile, all_tiles, for_each_tile, tile_size

Tree = TypeVar("Tree")


def move_on(
    state: TrafficState,
    world: World,
    step_s: float,
    num_steps: Int[Array, ""] | int,
    num_tiles: Int[Array, ""] | int | None = None,
    most_steps: int | None = None,
) -> TrafficState:
    """State after some steps in which everybody stays in his lane.

    Args:
        state: the state.
        world: the run.
        step_s: length of a step.
        num_steps: how many.
        num_tiles: tiles that hold vehicles, see `surrogate.xla.tiles`; all unless given.
        most_steps: bound of `num_steps`; must be given if that is traced.

    Raises:
        ValueError: it is missing.
    """
    if most_steps is None:
        if not isinstance(num_steps, int):
            raise ValueError("Expected most_steps with a number of steps that is traced.")
        most_steps = num_steps
    if most_steps == 0:
        return state
    num_entries = state.vehicles.row.shape[0]
    # who looks at leaders anywhere, or is put where a log has him, needs everybody at the same step
    in_step = state.manoeuvres is not None or isinstance(world.driver, LoggedMotion)
    size = num_entries if in_step else tile_size(num_entries)
    num_tiles = 1 if in_step else all_tiles(num_entries) if num_tiles is None else num_tiles
    models = [vehicle_class.lane_change for vehicle_class in world.classes]
    cooperative = [jnp.clip(m.cooperative_speed, 0.0, 1.0) if isinstance(m, Lc2013) else jnp.ones(()) for m in models]
    is_one_tile = size == num_entries

    def move_tile(tile: Tile, carry: _Progress) -> _Progress:
        all_motion, ahead, num_collisions, num_overlaps = carry
        resting = tile(state.vehicles)
        cooperative_speed = select_by_class(cooperative, resting.vehicle_class)

        def make_step(number: Int[Array, ""], carry: _Progress) -> _Progress:
            motion, last, num_collisions, num_overlaps = carry
            vehicles, step = motion.of(resting), state.step + number
            before_tile = None if is_one_tile else (ahead, tile)
            leader, second, beside = _leaders(vehicles, state, world, before_tile, number)
            after, has_collided = move(
                vehicles,
                leader,
                world.classes,
                cooperative_speed,
                world.seed,
                step,
                step_s,
                world.effects,
                second,
                beside,
            )
            if isinstance(world.driver, LoggedMotion) and num_overlaps is not None:
                is_subject = world.is_subject(after)
                length_m = select_by_class([c.length_m for c in world.classes], after.vehicle_class)
                after = impose(world.driver, after, is_subject, step + 1, step_s)
                num_overlaps = num_overlaps + overlaps(after, is_subject, length_m)
            if not is_one_tile:
                last = last.with_step(number, vehicles)
            counted = has_collided if is_one_tile else has_collided & tile.is_new
            return _Motion.from_(after), last, num_collisions + jnp.sum(counted), num_overlaps

        start = tile(all_motion)
        motion, *others = jax.lax.fori_loop(
            0, num_steps, make_step, (start, ahead.of(resting), num_collisions, num_overlaps)
        )
        if not is_one_tile:
            motion = _where(tile.is_new, motion, start)
        return tile.write(all_motion, motion), *others

    with jax.named_scope("move"):
        start = _Motion.from_(state.vehicles), _Ahead.of_nobody(most_steps)
        carry = (*start, state.num_collisions, state.num_subject_overlaps)
        motion, _, *counts = for_each_tile(move_tile, num_tiles, num_entries, carry, size)
    moved = (motion.of(state.vehicles), state.step + num_steps, *counts)
    return eqx.tree_at(
        lambda s: (s.vehicles, s.step, s.num_collisions, s.num_subject_overlaps),
        state,
        moved,
        is_leaf=lambda leaf: leaf is None,
    )


def _leaders(
    vehicles: VehicleArrays,
    state: TrafficState,
    world: World,
    before_tile: "tuple[_Ahead, Tile] | None",
    number: Int[Array, ""],
) -> tuple[Neighbour, Neighbour | None, Neighbour | None]:
    """Leader of each vehicle of a tile, and if they are asked for, the leader's leader and the one on another lane.

    Args:
        vehicles: of the tile.
        state: where everybody was before the first step.
        world: the run.
        before_tile: who is ahead of the tile, and the tile; None if it holds everybody.
        number: of the step.
    """
    leader, second, beside = own_leader(vehicles), None, None
    if before_tile is not None:
        ahead, tile = before_tile
        leader = _where(tile.is_first, ahead.neighbour(number, 1), leader)
    leader = materialise(leader)
    if world.effects is not None:
        second = second_leader(leader)
        if before_tile is not None:
            ahead, tile = before_tile
            second = _where(tile.is_first, ahead.neighbour(number, 0), second)
        second = materialise(second)
    if state.manoeuvres is not None:
        beside = materialise(leader_at(state.manoeuvres.second_leader, vehicles))
    return leader, second, beside


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
        """The vehicles with this motion."""
        return with_changes(
            vehicles,
            position_m=self.position_m,
            speed_mps=self.speed_mps,
            acceleration_mps2=self.acceleration_mps2,
            personal=self.personal,
        )


class _Ahead(eqx.Module):
    """The last two vehicles of a tile, as the next tile sees them."""

    motion: Float[Array, "step quantity vehicle"]  # position, speed and acceleration at each step
    vehicle_class: Int[Array, " vehicle"]  # their classes

    @classmethod
    def of_nobody(cls, num_steps: int) -> "_Ahead":
        """Before the first tile there is nobody."""
        none = nobody()
        motion = jnp.stack([none.position_m, none.speed_mps, none.acceleration_mps2])
        motion = jnp.broadcast_to(motion[None, :, None], (num_steps, 3, 2))
        return cls(motion, jnp.broadcast_to(none.vehicle_class, (2,)))

    def of(self, vehicles: VehicleArrays) -> "_Ahead":
        """The last two of these vehicles; what they do is still to be filled in."""
        return _Ahead(self.motion, vehicles.vehicle_class[-2:])

    def with_step(self, number: Int[Array, ""], vehicles: VehicleArrays) -> "_Ahead":
        """The same with where they are before one of the steps."""
        arrays = (vehicles.position_m, vehicles.speed_mps, vehicles.acceleration_mps2)
        now = jnp.stack([array[-2:] for array in arrays])
        return _Ahead(jax.lax.dynamic_update_index_in_dim(self.motion, now, number, 0), self.vehicle_class)

    def neighbour(self, number: Int[Array, ""], which: int) -> Neighbour:
        """The last (1) or the one before it (0) at one of the steps."""
        position_m, speed_mps, acceleration_mps2 = jax.lax.dynamic_index_in_dim(self.motion, number, 0, False)[:, which]
        return Neighbour(
            entry=jnp.zeros((), jnp.int32),
            exists=jnp.all(self.vehicle_class[which:] >= 0),
            position_m=position_m,
            speed_mps=speed_mps,
            acceleration_mps2=acceleration_mps2,
            vehicle_class=self.vehicle_class[which],
        )


# motion; who is ahead of a tile; collisions; overlaps of a logged drive
_Progress = tuple[_Motion, _Ahead, Array, Array | None]


def _where(mask: Bool[Array, " vehicle"], values: Tree, others: Tree) -> Tree:
    """These values where the mask says so; arrays may have further axes."""
    return jax.tree.map(
        lambda value, other: jnp.where(mask.reshape(-1, *[1] * (other.ndim - 1)), value, other), values, others
    )
