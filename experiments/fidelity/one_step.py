"""`python -m experiments.fidelity.one_step CASE`: one decision and step of the surrogate from each of SUMO's states.

Whole drives tell that two simulators differ, not where. Here the surrogate begins anew at every step where SUMO is, so
each difference is that of one rule. What SUMO keeps to itself - the memories of its lane changing - is what the
surrogate's own decisions on SUMO's earlier states made of it.

SUMO moves first and changes lanes then; both of a step's lane changes and the speeds that follow in the next step are
compared: the decision is made on the positions after the move, in the lanes from before the change.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console
from rich.table import Table

from jaxcalib.problem.problem import CalibrationProblem, read_problem
from surrogate.lane_change.decide import decide
from surrogate.lane_change.vehicles_on_road import VehiclesOnRoad
from surrogate.loop.moving import move_on
from surrogate.loop.step import initial_state, look_up_lane, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.traffic_state import EMPTY, HEAD, TrafficState, with_changes
from surrogate.vehicle.lane_change_model import STAY

SPARE = 1.5  # room for vehicles over those of the fullest moment of the first second
NEAR_MPS2 = 0.05  # accelerations that differ by less are alike
FAR_MPS2 = 0.3
MEMORIES = ("gain_left_memory", "gain_right_memory", "keep_right_memory", "look_ahead_speed_mps")
app = App(name="experiments.fidelity.one_step", help="One step of the surrogate from each of SUMO's states.")


class Vehicle(NamedTuple):
    """A vehicle of SUMO in the surrogate's terms."""

    edge: str  # its edge, or the one before it inside a junction
    row: int  # its row
    position_m: float  # along the route
    speed_mps: float  # its speed
    acceleration_mps2: float  # over the last step
    speed_factor: float  # desired speed over the limit
    vehicle_class: int  # index of its vType
    destination: int  # index of the last edge of its route


Snapshot = Mapping[str, Vehicle]


@app.default
def one_step(
    case: Path,
    /,
    *,
    begin: Annotated[float, Parameter(validator=Number(gte=1))] = 300.0,
    end: Annotated[float, Parameter(validator=Number(gte=1))] = 330.0,
    burn_in: Annotated[float, Parameter(validator=Number(gte=0))] = 20.0,
    seed: int = 0,
    out: Path | None = None,
) -> int:
    """Compare one step of both simulators from each of SUMO's states.

    Parameters
    ----------
    case
        Case whose scenario runs.
    begin
        Time in s from which states are taken.
    end
        Time in s up to which they are taken.
    burn_in
        Time in s before `begin` in which memories form; nothing is counted then.
    seed
        Of SUMO's run.
    out
        CSV file for every vehicle and step.
    """
    problem = read_problem(case)
    steps = compare_steps(problem, begin, end, seed, burn_in)
    if out is not None:
        steps.to_csv(out, index=False)
    Console().print(table_of(steps))
    return 0


def compare_steps(
    problem: CalibrationProblem, begin_s: float, end_s: float, seed: int, burn_in_s: float
) -> pd.DataFrame:
    """Return a row for each vehicle and step.

    Args:
        problem: the problem whose scenario runs, with the values that it has.
        begin_s: first time.
        end_s: last time.
        seed: of SUMO's run.
        burn_in_s: time before the first in which memories form.
    """
    world = problem.template.world(
        jnp.asarray(problem.template.base_values(), jnp.float32), jnp.asarray(seed), jnp.asarray(end_s + 1e4)
    )
    clock = Clock(problem.parts.scenario.step_s, 1)
    rows: list[dict[str, Any]] = []
    states: _States | None = None
    memories: dict[str, tuple[float, ...]] = {}
    before: Snapshot | None = None
    now: Snapshot | None = None
    for number, after in enumerate(snapshots(problem, begin_s - burn_in_s, end_s, seed)):
        if before is not None and now is not None:
            states = states or _States(world, clock, int(SPARE * len(now)) + problem.scenario.row_map.num_rows + 32)
            # in the lanes from before the change, where the edge is still the same
            held = {
                name: vehicle._replace(row=before[name].row) if before[name].edge == vehicle.edge else vehicle
                for name, vehicle in now.items()
                if name in before
            }
            found = states.step(held, memories)
            memories = {
                name: (0.0,) * len(MEMORIES) if now[name].row != held[name].row else one["memories"]
                for name, one in found.items()
            }
            if number * clock.step_s >= burn_in_s:
                pairs = ((name, one) for name, one in found.items() if name in after)
                rows += [_row(held[name], now[name], after[name], one, clock) for name, one in pairs]
        before, now = now, after
    return pd.DataFrame(rows)


