"""A lane change that takes time, in SUMO and in the surrogate, step by step."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from surrogate.lane_change.cooperation import NO_ADVICE
from surrogate.lane_change.manoeuvre import ChangeTiming, after_reorder, change_timing, idle_manoeuvres, with_duration
from surrogate.loop.kinematics import move
from surrogate.road.neighbours import entry_ahead, leader_at, own_leader
from surrogate.road.reorder import Moves, new_order, rearrange
from surrogate.road.traffic_state import VehicleArrays, empty_vehicles, with_changes
from surrogate.vehicle.lane_change_model import LEFT, STAY, LaneChangeDecision, Reason
from surrogate.vehicle.vehicle_class import VehicleClass

STEP_S = 0.1
NUM_STEPS = 80
CHANGE_STEP = 21  # after whose movement the change begins
ATTRIBUTES = {"tau": 1.2, "accel": 1.5, "decel": 2.0, "minGap": 2.0, "length": 5.0, "emergencyDecel": 9.0}
# name, lane, place, speed, desired speed; the changing vehicle comes first
VEHICLES = (
    ("changer", 0, 330.0, 14.0, 28.0),
    ("old_leader", 0, 400.0, 14.0, 14.0),
    ("old_follower", 0, 290.0, 14.0, 28.0),
    ("new_leader", 1, 380.0, 15.0, 15.0),
    ("new_follower", 1, 270.0, 18.0, 28.0),
)
LIMIT_MPS = 30.0
NET = f"""<net version="1.20">
 <location netOffset="0.00,0.00" convBoundary="0.00,0.00,5000,0.00" origBoundary="0,0,0,0" projParameter="!"/>
 <edge id="road" from="a" to="b">
  <lane id="road_0" index="0" speed="{LIMIT_MPS}" length="5000" shape="0,-4.8 5000,-4.8"/>
  <lane id="road_1" index="1" speed="{LIMIT_MPS}" length="5000" shape="0,-1.6 5000,-1.6"/>
 </edge>
 <junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-6.4"/>
 <junction id="b" type="dead_end" x="5000" y="0" incLanes="road_0 road_1" intLanes="" shape="5000,0 5000,-6.4"/>
</net>
"""


@dataclass(frozen=True)
class Change:
    """What happened, after each step."""

    position_m: Float[np.ndarray, "step vehicle"]  # front bumpers
    speed_mps: Float[np.ndarray, "step vehicle"]  # speeds
    acceleration_mps2: Float[np.ndarray, "step vehicle"]  # accelerations
    lane: Int[np.ndarray, "step vehicle"]  # lanes, counted from the right


def timed_change_table(durations_s: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 4.0)) -> list[dict[str, Any]]:
    """Return the largest difference in position and the times of the change of lane, for each duration."""
    rows = []
    for duration_s in durations_s:
        theirs = in_sumo(duration_s)
        ours = in_surrogate(duration_s, theirs)
        rows.append(
            {
                "duration_s": duration_s,
                "largest_difference_m": float(np.abs(ours.position_m - theirs.position_m).max()),
                "lane_differs_steps": int(np.sum(ours.lane != theirs.lane)),
                "old_lane_until_s": STEP_S * float(np.argmax(theirs.lane[:, 0] == 1) - CHANGE_STEP),
            }
        )
    return rows


def in_sumo(duration_s: float) -> Change:
    """Return the change in SUMO."""
    written = " ".join(f'{name}="{value}"' for name, value in ATTRIBUTES.items())
    lines = ['<route id="r" edges="road"/>']
    for name, lane, place_m, speed_mps, desired_mps in VEHICLES:
        lines.append(f'<vType id="{name}" carFollowModel="IDM" speedDev="0" maxSpeed="{desired_mps}" {written}/>')
        lines.append(
            f'<vehicle id="{name}" type="{name}" route="r" depart="0" departLane="{lane}" departPos="{place_m}" '
            f'departSpeed="{speed_mps}" insertionChecks="none"/>'
        )
    with TemporaryDirectory(prefix="jaxcalib-change-") as name:
        folder = Path(name)
        (folder / "net.net.xml").write_text(NET, encoding="utf-8")
        (folder / "demand.rou.xml").write_text("<routes>" + "\n".join(lines) + "</routes>", encoding="utf-8")
        subprocess.run(
            [sys.executable, "-m", "experiments.fidelity.sumo_timed_change", name, str(duration_s)],
            check=True, capture_output=True, cwd=Path(__file__).parents[2],
        )  # fmt: skip
        arrays = np.load(folder / "change.npy")
    return Change(arrays[0], arrays[1], arrays[2], arrays[3].astype(int))


def in_surrogate(duration_s: float, theirs: Change) -> Change:
    """Return the change in the surrogate, from SUMO's state after the first step."""
    timing = change_timing(duration_s, STEP_S, STEP_S)
    classes = tuple(
        vehicle_class(attribute_values({}, "IDM") | ATTRIBUTES | {"maxSpeed": vehicle[4], "speedDev": 0.0}, "IDM")
        for vehicle in VEHICLES
    )
    vehicles = _start(theirs)
    head = jnp.asarray([0, 4, 7], jnp.int32)
    manoeuvres = idle_manoeuvres(len(vehicles.row))
    advance = jax.jit(lambda v, h, m, begins: _advance(v, h, m, begins, classes, timing))
    states: list[tuple[np.ndarray, ...]] = [
        (theirs.position_m[0], theirs.speed_mps[0], theirs.acceleration_mps2[0], theirs.lane[0])
    ]
    for step in range(1, NUM_STEPS):
        vehicles, head, manoeuvres = advance(vehicles, head, manoeuvres, jnp.asarray(step == CHANGE_STEP))
        order = np.argsort(np.where(np.asarray(vehicles.is_vehicle), np.asarray(vehicles.vehicle_class), 99))
        order = order[: len(VEHICLES)]
        arrays = (vehicles.position_m, vehicles.speed_mps, vehicles.acceleration_mps2, vehicles.row)
        states.append(tuple(np.asarray(array)[order] for array in arrays))
    return Change(*(np.stack(column) for column in zip(*states, strict=True)))


