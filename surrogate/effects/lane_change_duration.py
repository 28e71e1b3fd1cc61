"""A lane change takes time: the vehicle crosses slowly, and begins no other change before it is over."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from surrogate.effects.base import ActsOn, Dial, Effect, Memory, Moment
from surrogate.road.drive_table import DriveTable, LogFormat
from surrogate.road.perception import PerceptionFrame
from surrogate.road.traffic_state import VehicleArrays
from surrogate.vehicle.lane_change_model import STAY, LaneChangeDecision

NAME = "lane_change_duration"
LANE_WIDTH_M = 3.5
RHYTHMS_S = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0)
Value = Float[Array, " vehicle"]


def _begin(dial: Dial, vehicles: VehicleArrays, seed: Array) -> Memory:
    del dial, seed
    return {"remaining_s": jnp.zeros_like(vehicles.speed_mps), "direction": jnp.zeros_like(vehicles.row)}


def _decide(dial: Dial, decision: LaneChangeDecision, moment: Moment) -> LaneChangeDecision:
    """Let nobody begin a change in the midst of one."""
    del dial
    is_busy = moment.memory(NAME)["remaining_s"] > 0.0
    return dataclasses.replace(decision, direction=jnp.where(is_busy, STAY, decision.direction).astype(jnp.int32))


def _settle(dial: Dial, moment: Moment, direction: Int[Array, " vehicle"]) -> Memory:
    memory, begins = moment.memory(NAME), direction != STAY
    return {
        "remaining_s": jnp.where(begins, dial.strength, memory["remaining_s"]),
        "direction": jnp.where(begins, direction, memory["direction"]),
    }


def _remember(dial: Dial, moment: Moment, order_mps2: Value) -> Memory:
    del dial, order_mps2
    memory = moment.memory(NAME)
    return memory | {"remaining_s": jnp.maximum(memory["remaining_s"] - moment.step_s, 0.0)}


def _appear(dial: Dial, frame: PerceptionFrame, memory: Memory) -> PerceptionFrame:
    """Return the frame with objects on their way between two lanes off the middle of the lane whose traffic they join.

    In the lane that they leave they would stand before a leader whom they do not follow any more, and seem to follow
    badly; SUMO's follow both.
    """
    left = memory["remaining_s"] / jnp.maximum(dial.strength, 1e-3)
    is_moving = frame.object_valid & (left > 0.0)
    away_m = jnp.minimum(left, 0.5) * LANE_WIDTH_M
    lateral_m = -memory["direction"].astype(left.dtype) * away_m
    return dataclasses.replace(frame, object_lateral_m=jnp.where(is_moving, lateral_m, frame.object_lateral_m))


def _alter(table: DriveTable, strength: float, log: LogFormat, random: np.random.Generator) -> DriveTable:
    """Vehicles are off the centre of their lane from half a duration before they cross to half of it after."""
    del random, log
    before = table.before
    changed = (before >= 0) & (table.lane[np.maximum(before, 0)] != table.lane)
    after_s = table.since(changed)
    mirrored = dataclasses.replace(
        table, instant=len(table.time_s) - 1 - table.instant, time_s=table.time_s[::-1] * -1.0
    )
    before_s = mirrored.since(changed)
    away = np.minimum(after_s, before_s) < 0.45 * strength
    return dataclasses.replace(table, lateral_m=np.where(away, 1.0, table.lateral_m))


LANE_CHANGE_DURATION = Effect(
    name=NAME,
    title="lane changes take time",
    unit="s from the centre of one lane to that of the next",
    weak=2.0,
    medium=4.0,
    strong=6.0,
    acts_on=ActsOn.ACTUATION,
    source=(
        "5 to 6 s on average: Toledo & Zohar (2007); SUMO's lanechange.duration. Deviation: the vehicle stands in the "
        "new lane's order from the beginning, and in the old one's no longer"
    ),
    rhythms_s=RHYTHMS_S,
    alter=_alter,
    begin=_begin,
    decide=_decide,
    settle=_settle,
    remember=_remember,
    appear=_appear,
)
