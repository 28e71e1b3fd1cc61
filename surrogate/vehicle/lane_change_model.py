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
    """What every vehicle does about its lane at one decision.

    Attributes:
        direction: RIGHT, STAY or LEFT; only changes that are safe now.
        reason: a `Reason`, where `direction` is not STAY.
        entry_ahead: entry of the leader in the target row, where `direction` is not STAY.
        target_row: row changed to, where `direction` is not STAY.
        own_advice_mps2: acceleration that the vehicle asks of itself until the next decision; inf where none.
        asked_advice_mps2: acceleration that others ask of it; inf where none.
        gain_left_memory: updated memory.
        gain_right_memory: updated memory.
        keep_right_memory: updated memory.
        look_ahead_speed_mps: updated memory.
    """

    direction: Int[Array, " vehicle"]
    reason: Int[Array, " vehicle"]
    entry_ahead: Int[Array, " vehicle"]
    target_row: Int[Array, " vehicle"]
    own_advice_mps2: Value
    asked_advice_mps2: Value
    gain_left_memory: Value
    gain_right_memory: Value
    keep_right_memory: Value
    look_ahead_speed_mps: Value


class RouteNeed(eqx.Module):
    """What the route demands of a vehicle in one row.

    Attributes:
        best_lane_offset: lane changes to the lane that the route needs, left positive.
        remaining_m: distance that the route can still be followed in this row.
        from_edge_m: the same, measured from where the current edge begins (SUMO's LaneQ.length).
        occupied_m: length taken by the vehicles ahead in this row as far as the route can be followed in it.
    """

    best_lane_offset: Int[Array, " vehicle"]
    remaining_m: Value
    from_edge_m: Value
    occupied_m: Value


class Side(eqx.Module):
    """One side of every vehicle.

    Attributes:
        is_open: whether there is a lane to change to.
        row: that row; any valid row where there is none.
        leader_entry: entry ahead in that row.
        leader_exists: whether it is a vehicle.
        leader_gap_m: gap to it less the own jam gap (SUMO's convention); inf where there is none.
        leader_speed_mps: its speed.
        leader_acceleration_mps2: its last acceleration.
        leader_max_speed_mps: speed that it wants on that lane.
        leader_class: its class.
        follower_entry: entry behind in that row.
        follower_exists: whether it is a vehicle.
        follower_gap_m: gap to it less its jam gap; inf where there is none.
        follower_speed_mps: its speed.
        follower_acceleration_mps2: its last acceleration.
        follower_max_speed_mps: speed that it wants on that lane.
        follower_class: its class.
        need: what the route demands in that row.
        leads_elsewhere: whether that lane goes on to another road than the route's.
    """

    is_open: Bool[Array, " vehicle"]
    row: Int[Array, " vehicle"]
    leader_entry: Int[Array, " vehicle"]
    leader_exists: Bool[Array, " vehicle"]
    leader_gap_m: Value
    leader_speed_mps: Value
    leader_acceleration_mps2: Value
    leader_max_speed_mps: Value
    leader_class: Int[Array, " vehicle"]
    follower_entry: Int[Array, " vehicle"]
    follower_exists: Bool[Array, " vehicle"]
    follower_gap_m: Value
    follower_speed_mps: Value
    follower_acceleration_mps2: Value
    follower_max_speed_mps: Value
    follower_class: Int[Array, " vehicle"]
    need: RouteNeed
    leads_elsewhere: Bool[Array, " vehicle"]
