"""The surrogate as an engine: the one place where runs become a batch, sharded over the devices that JAX sees."""

import threading
import time
from collections.abc import Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jax.sharding import PartitionSpec as Spec
from jaxtyping import Array, Float, Int

from sim_adapters.interface import ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.program_store import ProgramStore, compile_afresh, one_leaf_each
from sim_adapters.world_builder import WorldTemplate
from surrogate.effects.settings import Effects, settings_table
from surrogate.materialise import COMPILER_OPTIONS
from surrogate.perception import Sensor
from surrogate.simulate import Observer, RunPlan, RunRecord, observe_batch
from surrogate.world import Clock

VEHICLES_PER_DEVICE = 16384  # places of all runs of a device together: their arrays fit into a core's cache
LEAST_RUNS_PER_DEVICE, MOST_RUNS_PER_DEVICE = 4, 16
CAPACITY_STEP = 32
GROWTH = 1.5  # of the room, where too many runs need more
# Steps of overlap allowed in all and per vehicle; SUMO goes on after a collision as well, and Wiedemann's drivers, who
# react late by design, touch now and then where lanes merge.
COLLISION_STEPS_ALLOWED = 100
COLLISION_STEPS_PER_VEHICLE = 1.0


class JaxSimulator:
    """Runs many parameter sets at once in the surrogate.

    Batches have one fixed shape, filled up with copies where runs are few: XLA's rounding depends on the shape of a
    batch, not on what else is in it, so each run gives the same bits in whichever batch it is made.
    """

    def __init__(
        self,
        template: WorldTemplate,
        observer: Observer,
        sensor: Sensor,
        clock: Clock,
        end_s: float,
        capacity: int,
        runs_per_device: int | None = None,
        frame_interval_s: float = 0.5,
        most_overfull_share: float = 0.75,
        has_effects: bool = False,
        programs: ProgramStore | None = None,
    ) -> None:
        """Prepare runs; nothing is compiled before the first.

        Args:
            template: what all worlds of the scenario share.
            observer: fold over the frames of each run.
            sensor: the subject vehicle's sensors.
            clock: lengths of steps.
            end_s: when runs end at the latest.
            capacity: vehicles on the road for which there is room.
            runs_per_device: size of a device's part of a batch; from the capacity unless given.
            frame_interval_s: time between two frames; a multiple or a part of the interval of decisions.
            most_overfull_share: share of the runs of a call that may fail because they need more room. If more do, all
                are made again with more room, for then it is the room that is too small, not the candidates that are
                too dense.
            has_effects: whether requests may name unmodelled effects; see `with_effects`.
            programs: where compiled programs are kept for other processes; None keeps none.
        """
        self._programs_kept = programs
        self._has_effects = has_effects
        self._template = template
        self._observer = observer
        self._sensor = sensor
        self._clock = clock
        self._steps_per_frame = round(frame_interval_s / clock.step_s)
        self._end_s = end_s
        self._capacity = _round_up(capacity)
        self._most_overfull_share = most_overfull_share
        self._largest_capacity = 4 * self._capacity
        self._mesh = Mesh(np.asarray(jax.devices()), ("run",))
        self._batch = (runs_per_device or usual_runs_per_device(self._capacity)) * self._mesh.size
        self._programs: dict[int, jax.stages.Compiled] = {}
        self._compiling = threading.Lock()
        self.compile_s = 0.0

    def with_effects(self) -> "JaxSimulator":
        """Return a simulator of the same scenario whose requests may name effects, each run its own mix.

        All effects are in one program; requests without any give the same bits as this simulator.
        """
        return JaxSimulator(
            template=self._template,
            observer=self._observer,
            sensor=self._sensor,
            clock=self._clock,
            end_s=self._end_s,
            capacity=self._capacity,
            runs_per_device=self._batch // self._mesh.size,
            frame_interval_s=self._steps_per_frame * self._clock.step_s,
            most_overfull_share=self._most_overfull_share,
            has_effects=True,
            programs=self._programs_kept,
        )

    @property
    def layout(self) -> ParameterLayout:
        """Meaning of the parameter vectors."""
        return self._template.layout

    @property
    def capacity(self) -> int:
        """Vehicles for which there is room; grows when many runs need more."""
        return self._capacity

    def prepare(self) -> None:
        """Compile what runs need; may be called in a thread while something else goes on."""
        self._program(self._capacity)

    def memory_bytes(self) -> int:
        """Return what a batch takes on all devices together, inputs and results included.

        Raises:
            RuntimeError: the devices do not tell.
        """
        memory = self._program(self._capacity).memory_analysis()
        if memory is None:
            raise RuntimeError("These devices do not tell how much memory a program needs.")
        parts = (memory.temp_size_in_bytes, memory.argument_size_in_bytes, memory.output_size_in_bytes)
        return sum(parts) * self._mesh.size

    @property
    def batch(self) -> int:
        """Runs that are made together; other numbers waste time."""
        return self._batch

    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order.

        Runs are grouped by departure, since a batch lasts as long as its longest run. A call whose runs need more room
        leaves that room to those after it.

        Raises:
            ValueError: a request names effects, but this simulator has none.
            UnknownEffectError: a request names one that there is not.
        """
        if not self._has_effects and any(request.effects for request in requests):
            raise ValueError("Expected requests without effects; a simulator from `with_effects()` takes them.")
        outcomes = self._run_all(requests)
        while sum(outcome.status is Status.OVERFULL for outcome in outcomes) > self._most_overfull_share * len(
            outcomes
        ):
            if self._capacity >= self._largest_capacity:
                break
            self._capacity = _round_up(GROWTH * self._capacity)
            outcomes = self._run_all(requests)
        return outcomes

    def _run_all(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        order = sorted(range(len(requests)), key=lambda index: requests[index].depart_s)
        outcomes: list[RunOutcome | None] = [None] * len(requests)
        for begin in range(0, len(order), self._batch):
            chosen = order[begin : begin + self._batch]
            made = self._run_once([requests[index] for index in chosen], self._capacity)
            for index, outcome in zip(chosen, made, strict=True):
                outcomes[index] = outcome
        return [outcome for outcome in outcomes if outcome is not None]

    def _program(self, capacity: int) -> jax.stages.Compiled:
        """Return the program for a batch, loaded or compiled when it is needed first."""
        with self._compiling:
            if capacity not in self._programs:
                began = time.perf_counter()
                shapes = (
                    jax.ShapeDtypeStruct((self._batch, len(self.layout.names)), jnp.float32),
                    jax.ShapeDtypeStruct((self._batch,), jnp.int32),
                    jax.ShapeDtypeStruct((self._batch,), jnp.float32),
                )
                if self._has_effects:
                    shapes += (jax.ShapeDtypeStruct((self._batch, *settings_table({}).shape), jnp.float32),)
                self._programs[capacity] = self._load_or_compile(shapes, capacity)
                self.compile_s += time.perf_counter() - began
            return self._programs[capacity]

    def _load_or_compile(self, shapes: tuple[jax.ShapeDtypeStruct, ...], capacity: int) -> jax.stages.Compiled:
        """Return the program for a batch: from the store if it is there."""
        store, key = self._programs_kept, None
        if store is not None:
            made_from = (
                self._template,
                self._observer,
                self._sensor,
                self._clock,
                self._end_s,
                self._steps_per_frame,
                self._has_effects,
                self._batch,
                capacity,
            )
            key = store.key(made_from)
        if store is not None and key is not None:
            kept = store.load(key, shapes, one_leaf_each(RunRecord))
            if kept is not None:
                return kept

        def observe(*arguments: Array) -> RunRecord:
            return self._observe(*arguments, capacity=capacity)

        # a name of its own, so that JAX's cache finds it under no other key: from there it could not be kept again
        observe.__name__ = "observe" if key is None else f"observe_{key[:12]}"
        program, is_fresh = compile_afresh(jax.jit(observe).lower(*shapes), COMPILER_OPTIONS)
        if store is not None and key is not None and is_fresh:
            store.save(key, program)
        return program

    def _run_once(self, requests: list[RunRequest], capacity: int) -> list[RunOutcome]:
        program = self._program(capacity)
        began = time.perf_counter()
        filled = requests + [requests[-1]] * (self._batch - len(requests))
        arguments = [
            jnp.asarray([request.values for request in filled], jnp.float32),
            jnp.asarray([request.seed for request in filled], jnp.int32),
            jnp.asarray([request.depart_s for request in filled], jnp.float32),
        ]
        if self._has_effects:
            arguments.append(jnp.asarray([settings_table(request.effects) for request in filled], jnp.float32))
        record = program(*arguments)
        record = jax.tree.map(np.asarray, record)
        wall_s = (time.perf_counter() - began) / len(requests)
        return [
            _outcome(request, jax.tree.map(lambda leaf, i=i: leaf[i], record), wall_s)
            for i, request in enumerate(requests)
        ]

    def _observe(
        self,
        values: Float[Array, "run parameter"],
        seeds: Int[Array, " run"],
        departs_s: Float[Array, " run"],
        settings: Float[Array, "run effect field"] | None = None,
        *,
        capacity: int,
    ) -> RunRecord:
        plan = RunPlan(self._clock, capacity + self._template.road.num_rows, self._steps_per_frame)

        @partial(jax.shard_map, mesh=self._mesh, in_specs=Spec("run"), out_specs=Spec("run"), check_vma=False)
        def on_one_device(
            values: Float[Array, "run parameter"],
            seeds: Int[Array, " run"],
            departs_s: Float[Array, " run"],
            effects: Effects | None,
        ) -> RunRecord:
            axes = self._template.batch_axes(self._has_effects)
            worlds = jax.vmap(self._template.world, out_axes=axes)(values, seeds, departs_s, effects)
            first_frame_s = jnp.min(departs_s) - self._clock.interval_s
            end_s = jnp.asarray(self._end_s, jnp.float32)
            return observe_batch(worlds, axes, self._sensor, self._observer, plan, first_frame_s, end_s)

        return on_one_device(values, seeds, departs_s, None if settings is None else Effects(settings))


def _collisions_allowed(record: RunRecord) -> float:
    return max(COLLISION_STEPS_ALLOWED, COLLISION_STEPS_PER_VEHICLE * float(np.sum(record.num_inserted)))


def _round_up(capacity: float) -> int:
    return int(-(-capacity // CAPACITY_STEP)) * CAPACITY_STEP


def usual_runs_per_device(capacity: int) -> int:
    """Return a power of 2; small batches waste less when few runs are asked for."""
    runs = 1 << max(0, VEHICLES_PER_DEVICE // capacity).bit_length() - 1
    return min(max(runs, LEAST_RUNS_PER_DEVICE), MOST_RUNS_PER_DEVICE)


def _outcome(request: RunRequest, record: RunRecord, wall_s: float) -> RunOutcome:
    num_overlaps = int(record.num_subject_overlaps)
    status = Status.OK
    if int(record.num_lost):
        status = Status.OVERFULL
    elif not bool(record.is_finite) or not np.isfinite(record.observed).all():
        status = Status.NONFINITE
    elif not bool(record.subject_entered):
        status = Status.SUBJECT_MISSING
    # a replayed vehicle overlaps others without being able to help it; both it and its follower count
    elif int(record.num_collisions) - 2 * num_overlaps > _collisions_allowed(record):
        status = Status.COLLIDED
    return RunOutcome(
        request=request,
        status=status,
        observed=record.observed if status.is_ok else None,
        num_arrived=np.asarray(record.num_arrived),
        num_inserted=np.asarray(record.num_inserted),
        num_collisions=int(record.num_collisions),
        num_subject_overlaps=num_overlaps,
        num_vehicle_steps=int(record.num_vehicle_steps),
        wall_s=wall_s,
    )
