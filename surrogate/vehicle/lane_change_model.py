"""What every lane-change model answers, and the surroundings it is given."""

import abc
import enum
from typing import Any

import equinox as eqx
from jaxtyping import Array, Bool, Float, Int

Value = Float[Array, " vehicle"]
RIGHT, STAY, LEFT = -1, 0, 1


class Reason(enum.IntEnum):
    """Why a vehicle changes lane; the names are SUMO's."""

    STRATEGIC = 0
    COOPERATIVE = 1
    SPEED_GAIN = 2
    KEEP_RIGHT = 3


class LaneChangeModel(eqx.Module):
    """The parameters of a lane-change model; see `registry.py` for all of them.

    A record holds numbers only, one per vehicle or one for all; `lane_change.decide` asks the model that the record
    belongs to: LC2013's, or one that replaces its free motives (`free_model.py`).
    """

    @abc.abstractmethod
    def route_parameters(self) -> Any:
        """Return what the model takes from LC2013, as such a record."""


class LaneChangeDecision(eqx.Module):
    """What every vehicle does about its lane at one decision."""

    direction: Int[Array, " vehicle"]  # RIGHT, STAY or LEFT; only changes that are safe now
    reason: Int[Array, " vehicle"]  # a `Reason`, where `direction` is not STAY
    entry_ahead: Int[Array, " vehicle"]  # entry of the leader in the target row, where `direction` is not STAY
    target_row: Int[Array, " vehicle"]  # row changed to, where `direction` is not STAY
    own_advice_mps2: Value  # acceleration that the vehicle asks of itself until the next decision; inf where none
    asked_advice_mps2: Value  # acceleration that others ask of it; inf where none
    gain_left_memory: Value  # updated memory
    gain_right_memory: Value  # updated memory
    keep_right_memory: Value  # updated memory
    look_ahead_speed_mps: Value  # updated memory


class RouteNeed(eqx.Module):
    """What the route demands of a vehicle in one row."""

    best_lane_offset: Int[Array, " vehicle"]  # lane changes to the lane that the route needs, left positive
    remaining_m: Value  # distance that the route can still be followed in this row
    from_edge_m: Value  # the same, measured from where the current edge begins (SUMO's LaneQ.length)
    occupied_m: Value  # length taken by the vehicles ahead in this row as far as the route can be followed in it


class Side(eqx.Module):
    """One side of every vehicle."""

    is_open: Bool[Array, " vehicle"]  # whether there is a lane to change to
    row: Int[Array, " vehicle"]  # that row; any valid row where there is none
    leader_entry: Int[Array, " vehicle"]  # entry ahead in that row
    leader_exists: Bool[Array, " vehicle"]  # whether it is a vehicle
    leader_gap_m: Value  # gap to it less the own jam gap (SUMO's convention); inf where there is none
    leader_speed_mps: Value
    leader_acceleration_mps2: Value  # its last acceleration
    leader_max_speed_mps: Value  # speed that it wants on that lane
    leader_class: Int[Array, " vehicle"]
    follower_entry: Int[Array, " vehicle"]  # entry behind in that row
    follower_exists: Bool[Array, " vehicle"]  # whether it is a vehicle
    follower_gap_m: Value  # gap to it less its jam gap; inf where there is none
    follower_speed_mps: Value
    follower_acceleration_mps2: Value  # its last acceleration
    follower_max_speed_mps: Value  # speed that it wants on that lane
    follower_class: Int[Array, " vehicle"]
    need: RouteNeed  # what the route demands in that row
    leads_elsewhere: Bool[Array, " vehicle"]  # whether that lane goes on to another road than the route's
