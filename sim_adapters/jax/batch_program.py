"""The program that makes a batch of runs, sharded over the devices that JAX sees."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh
from jax.sharding import PartitionSpec as Spec
from jaxtyping import Array, Bool, Float

from sim_adapters.jax.device_memory import check_memory
from sim_adapters.jax.program_store import ProgramStore, compile_afresh
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.effects.settings import Effects, settings_table
from surrogate.loop.run_state import Observer, RunPlan, RunState
from surrogate.loop.simulate import at_start, go_on
from surrogate.loop.world import Clock, World
from surrogate.road.perception import Sensor
from surrogate.xla.materialise import compiler_options


class BatchInputs(eqx.Module):
    """What the runs of a batch are made from."""

    values: Any  # parameter vectors; all are arrays with a leading axis for runs, or the shapes of such
    seeds: Any
    departs_s: Any  # when the subject vehicle of each run departs; with a second axis where runs have several
    drives: Any  # which recorded drive each stands for, by number
    settings: Any  # unmodelled effects, see `surrogate.effects.settings`; None for a simulator without any


@dataclass(frozen=True)
class CompiledBatch:
    """A program, and what it works on.

    Attributes:
        program: from inputs, states of runs (which it may overwrite), which of them are yet to begin, and the share of
            the runs that are not over that may be left, to the states then.
        run_states: shapes of the states.
    """

    program: jax.stages.Compiled
    run_states: RunState

    @property
    def device_bytes(self) -> int | None:
        """What a device's part of a batch takes, inputs and results included; None where nobody tells."""
        memory = self.program.memory_analysis()
        if memory is None:
            return None
        parts = (memory.temp_size_in_bytes, memory.argument_size_in_bytes, memory.output_size_in_bytes)
        return sum(parts) - memory.alias_size_in_bytes


