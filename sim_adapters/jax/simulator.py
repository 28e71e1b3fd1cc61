"""The surrogate as an engine: the one place where runs become a batch, and batches the outcomes of runs."""

import threading
import time
from collections.abc import Sequence

import jax
import numpy as np
from jax.sharding import Mesh

from sim_adapters.activity import Activity, doing
from sim_adapters.interface import DriveStart, ParameterLayout, RunOutcome, RunRequest, Status
from sim_adapters.jax.batch_program import BatchInputs, BatchProgram, CompiledBatch
from sim_adapters.jax.outcome import outcome_of
from sim_adapters.jax.program_store import ProgramStore
from sim_adapters.jax.run_queue import Going, RunQueue
from sim_adapters.shared_runs import shared_runs, starts_of
from sim_adapters.world.world_builder import WorldTemplate
from surrogate.effects.settings import settings_table
from surrogate.loop.run_state import Observer, RunState
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor
from surrogate.xla.materialise import on_processors

# places of all runs of a device together, and bounds of the runs: on a core, their arrays fit into its cache; on an
# accelerator, they give all its threads something to do
ON_PROCESSORS, ON_ACCELERATORS = (1 << 14, 4, 16), (1 << 21, 64, 4096)
CAPACITY_STEP = 32
GROWTH = 1.5  # of the room, where too many runs need more


