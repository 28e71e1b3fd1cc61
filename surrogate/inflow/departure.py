"""How vehicles depart, where not all do it in SUMO's ways "best", "last" and "avg".

Which lanes a vehicle may enter by its departLane stands in `Inflow.serves`; here are the ways of its departPos and
departSpeed.
"""

import enum

import equinox as eqx
from jaxtyping import Array, Float, Int


class Lane(enum.IntEnum):
    """Which of the lanes that serve him a vehicle takes: what is left of SUMO's departLane."""

    FREE = 0  # that with most room before its last vehicle
    PROBABLE = 1  # the same, but not left of a last vehicle that wants to go faster
    RANDOM = 2  # any, anew at each attempt


class Position(enum.IntEnum):
    """Where on its edge a vehicle enters: SUMO's departPos."""

    LAST = 0  # behind the last vehicle, as close as is safe
    BASE = 1  # with its rear at the edge's begin
    GIVEN = 2  # at a number, counted from the edge's end where it is negative
    FREE = 3  # with its front at the edge's begin, or in a gap
    RANDOM = 4  # anywhere, anew at each attempt
    RANDOM_FREE = 5  # the first free one of ten anywhere, else as FREE


class Speed(enum.IntEnum):
    """How fast a vehicle enters: SUMO's departSpeed."""

    AVERAGE = 0  # mean of the vehicles on the lane
    GIVEN = 1
    MAX = 2  # as wanted, or as fast as is safe
    DESIRED = 3  # as wanted, or not at all
    LIMIT = 4  # the legal limit, or not at all
    LAST = 5  # that of the last vehicle on the lane
    RANDOM = 6  # anything up to the wanted one, or as fast as is safe


ADAPTS = (Speed.MAX, Speed.RANDOM)  # speeds that give way to who is ahead; with the others a vehicle waits


class Departure(eqx.Module):
    """How one vehicle departs; choices of the trace."""

    position: Position = eqx.field(static=True)
    position_m: float = eqx.field(static=True)
    speed: Speed = eqx.field(static=True)
    speed_mps: float = eqx.field(static=True)


class DepartureRules(eqx.Module):
    """How the vehicles of each flow of each queue depart."""

    lane: Int[Array, " queue"]  # on which of the lanes that serve; see `Lane`
    position: Int[Array, "queue flow"]  # where; see `Position`
    position_m: Float[Array, "queue flow"]  # the number, for those at one
    speed: Int[Array, "queue flow"]  # how fast; see `Speed`
    speed_mps: Float[Array, "queue flow"]  # the number, for those with one
    subject: Departure  # how the subject vehicle departs
    has_random_lanes: bool = eqx.field(static=True)  # whether any lane is random
    has_probable_lanes: bool = eqx.field(static=True)  # whether any is the probable one
    positions: tuple[Position, ...] = eqx.field(static=True)  # all ways that occur
    speeds: tuple[Speed, ...] = eqx.field(static=True)  # the same for speeds
