"""When a gap is large enough to change lane into; shared by all lane-change models that ask SUMO's question."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.lane_change_model import RouteNeed, Side
from surrogate.vehicle.vehicle_class import CarFollowingMix, select_by_class

Value = Float[Array, " vehicle"]
Flag = Bool[Array, " vehicle"]


class Ego(eqx.Module):
    """What a vehicle knows of itself and its own lane."""

    speed_mps: Value  # own speed
    acceleration_mps2: Value  # own last acceleration
    max_speed_mps: Value  # speed wanted on this lane
    speed_limit_mps: Value  # legal limit
    length_m: Value  # own length
    lane_length_m: Value  # length of the edge that the vehicle is on
    leader_exists: Flag  # whether there is a leader in the own lane
    leader_gap_m: Value  # gap to it less the jam gap; inf where there is none
    leader_speed_mps: Value
    leader_acceleration_mps2: Value  # its last acceleration
    leader_max_speed_mps: Value  # speed that it wants
    leader_class: Int[Array, " vehicle"]
    need: RouteNeed  # what the route demands in the own row


class Following(eqx.Module):
    """The car-following side that lane changing asks: own model, and the models of neighbours by class."""

    own: CarFollowingMix  # models of the vehicles themselves
    lengths_m: tuple[Float[Array, ""], ...]  # length of each class
    jam_gap_m: Value  # own jam gap
    time_gap_s: Value  # own time gap
    max_acceleration_mps2: Value  # own bound
    max_deceleration_mps2: Value  # own deceleration

    def of(self, vehicle_class: Int[Array, " vehicle"]) -> CarFollowingMix:
        """Return the models of neighbours."""
        return CarFollowingMix(self.own.models, vehicle_class)

    def length_m(self, vehicle_class: Int[Array, " vehicle"]) -> Value:
        """Return the lengths of neighbours."""
        return select_by_class(self.lengths_m, vehicle_class)

    def follow_speed_mps(
        self, speed_mps: Value, gap_m: Value, leader_speed_mps: Value, ego: Ego, step_s: float
    ) -> Value:
        """Return the own model's next speed behind a leader at `gap_m` beyond the jam gap."""
        situation = FollowingSituation(
            speed_mps=speed_mps,
            gap_m=gap_m + self.jam_gap_m,
            leader_speed_mps=leader_speed_mps,
            leader_acceleration_mps2=jnp.zeros_like(speed_mps),
            acceleration_mps2=ego.acceleration_mps2,
            desired_speed_mps=ego.max_speed_mps,
            uniform=jnp.full_like(speed_mps, 0.5),
        )
        return self.own.follow_speed_mps(situation, step_s)


class Blocked(eqx.Module):
    """Whether a change to one side is unsafe, and because of whom."""

    by_leader: Flag
    by_follower: Flag

    @property
    def at_all(self) -> Flag:
        """Whether anybody is in the way."""
        return self.by_leader | self.by_follower


def blocked(ego: Ego, side: Side, following: Following, assertive: Float[Array, "..."], step_s: float) -> Blocked:
    """Whether the gaps on one side are too short.

    A gap must exceed the secure gap of whoever would then follow, divided by `assertive`.

    Source: `MSLaneChanger::checkChange`, with the speeds of this moment, as the gaps in SUMO 1.28's lane-change output
    show; its sources of 2018 extrapolated them over the follower's reaction time.
    """
    behind = following.of(side.follower_class)
    back_m = behind.secure_gap_m(side.follower_speed_mps, ego.speed_mps, following.max_deceleration_mps2, step_s)
    by_follower = side.follower_exists & ((side.follower_gap_m < 0.0) | (side.follower_gap_m < back_m / assertive))
    leader_deceleration = following.of(side.leader_class).field("max_deceleration_mps2")
    front_m = following.own.secure_gap_m(ego.speed_mps, side.leader_speed_mps, leader_deceleration, step_s)
    by_leader = side.leader_exists & ((side.leader_gap_m < 0.0) | (side.leader_gap_m < front_m / assertive))
    return Blocked(by_leader, by_follower)