@dataclass(frozen=True)
class BatchProgram:
    """All that a program is made from but its room."""

    template: WorldTemplate  # what all worlds of the scenario share
    observer: Observer  # fold over the frames of each run
    sensor: Sensor  # the subject vehicle's sensors
    clock: Clock  # lengths of steps
    end_s: float  # when runs end at the latest
    steps_per_frame: int  # steps between two frames
    has_effects: bool  # whether runs may have unmodelled effects
    batch: int  # runs on all devices together
    mesh: Mesh  # the devices

    def compiled(self, capacity: int, num_subjects: int, store: ProgramStore | None) -> CompiledBatch:
        """Return the program: from the store if it is there.

        Args:
            capacity: vehicles on a road for which there is room.
            num_subjects: subject vehicles of each run.
            store: where programs are kept; None keeps none.

        Raises:
            TooLargeBatchError: a batch does not fit into the devices' memory.
        """
        inputs = self._input_shapes(num_subjects)
        run_states = jax.eval_shape(lambda inputs: self._at_start(inputs, capacity), inputs)
        device, num_runs = self.mesh.devices.flat[0], self.batch // self.mesh.size
        where_runs_are = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(run_states))
        check_memory(where_runs_are // self.mesh.size, num_runs, device)  # the least: no need to compile
        made = self._loaded_or_compiled(inputs, run_states, capacity, num_subjects, store)
        check_memory(made.device_bytes or 0, num_runs, device)
        return made

    def _loaded_or_compiled(
        self, inputs: BatchInputs, run_states: RunState, capacity: int, num_subjects: int, store: ProgramStore | None
    ) -> CompiledBatch:
        arguments = inputs, run_states, jax.ShapeDtypeStruct((self.batch,), bool), jax.ShapeDtypeStruct((), jnp.float32)
        key = None if store is None else store.key((*self._made_from(capacity), num_subjects))
        if store is not None and key is not None:
            kept = store.load(key, arguments, run_states)
            if kept is not None:
                return CompiledBatch(kept, run_states)

        def observe(inputs: BatchInputs, run_states: RunState, is_fresh: Array, share_left: Array) -> RunState:
            return self._observe(inputs, run_states, is_fresh, share_left, capacity)

        # a name of its own, so that JAX's cache finds it under no other key: from there it could not be kept again
        observe.__name__ = "observe" if key is None else f"observe_{key[:12]}"
        lowered = jax.jit(observe, donate_argnums=1).lower(*arguments)
        program, is_new = compile_afresh(lowered, compiler_options())
        if store is not None and key is not None and is_new:
            store.save(key, program)
        return CompiledBatch(program, run_states)

    def _made_from(self, capacity: int) -> tuple[Any, ...]:
        """Return what tells the program from all others; the devices are known to the store."""
        return (
            self.template,
            self.observer,
            self.sensor,
            self.clock,
            self.end_s,
            self.steps_per_frame,
            self.has_effects,
            self.batch,
            capacity,
        )

    def _input_shapes(self, num_subjects: int) -> BatchInputs:
        departs = (self.batch,) if num_subjects == 1 else (self.batch, num_subjects)
        settings = jax.ShapeDtypeStruct((self.batch, *settings_table({}).shape), jnp.float32)
        return BatchInputs(
            values=jax.ShapeDtypeStruct((self.batch, len(self.template.layout.names)), jnp.float32),
            seeds=jax.ShapeDtypeStruct((self.batch,), jnp.int32),
            departs_s=jax.ShapeDtypeStruct(departs, jnp.float32),
            drives=jax.ShapeDtypeStruct(departs, jnp.int32),
            settings=settings if self.has_effects else None,
        )

    def _plan(self, capacity: int) -> RunPlan:
        return RunPlan(self.clock, capacity + self.template.road.num_rows, self.steps_per_frame)

    def _worlds(self, inputs: BatchInputs) -> tuple[World, World]:
        """Return the runs' worlds, and which of their leaves have an axis for runs."""
        effects = None if inputs.settings is None else Effects(inputs.settings)
        axes = self.template.batch_axes(self.has_effects)
        build = jax.vmap(self.template.world, out_axes=axes)
        return build(inputs.values, inputs.seeds, inputs.departs_s, effects, inputs.drives), axes

    def _at_start(self, inputs: BatchInputs, capacity: int) -> RunState:
        return at_start(*self._worlds(inputs), self.sensor, self.observer, self._plan(capacity))

    def _observe(
        self,
        inputs: BatchInputs,
        run_states: RunState,
        is_fresh: Bool[Array, " run"],
        share_left: Float[Array, ""],
        capacity: int,
    ) -> RunState:
        each = Spec("run")

        @partial(jax.shard_map, mesh=self.mesh, in_specs=(each, each, each, Spec()), out_specs=each, check_vma=False)
        def on_one_device(
            inputs: BatchInputs, run_states: RunState, is_fresh: Bool[Array, " run"], share_left: Float[Array, ""]
        ) -> RunState:
            worlds, axes = self._worlds(inputs)
            first_s = inputs.departs_s if inputs.departs_s.ndim == 1 else jnp.min(inputs.departs_s, axis=1)
            start = at_start(worlds, axes, self.sensor, self.observer, self._plan(capacity))
            start = eqx.tree_at(lambda one: one.is_over, start, run_states.is_over)  # some places are nobody's
            run_states = jax.tree.map(
                lambda first, later: jnp.where(is_fresh.reshape(-1, *[1] * (later.ndim - 1)), first, later),
                start,
                run_states,
            )
            return go_on(
                run_states,
                worlds,
                axes,
                self.sensor,
                self.observer,
                self._plan(capacity),
                first_frame_s=first_s - self.clock.interval_s,
                end_s=jnp.asarray(self.end_s, jnp.float32),
                most_unfinished=jnp.floor(share_left * jnp.sum(~run_states.is_over)).astype(jnp.int32),
            )

        return on_one_device(inputs, run_states, is_fresh, share_left)