def _row(held: Vehicle, now: Vehicle, after: Vehicle, found: Mapping[str, Any], clock: Clock) -> dict[str, Any]:
    asked, own = found["asked_advice_mps2"], found["own_advice_mps2"]
    kind = "must change lane" if found["must_change"] else "asked by others" if np.isfinite(asked) else "all others"
    return {
        "kind": kind,
        "position_m": held.position_m,
        "row": held.row,
        "speed_mps": now.speed_mps,
        "sumo_mps2": (after.speed_mps - now.speed_mps) / clock.step_s,
        "surrogate_mps2": (found["speed_mps"] - now.speed_mps) / clock.step_s,
        "own_advice_mps2": own,
        "asked_advice_mps2": asked,
        "sumo_changes": now.row != held.row,
        "surrogate_changes": found["row"] != held.row,
    }


def table_of(steps: pd.DataFrame) -> Table:
    """Return how far both agree, by what the vehicles are at."""
    table = Table(title="one step from SUMO's states: accelerations of those whose lane is the same, lane changes")
    for heading in (
        "vehicles", "steps", f"within {NEAR_MPS2:g} m/s²", f"{FAR_MPS2:g} m/s² too high", "too low", "mean, m/s²",
        "SUMO changes", "surrogate", "both",
    ):  # fmt: skip
        table.add_column(heading)
    for kind, group in [*steps.groupby("kind"), ("all", steps)]:
        same = group[group["sumo_changes"] == group["surrogate_changes"]]
        apart = same["surrogate_mps2"] - same["sumo_mps2"]
        table.add_row(
            str(kind), str(len(group)), f"{(apart.abs() <= NEAR_MPS2).mean():.2%}", f"{(apart > FAR_MPS2).mean():.2%}",
            f"{(apart < -FAR_MPS2).mean():.2%}", f"{apart.mean():+.3f}", str(group["sumo_changes"].sum()),
            str(group["surrogate_changes"].sum()), str((group["sumo_changes"] & group["surrogate_changes"]).sum()),
        )  # fmt: skip
    return table


