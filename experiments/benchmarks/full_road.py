"""The corridor stretched to any length and full of traffic from the beginning, for one core."""

import dataclasses
import time
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxcalib.problem.engines import DECISION_INTERVAL_S, OBJECTS_PER_ROW
from jaxcalib.problem.problem import CalibrationProblem
from sim_adapters.jax.simulator import usual_runs_per_device
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.loop.run_state import RunPlan, RunRecord
from surrogate.loop.simulate import observe_batch
from surrogate.loop.step import initial_state
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor
from surrogate.road.road import Road
from surrogate.road.traffic_state import TrafficState, with_changes
from surrogate.xla.materialise import compiler_options

SPACING_M = 40.0  # 25 veh/km and lane: dense but free
SPEED_MPS = 22.0
FIRST_ARRIVAL = 500_000  # numbers of the vehicles that are there from the beginning; nobody else gets them
SPARE = 1.1  # room for those who enter meanwhile
MORE_ROOM = 64


@dataclass(frozen=True)
class Cost:
    """What one road costs on one core."""

    vehicles: int  # vehicles on a road at the beginning
    sets: int  # roads in one batch
    vehicle_steps: int  # of one call
    wall_s: float  # of one call, the least of all
    cpu_s: float  # processor time of one call, the least of all
    compile_s: float  # to trace and compile
    bytes_per_vehicle_and_set: float  # memory over vehicles and sets
    num_collisions: int  # vehicle steps with overlap, of one call


def measure_road(
    problem: CalibrationProblem, num_vehicles: int, simulated_s: float, least_s: float, num_runs: int | None = None
) -> Cost:
    """Return what a full road costs.

    Args:
        problem: whose road is stretched, and whose observer, sensors and steps are used.
        num_vehicles: vehicles on it.
        simulated_s: length of a run, a multiple of 10 s.
        least_s: it is repeated for as long as this, and three times at least.
        num_runs: roads in a batch; as many as a calibration takes unless given.
    """
    template = stretched(problem.template, num_vehicles)
    capacity = int(SPARE * num_vehicles) + MORE_ROOM
    num_runs = num_runs or usual_runs_per_device(capacity)
    clock = Clock(problem.parts.scenario.step_s, round(DECISION_INTERVAL_S / problem.parts.scenario.step_s))
    plan = RunPlan(clock, capacity + template.road.num_rows, round(problem.frame_interval_s / clock.step_s))
    perception = problem.case.perception
    sensor = Sensor(jnp.asarray(perception.ahead_m), jnp.asarray(perception.behind_m), OBJECTS_PER_ROW)
    axes = template.batch_axes(False)

    def drive(values: jax.Array, seeds: jax.Array, departs_s: jax.Array, state: TrafficState) -> RunRecord:
        worlds = jax.vmap(template.world, out_axes=axes)(values, seeds, departs_s)
        states = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_runs, *leaf.shape)), state)
        end_s = jnp.asarray(simulated_s, jnp.float32)
        return observe_batch(worlds, axes, sensor, problem.tally, plan, jnp.zeros(()), end_s, states)

    spread = np.linspace(0.97, 1.03, num_runs)[:, None]
    arguments = (
        jnp.asarray(template.base_values() * spread, jnp.float32),
        jnp.arange(num_runs, dtype=jnp.int32),
        jnp.full((num_runs,), 2.0, jnp.float32),
        filled(template, num_vehicles, plan),
    )
    began = time.perf_counter()
    program = jax.jit(drive).lower(*arguments).compile(compiler_options())
    compile_s = time.perf_counter() - began
    record, walls, processors = program(*arguments), [], []
    jax.block_until_ready(record)
    while len(walls) < 3 or sum(walls) < least_s:
        began, began_cpu = time.perf_counter(), time.process_time()
        record = jax.block_until_ready(program(*arguments))
        walls.append(time.perf_counter() - began)
        processors.append(time.process_time() - began_cpu)
    if int(record.num_lost.sum()) or not bool(record.is_finite.all()):
        raise RuntimeError(f"Expected a road of {num_vehicles} vehicles to have room and to stay finite.")
    memory = program.memory_analysis()
    if memory is None:
        raise RuntimeError("These devices do not tell how much memory a program needs.")
    num_bytes = memory.temp_size_in_bytes + memory.argument_size_in_bytes + memory.output_size_in_bytes
    return Cost(
        vehicles=num_vehicles,
        sets=num_runs,
        vehicle_steps=int(np.asarray(record.num_vehicle_steps, np.int64).sum()),
        wall_s=min(walls),
        cpu_s=min(processors),
        compile_s=compile_s,
        bytes_per_vehicle_and_set=num_bytes / (num_runs * num_vehicles),
        num_collisions=int(record.num_collisions.sum()),
    )


