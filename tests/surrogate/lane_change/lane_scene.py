"""One driver between his neighbours, for tests of lane-change models."""

import jax
import jax.numpy as jnp
import numpy as np

from surrogate.lane_change.gap_acceptance import Ego
from surrogate.lane_change.mobil import OldFollower
from surrogate.vehicle.lane_change_model import RouteNeed, Side

Neighbour = tuple[float, float] | None  # gap, bumper to bumper, and speed


def lane_scene(
    speed_mps: float,
    length_m: float,
    jam_gap_m: float,
    desired_mps: float,
    own_leader: Neighbour,
    new_leader: Neighbour,
    new_follower: Neighbour,
    old_follower: Neighbour = None,
    remaining_m: float = 900.0,
) -> tuple[Ego, Side, OldFollower]:
    """Return the driver, the side with his new neighbours, and who follows him; all keep the same jam gap."""

    def one(value: float, dtype: type = np.float32) -> jax.Array:
        return jnp.asarray([value], dtype)

    def leader(neighbour: Neighbour, prefix: str) -> dict[str, jax.Array]:
        gap, other = neighbour or (np.inf, 7.0)
        return {
            f"{prefix}exists": one(neighbour is not None, bool),
            f"{prefix}gap_m": one(gap - jam_gap_m),
            f"{prefix}speed_mps": one(other),
            f"{prefix}acceleration_mps2": one(0.3),
            f"{prefix}max_speed_mps": one(desired_mps if neighbour else np.inf),
        }

    need = RouteNeed(one(0, np.int32), one(remaining_m), one(remaining_m + 50.0), one(0.0))
    zero, speed, desired = one(0, np.int32), one(speed_mps), one(desired_mps)
    ego = Ego(
        speed_mps=speed, acceleration_mps2=one(-0.2), max_speed_mps=desired, speed_limit_mps=desired,
        length_m=one(length_m), lane_length_m=one(remaining_m + 50.0), leader_class=zero, need=need,
        **leader(own_leader, "leader_"),
    )  # fmt: skip
    side = Side(
        is_open=one(True, bool), row=zero, leader_entry=zero, leader_class=zero, follower_entry=zero,
        follower_class=zero, need=need, leads_elsewhere=one(False, bool),
        **leader(new_leader, "leader_"), **leader(new_follower, "follower_"),
    )  # fmt: skip
    return ego, side, OldFollower(vehicle_class=zero, **leader(old_follower, ""))