class _States:
    """Makes states of the surrogate from SUMO's, and steps from there; one program for all."""

    def __init__(self, world: World, clock: Clock, capacity: int) -> None:
        """Compile nothing yet."""
        self._world, self._clock, self._capacity = world, clock, capacity
        self._numbers: dict[str, int] = defaultdict(lambda: len(self._numbers) + 1)
        self._empty: TrafficState = jax.jit(lambda world: initial_state(world, capacity, clock))(world)
        self._go = jax.jit(self._decide_and_move)

    def _decide_and_move(self, state: TrafficState, world: World) -> tuple[Any, TrafficState]:
        on_road = VehiclesOnRoad(state.vehicles, world.road, state.head)
        state = eqx.tree_at(lambda s: s.vehicles, state, look_up_lane(state.vehicles, on_road))
        on_road = VehiclesOnRoad(state.vehicles, world.road, state.head)
        decision = decide(on_road, world.classes, self._clock.interval_s, self._clock.step_s)
        settled = settle_lanes(state, world, self._clock)
        return decision, move_on(settled, world, self._clock.step_s, 1)

    def step(self, snapshot: Snapshot, memories: Mapping[str, tuple[float, ...]]) -> dict[str, dict[str, Any]]:
        """Return what the surrogate makes of each vehicle."""
        state, names = self._state_of(snapshot, memories)
        decision, moved = jax.device_get(self._go(state, self._world))
        is_vehicle = np.asarray(moved.vehicles.vehicle_class) >= 0
        entry_of = {int(number): entry for entry, number in enumerate(moved.vehicles.identity) if is_vehicle[entry]}
        found = {}
        for entry, name in names.items():
            entry_after = entry_of.get(self._numbers[name])
            if entry_after is None:
                continue
            is_staying = decision.direction[entry] == STAY
            found[name] = {
                "row": snapshot[name].row if is_staying else int(decision.target_row[entry]),
                "speed_mps": float(moved.vehicles.speed_mps[entry_after]),
                "own_advice_mps2": float(decision.own_advice_mps2[entry]),
                "asked_advice_mps2": float(decision.asked_advice_mps2[entry]),
                "must_change": bool(np.isfinite(moved.vehicles.stop_position_m[entry_after])),
                "memories": tuple(float(getattr(decision, memory)[entry]) for memory in MEMORIES),
            }
        return found

    def _state_of(
        self, snapshot: Snapshot, memories: Mapping[str, tuple[float, ...]]
    ) -> tuple[TrafficState, dict[int, str]]:
        empty, num_rows = self._empty.vehicles, self._world.road.num_rows
        fields = ("position_m", "speed_mps", "acceleration_mps2", "row", "vehicle_class", "destination", "speed_factor")
        columns = {name: np.array(getattr(empty, name)) for name in (*fields, "identity", *MEMORIES)}
        columns["position_m"][:], columns["vehicle_class"][:], columns["row"][:] = -np.inf, EMPTY, num_rows
        head, names, entry = [], {}, 0
        for row in range(num_rows):
            head.append(entry)
            columns["position_m"][entry], columns["vehicle_class"][entry], columns["row"][entry] = np.inf, HEAD, row
            entry += 1
            there = [(name, vehicle) for name, vehicle in snapshot.items() if vehicle.row == row]
            for name, vehicle in sorted(there, key=lambda one: -one[1].position_m):
                for field in fields:
                    columns[field][entry] = getattr(vehicle, field)
                columns["identity"][entry] = self._numbers[name]
                for memory, value in zip(MEMORIES, memories.get(name, (0.0,) * len(MEMORIES)), strict=True):
                    columns[memory][entry] = value
                names[entry] = name
                entry += 1
        if entry > self._capacity:
            raise RuntimeError(
                f"Expected at most {self._capacity} vehicles and rows, got {entry}; take a shorter time."
            )
        arrays: dict[str, Any] = {
            name: jnp.asarray(column, getattr(empty, name).dtype) for name, column in columns.items()
        }
        vehicles = with_changes(empty, **arrays)
        heads = jnp.asarray([*head, entry], jnp.int32)
        return eqx.tree_at(lambda s: (s.vehicles, s.head), self._empty, (vehicles, heads)), names


def snapshots(problem: CalibrationProblem, begin_s: float, end_s: float, seed: int) -> Iterator[Snapshot]:
    """Yield SUMO's state after each step between two times."""
    import libsumo

    scenario = problem.scenario
    network, row_of_lane = scenario.row_map.network, scenario.row_map.row_of_lane
    classes = {name: number for number, name in reversed(list(enumerate(problem.template.class_names)))}
    config = str(problem.parts.scenario.config_file)
    libsumo.start(["sumo", "-c", config, "--seed", str(seed), "--no-step-log", "--no-warnings"])
    vehicle = libsumo.vehicle
    fixed: dict[str, tuple[float, int, int]] = {}
    try:
        while libsumo.simulation.getTime() < end_s:
            libsumo.simulationStep()
            if libsumo.simulation.getTime() < begin_s:
                continue
            found = {}
            for name in vehicle.getIDList():
                lane = vehicle.getLaneID(name)
                if lane.startswith(":"):
                    place = network.junction_lanes.get(lane)
                    if place is None:
                        continue
                    key, start_m = place
                else:
                    edge, _, index = lane.rpartition("_")
                    key = (edge, int(index))
                    if key not in row_of_lane:
                        continue
                    start_m = network.lanes[key].start_m
                if name not in fixed:
                    last = vehicle.getRoute(name)[-1]
                    if last not in scenario.destinations:
                        continue
                    factor, vtype = vehicle.getSpeedFactor(name), vehicle.getTypeID(name)
                    fixed[name] = factor, classes[vtype], scenario.destinations.index(last)
                position_m = start_m + vehicle.getLanePosition(name)
                motion = vehicle.getSpeed(name), vehicle.getAcceleration(name)
                found[name] = Vehicle(key[0], row_of_lane[key], position_m, *motion, *fixed[name])
            yield found
    finally:
        libsumo.close()


if __name__ == "__main__":
    sys.exit(app())
