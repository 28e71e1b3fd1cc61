"""Both simulators of a problem, ready to run."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.runs.disk import writing_to_scratch
from sim_adapters.jax.program_store import program_store
from sim_adapters.jax.simulator import JaxSimulator
from sim_adapters.sumo.distant import DistantTypes
from sim_adapters.sumo.driver import subject_control
from sim_adapters.sumo.simulator import FrameFold, SensorRange, SumoSimulator, VehicleCounter
from sim_adapters.sumo.workers import SumoWorkers
from sim_adapters.units import METRES_PER_KILOMETRE
from surrogate.loop.run_state import Observer, RunPlan
from surrogate.loop.world import Clock
from surrogate.road.perception import Sensor

DECISION_INTERVAL_S = (
    1.0  # twice as fast as 0.5 s, and the discrepancy from SUMO is learnt anyway; see docs/surrogate.md
)
FINER_DECISION_INTERVAL_S = 0.5  # for roads on which the usual one drives unlike SUMO: near-critical merges and weaving
SPARE_CAPACITY = 1.4  # candidates may be denser than the field
RAMP_VEHICLES = 32
OBJECTS_PER_ROW = 32


def prepare_devices(num_cores: int) -> None:
    """Let the surrogate use all cores; without effect once JAX has started."""
    try:
        jax.config.update("jax_num_cpu_devices", num_cores)
    except RuntimeError:  # a program that imports jaxcalib has used JAX before; then its devices stand
        return


def surrogate_engine(
    problem: CalibrationProblem,
    spare_capacity: float = SPARE_CAPACITY,
    most_overfull_share: float = 0.75,
    runs_per_device: int | None = None,
    observer: Observer | None = None,
    decision_interval_s: float = DECISION_INTERVAL_S,
) -> JaxSimulator:
    """Return the surrogate for a problem.

    Args:
        problem: the problem.
        spare_capacity: room for vehicles, as a multiple of those in the field.
        most_overfull_share: see `JaxSimulator`; a search can do without candidates that are much denser than the field,
            0 is for studies that need every run.
        runs_per_device: size of a device's part of a batch; from the room unless given.
        observer: fold over the frames of each run; that of the problem's measures unless given.
        decision_interval_s: time between two decisions about lanes, to the nearest that frames allow.
    """
    scenario, perception = problem.parts.scenario, problem.case.perception
    return JaxSimulator(
        template=problem.template,
        observer=observer or problem.tally,
        sensor=Sensor(
            jnp.asarray(perception.ahead_m, jnp.float32), jnp.asarray(perception.behind_m, jnp.float32), OBJECTS_PER_ROW
        ),
        clock=_clock(problem, decision_interval_s),
        end_s=scenario.duration_s,
        capacity=expected_vehicles(problem, spare_capacity),
        runs_per_device=runs_per_device,
        frame_interval_s=problem.frame_interval_s,
        most_overfull_share=most_overfull_share,
        programs=program_store(),
    )


def finer_surrogate_engine(problem: CalibrationProblem) -> JaxSimulator | None:
    """Return the surrogate with more frequent decisions, which take 1.6 times as long; None where they cannot be.

    What else falls on decisions has to fall on the same steps in SUMO: a planner's plans, and who drives out of sight.
    """
    if not problem.template.can_share_runs:
        return None
    engine = surrogate_engine(problem, decision_interval_s=FINER_DECISION_INTERVAL_S)
    return engine if engine.decision_interval_s < _clock(problem).interval_s else None


def sumo_engine(
    problem: CalibrationProblem,
    num_processes: int | None = None,
    fold: FrameFold | None = None,
    counter: VehicleCounter | None = None,
    workers: SumoWorkers | None = None,
    step_s: float | None = None,
) -> SumoSimulator:
    """Return SUMO for a problem; close it after use.

    Args:
        problem: the problem.
        num_processes: processes of its own; one for each core unless given.
        fold: turns the frames of a drive into numbers; the problem's unless given.
        counter: counts vehicles instead, up to the end of the scenario.
        workers: who makes the runs, and outlives this; processes of its own unless given.
        step_s: length of a step, of which frames are a whole number; the scenario's unless given. A subject vehicle
            that replays its log has places for the scenario's alone.
    """
    perception, clock = problem.case.perception, _clock(problem, step_s=step_s)
    plan = RunPlan(clock, 0, round(problem.frame_interval_s / clock.step_s))
    configuration = dataclasses.replace(problem.scenario.configuration, step_s=clock.step_s)
    with writing_to_scratch():
        return SumoSimulator(
            scenario=dataclasses.replace(problem.scenario, configuration=configuration),
            layout=problem.layout,
            fold=fold or problem.fold,
            sensor=SensorRange(perception.ahead_m, perception.behind_m),
            subject_vehicle=problem.parts.subject.vehicle,
            frame_interval_s=problem.frame_interval_s,
            end_s=problem.parts.scenario.duration_s,
            num_processes=num_processes,
            counter=counter,
            control=lambda request: subject_control(problem.template, request, clock, plan.steps_before_decision),
            distant=_distant_types(problem, clock, plan.steps_before_decision),
            workers=workers,
            recorded=problem.template.recorded,
        )


def _distant_types(problem: CalibrationProblem, clock: Clock, first_step: int) -> DistantTypes | None:
    chosen, sensor = problem.template.distant_vtypes, problem.case.perception
    if not chosen:
        return None
    return DistantTypes(dict(chosen), sensor.ahead_m, sensor.behind_m, clock.steps_per_decision, first_step)


def _clock(
    problem: CalibrationProblem, decision_interval_s: float = DECISION_INTERVAL_S, step_s: float | None = None
) -> Clock:
    """Return a clock whose decisions are a whole number of frames apart, or frames a whole number of decisions."""
    step_s = problem.parts.scenario.step_s if step_s is None else step_s
    steps_per_frame = round(problem.frame_interval_s / step_s)
    wanted = decision_interval_s / step_s
    if wanted >= steps_per_frame:
        steps_per_decision = steps_per_frame * max(1, round(wanted / steps_per_frame))
    else:
        divisors = [steps for steps in range(1, steps_per_frame + 1) if steps_per_frame % steps == 0]
        steps_per_decision = min(divisors, key=lambda steps: abs(steps - wanted))
    return Clock(step_s, steps_per_decision, problem.scenario.configuration.lane_change_duration_s)


def expected_vehicles(problem: CalibrationProblem, spare_capacity: float = SPARE_CAPACITY) -> int:
    """Return how many vehicles the surrogate should have room for, from the density that the field shows."""
    pooled = dict(zip(problem.tally_names, problem.field_of("fit").sum(axis=0), strict=True))
    density_vehpkm = problem.measures["traffic_density_vehpkm"].value(pooled).value
    lane_km = float(problem.road.lane_m[-1]) / METRES_PER_KILOMETRE
    return int(np.ceil(spare_capacity * density_vehpkm * lane_km)) + RAMP_VEHICLES