def _start(theirs: Change) -> VehicleArrays:
    """Return the vehicles of SUMO's first step: two rows, each with its head before its vehicles."""
    order = sorted(range(len(VEHICLES)), key=lambda index: (VEHICLES[index][1], -VEHICLES[index][2]))
    rows = [[index for index in order if VEHICLES[index][1] == lane] for lane in (0, 1)]
    entries = [-1, *rows[0], -1, *rows[1]]
    vehicles = empty_vehicles(2, len(entries) + 1)
    lane = [0] * (1 + len(rows[0])) + [1] * (1 + len(rows[1]))
    for entry, (index, row) in enumerate(zip(entries, lane, strict=True)):
        vehicles = _put(vehicles, entry, row, index, theirs)
    return with_changes(
        vehicles, speed_limit_mps=jnp.full(len(entries) + 1, LIMIT_MPS, jnp.float32),
        row=jnp.asarray([*lane, 2], jnp.int32),
    )  # fmt: skip


def _put(vehicles: VehicleArrays, entry: int, row: int, index: int, theirs: Change) -> VehicleArrays:
    is_head = index < 0
    values = {
        "position_m": np.inf if is_head else theirs.position_m[0, index],
        "speed_mps": 0.0 if is_head else theirs.speed_mps[0, index],
        "acceleration_mps2": 0.0 if is_head else theirs.acceleration_mps2[0, index],
        "vehicle_class": index,
        "identity": max(index, 0),
        "row": row,
    }
    return with_changes(
        vehicles, **{name: getattr(vehicles, name).at[entry].set(value) for name, value in values.items()}
    )


def _advance(
    vehicles: VehicleArrays,
    head: jax.Array,
    manoeuvres: Any,
    begins: jax.Array,
    classes: tuple[VehicleClass, ...],
    timing: ChangeTiming | None,
) -> tuple[VehicleArrays, jax.Array, Any]:
    """Return the state after one step of movement and the decisions that follow."""
    zero = jnp.zeros((), jnp.int32)
    beside = None if timing is None else leader_at(manoeuvres.second_leader, vehicles)
    vehicles, _ = move(vehicles, own_leader(vehicles), classes, jnp.ones(()), zero, zero, STEP_S, leader_beside=beside)
    nothing = jnp.zeros_like(vehicles.speed_mps)
    goes = begins & (vehicles.vehicle_class == 0)
    target = jnp.ones_like(vehicles.row)
    decision = LaneChangeDecision(
        direction=jnp.where(goes, LEFT, STAY).astype(jnp.int32),
        reason=jnp.full_like(vehicles.row, int(Reason.SPEED_GAIN)),
        entry_ahead=entry_ahead(vehicles.position_m, target, vehicles.position_m, head),
        target_row=target,
        own_advice_mps2=nothing + NO_ADVICE, asked_advice_mps2=nothing + NO_ADVICE, gain_left_memory=nothing,
        gain_right_memory=nothing, keep_right_memory=nothing, look_ahead_speed_mps=nothing,
    )  # fmt: skip
    closed = None
    if timing is not None:
        decision, manoeuvres, closed = with_duration(decision, manoeuvres, vehicles, head, timing)
    nobody = jnp.zeros((1, 1), jnp.int32)
    moves = Moves(
        leaves_road=jnp.zeros_like(goes), changes_row=decision.direction != STAY, entry_ahead=decision.entry_ahead,
        entrant_ahead=nobody, entrant_enters=nobody > 0, entrant_rank=nobody, closed=closed,
    )  # fmt: skip
    order = new_order(moves, vehicles, head)
    old_row = vehicles.row
    vehicles = with_changes(vehicles, row=jnp.where(order.has_moved, decision.target_row, old_row))
    newcomer = jax.tree.map(lambda leaf: leaf[-1:], empty_vehicles(2, 3))
    vehicles = rearrange(vehicles, newcomer, order)
    vehicles = eqx.tree_at(lambda v: v.speed_limit_mps, vehicles, jnp.full_like(nothing, LIMIT_MPS))
    if timing is not None:
        lengths_m = jnp.full_like(nothing, ATTRIBUTES["length"])
        manoeuvres = after_reorder(manoeuvres, old_row, order, vehicles, lengths_m, timing)
    return vehicles, order.head, manoeuvres