class JaxSimulator:
    """Runs many parameter sets at once in the surrogate.

    Batches have one fixed shape, and places that nobody needs are idle: XLA's rounding depends on the shape of a
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
        self._batches = BatchProgram(
            template, observer, sensor, clock, end_s, self._steps_per_frame, has_effects, self._batch, self._mesh
        )
        self._programs: dict[tuple[int, int], CompiledBatch] = {}
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
    def decision_interval_s(self) -> float:
        """Time between two decisions about lanes."""
        return self._clock.interval_s

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
        self._program(1)

    def memory_bytes(self) -> int:
        """Return what a batch takes on all devices together, inputs and results included.

        Raises:
            RuntimeError: the devices do not tell.
        """
        device_bytes = self._program(1).device_bytes
        if device_bytes is None:
            raise RuntimeError("These devices do not tell how much memory a program needs.")
        return device_bytes * self._mesh.size

    @property
    def batch(self) -> int:
        """Runs that are made together; other numbers waste time."""
        return self._batch

    @doing(Activity.SURROGATE)
    def run(self, requests: Sequence[RunRequest]) -> list[RunOutcome]:
        """Make all runs and return their outcomes in the same order.

        Runs are grouped by departure, since a batch lasts as long as its longest run. A call whose runs need more room
        leaves that room to those after it. Each number of subject vehicles has a program of its own.

        Raises:
            ValueError: a request names effects, but this simulator has none; or several subject vehicles, but they
                have a driver of their own or others follow otherwise far from them.
            UnknownEffectError: a request names one that there is not.
            TooLargeBatchError: a batch does not fit into the devices' memory.
        """
        if not self._has_effects and any(request.effects for request in requests):
            raise ValueError("Expected requests without effects; a simulator from `with_effects()` takes them.")
        if any(request.also_depart_s for request in requests) and not self._template.can_share_runs:
            raise ValueError("Expected one subject vehicle where it has a driver, or others differ far from it.")
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
        asked = shared_runs(requests)  # by which requests, for each run
        starts = [starts_of([requests[number] for number in numbers]) for numbers in asked]
        outcomes: list[RunOutcome | None] = [None] * len(requests)
        for num_subjects in sorted(set(map(len, starts))):
            together = [run for run, own in enumerate(starts) if len(own) == num_subjects]
            queue = RunQueue(sorted(together, key=lambda run: starts[run]), self._batch)
            while runs := queue.take():
                firsts = [requests[asked[run.number][0]] for run in runs]
                when = [starts[run.number] for run in runs]
                run_states = self._go_on(firsts, when, runs, queue.share_left, num_subjects)
                for run, lane in zip(runs, self._lanes(len(runs)), strict=True):
                    if run_states.is_over[lane]:
                        record = jax.tree.map(lambda leaf, lane=lane: leaf[lane], run_states.record)
                        for number in asked[run.number]:
                            share_s = run.wall_s / len(asked[run.number])
                            outcomes[number] = outcome_of(requests[number], record, share_s, self._template)
                    else:
                        run.state = jax.tree.map(lambda leaf, lane=lane: leaf[lane], run_states)
                        queue.put_back(run)
        return [outcome for outcome in outcomes if outcome is not None]

    def _program(self, num_subjects: int) -> CompiledBatch:
        """Return the program for a batch with the present room, loaded or compiled when it is needed first."""
        wanted = self._capacity, num_subjects
        with doing(Activity.COMPILING), self._compiling:
            if wanted not in self._programs:
                began = time.perf_counter()
                self._programs[wanted] = self._batches.compiled(*wanted, self._programs_kept)
                self.compile_s += time.perf_counter() - began
            return self._programs[wanted]

    def _lanes(self, number: int) -> list[int]:
        """Return the places in a batch of so many runs, dealt out evenly to the devices."""
        num_devices = self._mesh.size
        per_device = self._batch // num_devices
        return [index % num_devices * per_device + index // num_devices for index in range(number)]

    def _go_on(
        self,
        requests: list[RunRequest],
        starts: list[tuple[DriveStart, ...]],
        runs: list[Going],
        share_left: float,
        num_subjects: int,
    ) -> RunState:
        """Return where the runs of a batch are when at most a share of them is left, and add to their times."""
        compiled = self._program(num_subjects)
        began = time.perf_counter()
        lanes = self._lanes(len(runs))
        filled, when = [requests[-1]] * self._batch, [starts[-1]] * self._batch
        run_states = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), compiled.run_states)
        run_states.is_over[:] = True  # places that nobody needs
        is_fresh = np.ones((self._batch,), bool)
        for request, start, run, lane in zip(requests, starts, runs, lanes, strict=True):
            filled[lane], when[lane] = request, start
            run_states.is_over[lane] = False
            if run.state is not None:
                is_fresh[lane] = False
                jax.tree.map(lambda leaf, part, lane=lane: leaf.__setitem__(lane, part), run_states, run.state)
        departs_s = np.asarray([[one.depart_s for one in each] for each in when], np.float32)
        drives = np.asarray([[one.drive for one in each] for each in when], np.int32)
        inputs = BatchInputs(
            values=np.asarray([request.values for request in filled], np.float32),
            seeds=np.asarray([request.seed for request in filled], np.int32),
            departs_s=departs_s[:, 0] if num_subjects == 1 else departs_s,
            drives=drives[:, 0] if num_subjects == 1 else drives,
            settings=np.asarray([settings_table(request.effects) for request in filled], np.float32)
            if self._has_effects
            else None,
        )
        after = compiled.program(inputs, run_states, is_fresh, np.float32(share_left))
        if not share_left:  # all are over: nobody goes on from there
            after = RunState(states=None, observed=None, record=after.record, is_over=after.is_over)  # pyright: ignore[reportArgumentType]
        found = jax.tree.map(np.asarray, after)
        for run in runs:
            run.wall_s += (time.perf_counter() - began) / len(runs)
        return found


def _round_up(capacity: float) -> int:
    return int(-(-capacity // CAPACITY_STEP)) * CAPACITY_STEP


def usual_runs_per_device(capacity: int) -> int:
    """Return a power of 2; small batches waste less when few runs are asked for.

    A road that fills more places than a batch should have gets the least.
    """
    places, least, most = ON_PROCESSORS if on_processors() else ON_ACCELERATORS
    runs = 1 << max(1, places // capacity).bit_length() - 1
    return min(max(runs, least), most)