def stretched(template: WorldTemplate, num_vehicles: int) -> WorldTemplate:
    """Return the scenario on a road so long that so many vehicles have room; all lengths grow alike."""
    factor = num_vehicles * SPACING_M / (len(through_rows(template)) * float(end_m(template)))
    names = [name for name in Road.__dataclass_fields__ if name.endswith("_m")]
    longer = {name: getattr(template.road, name) * factor for name in names}
    road = dataclasses.replace(template.road, **longer)
    return dataclasses.replace(template, road=road, edge_m=template.edge_m * factor)


def filled(template: WorldTemplate, num_vehicles: int, plan: RunPlan) -> TrafficState:
    """Return the road with vehicles at even distances in all rows that go all the way."""
    state = jax.jit(lambda: initial_state(_any_world(template), plan.capacity, plan.clock))()
    rows, num_rows = through_rows(template), template.road.num_rows
    counts = np.zeros(num_rows, int)
    counts[rows] = np.diff(np.linspace(0, num_vehicles, len(rows) + 1).astype(int))
    columns: dict[str, np.ndarray] = {
        name: np.array(getattr(state.vehicles, name))
        for name in ("position_m", "speed_mps", "row", "vehicle_class", "destination", "identity", "speed_factor",
                     "speed_limit_mps", "slow_limit_mps")
    }  # fmt: skip
    random = np.random.default_rng(0)
    head, entry = [], 0
    for row, count in enumerate(counts):
        head.append(entry)
        entries = slice(entry + 1, entry + 1 + count)
        columns["position_m"][entry], columns["vehicle_class"][entry], columns["row"][entry] = np.inf, -1, row
        columns["position_m"][entries] = float(end_m(template)) - SPACING_M * (np.arange(count) + 1.0 - 0.3 * (row % 3))
        columns["vehicle_class"][entries], columns["row"][entries] = 0, row
        columns["destination"][entries] = template.subject_destination
        columns["identity"][entries] = FIRST_ARRIVAL + entry + np.arange(count)
        columns["speed_factor"][entries] = random.normal(1.0, 0.05, count)
        columns["speed_mps"][entries] = SPEED_MPS
        columns["speed_limit_mps"][entries] = columns["slow_limit_mps"][entries] = SPEED_MPS
        entry += 1 + count
    arrays: dict[str, Any] = {
        name: jnp.asarray(column, getattr(state.vehicles, name).dtype) for name, column in columns.items()
    }
    vehicles = with_changes(state.vehicles, **arrays)
    return eqx.tree_at(lambda s: (s.vehicles, s.head), state, (vehicles, jnp.asarray([*head, entry], jnp.int32)))


def through_rows(template: WorldTemplate) -> np.ndarray:
    """Return the rows in which the subject vehicle's route can be followed from the beginning to its end."""
    stops = np.asarray(template.road.stop_position_m)[template.subject_destination]
    return np.flatnonzero(np.isinf(stops).all(axis=1) & np.asarray(template.road.is_carriageway).all(axis=1))


def end_m(template: WorldTemplate) -> np.ndarray:
    """Return where the subject vehicle's route ends."""
    return np.asarray(template.road.destination_end_m)[template.subject_destination]


def _any_world(template: WorldTemplate) -> Any:
    values = jnp.asarray(template.base_values(), jnp.float32)
    return template.world(values, jnp.asarray(0, jnp.int32), jnp.asarray(2.0, jnp.float32))
