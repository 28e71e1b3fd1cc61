"""A logged drive on the simulators' clock, and a subject vehicle that repeats it in both simulators."""

import functools
import re
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.problem.engines import sumo_engine
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from sim_adapters.interface import NO_DRIVE, RunRequest
from sim_adapters.sumo.job import SumoRun
from sim_adapters.world.logged_drive import LoggedDrive, log_of, logged_motion_of, resample
from surrogate.effects.base import EffectSetting
from surrogate.effects.registry import EFFECTS
from surrogate.effects.settings import Effects, settings_table
from surrogate.loop.moving import move_on
from surrogate.loop.run_state import RunPlan
from surrogate.loop.step import initial_state, settle_lanes
from surrogate.loop.world import Clock, World
from surrogate.road.perception import Sensor, perceive
from surrogate.road.traffic_state import TrafficState, empty_vehicles, with_changes
from surrogate.subject.logged_drive import overlaps
from tests.copies import copy_corridor
from tests.jit_marked import jit_marked

STEP_S = 0.1


def drive(first_step: int, length: int = 30) -> LoggedDrive:
    steps = np.arange(length)
    return LoggedDrive(first_step, 50.0 + 1.9 * steps + first_step, np.full(length, 19.0), steps // 7 % 3)


def test_the_log_is_met_at_its_instants_and_a_cubic_between_them() -> None:
    time = np.asarray([60.25, 60.75, 61.25, 61.75])
    # x = 3 + 2 t + 5 t^2 - t^3 with t from the first instant, which a cubic between any two instants repeats
    t = time - time[0]
    found = resample(time, 3 + 2 * t + 5 * t**2 - t**3, 2 + 10 * t - 3 * t**2, np.asarray([1, 1, 2, 2]), STEP_S)
    assert found.first_step == 603
    fine = np.arange(603, 618) * STEP_S - time[0]
    np.testing.assert_allclose(found.position_m, 3 + 2 * fine + 5 * fine**2 - fine**3, atol=1e-9)
    # the first instant in the new lane is 61.25 s, so the change lies right behind 60.75 s
    np.testing.assert_array_equal(found.row, np.where(np.arange(603, 618) * STEP_S > 60.75, 2, 1))


def test_a_noisy_log_never_goes_back() -> None:
    time = np.arange(0.0, 10.0, 0.5)
    noise = np.random.default_rng(3).normal(0.0, 0.4, len(time))
    found = resample(time, 0.2 * time + noise, np.full(len(time), 0.2), np.zeros(len(time), int), STEP_S)
    assert np.all(np.diff(found.position_m) >= 0.0)
    with pytest.raises(ValueError, match="at least two instants"):
        resample(time[:1], time[:1], time[:1], time[:1], STEP_S)


@pytest.mark.parametrize(("asked", "expected"), [(0, 0), (1, 1), (2, 2), (NO_DRIVE, 0)])
def test_both_simulators_repeat_the_drive_that_is_asked_for(asked: int, expected: int) -> None:
    drives = [drive(3005), drive(3204, 41), drive(3002, 35)]
    log = log_of(drives, asked)
    assert log is drives[expected]
    repeated = logged_motion_of(drives, jnp.asarray(asked))
    position, speed, row = repeated.at(jnp.asarray(log.first_step + 9))
    assert float(position) == pytest.approx(log.position_m[9])
    assert (float(speed), int(row)) == (19.0, 1)
    end = log.first_step + len(log.position_m)
    assert bool(repeated.is_over(jnp.asarray(end)))
    assert not bool(repeated.is_over(jnp.asarray(end - 1)))


def test_without_drives_there_is_nothing_to_repeat() -> None:
    with pytest.raises(ValueError, match="expects logged drives"):
        logged_motion_of([], jnp.asarray(0))


@pytest.mark.parametrize(
    ("other_m", "row", "expected"), [(96.0, 1, 1), (103.9, 1, 1), (94.9, 1, 0), (104.1, 1, 0), (98.0, 0, 0)]
)
def test_an_overlap_is_counted_ahead_and_behind_in_the_own_lane(other_m: float, row: int, expected: int) -> None:
    vehicles = empty_vehicles(2, 5)
    vehicles = with_changes(
        vehicles,
        position_m=vehicles.position_m.at[2:4].set(jnp.asarray([100.0, other_m])),
        row=vehicles.row.at[2:4].set(jnp.asarray([1, row])),
        vehicle_class=vehicles.vehicle_class.at[2:4].set(jnp.asarray([1, 0])),
    )
    length_m = jnp.where(vehicles.vehicle_class == 1, 5.0, 4.0)
    assert int(overlaps(vehicles, vehicles.vehicle_class == 1, length_m)) == expected


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> CalibrationProblem:
    """The corridor with one of its drives, replayed."""
    return replayed_case(tmp_path_factory.mktemp("case"), 0.0)


def replayed_case(place: Path, duration_s: float) -> CalibrationProblem:
    folder = copy_corridor(place / "corridor", "d02")
    config = folder / "scenario/scenario.sumocfg"
    duration = f'<processing><lanechange.duration value="{duration_s:g}"/>'
    assert "<processing>" in config.read_text()
    config.write_text(config.read_text().replace("<processing>", duration))
    text = re.sub(r"(vehicle\s*= \"ego\")", r'\1\nmodel = "replay"', (folder / "case.toml").read_text())
    (folder / "case.toml").write_text(text)
    return read_problem(folder)


def logged(problem: CalibrationProblem) -> np.ndarray:
    """Return time, position, speed and row of the log, every 0.5 s."""
    even = problem.drives[0].on_clock(0.5)
    columns = (even.subject.time_s, even.subject.position_m, even.subject.speed_mps, even.subject.row)
    return np.stack(columns, axis=1)[np.asarray(even.valid)]


@functools.cache
def to_next_frame(duration_s: float) -> Callable[[TrafficState, World, jax.Array], tuple[TrafficState, jax.Array]]:
    """Return the program that goes on by 0.5 s, with lane changes that take so long, and sees what is there then."""
    clock = Clock(STEP_S, 10, duration_s)
    plan = RunPlan(clock, 0, 5)
    sensor = Sensor(jnp.asarray(150.0), jnp.asarray(150.0), 32)

    def frame(state: TrafficState, world: World, decides: jax.Array) -> tuple[TrafficState, jax.Array]:
        def step(number: jax.Array, state: TrafficState) -> TrafficState:
            settles = decides & (number == plan.steps_before_decision)
            state = jax.lax.cond(settles, lambda s: settle_lanes(s, world, clock), lambda s: s, state)
            return move_on(state, world, STEP_S, 1)

        state = jax.lax.fori_loop(0, plan.steps_per_frame, step, state)
        state, seen, _ = perceive(state, world.road, sensor, world.subject_class, state.step * STEP_S)
        row = jnp.sum(jnp.where(seen.object_is_subject, seen.object_row, 0))
        told = (seen.time_s, seen.subject_position_m, seen.subject_speed_mps, row, seen.valid)
        return state, jnp.stack([jnp.asarray(one, jnp.float32) for one in told])

    return jit_marked(frame)


def in_surrogate(
    problem: CalibrationProblem, demand: float, duration_s: float = 0.0, effects: Effects | None = None
) -> tuple[np.ndarray, TrafficState]:
    template, clock = problem.template, Clock(STEP_S, 10, duration_s)
    values = template.base_values()
    values[: problem.layout.num_inputs] *= demand
    depart_s = problem.case.drives[0].depart_s
    world = template.world(
        jnp.asarray(values, jnp.float32), jnp.asarray(4), jnp.asarray(depart_s, jnp.float32), effects
    )
    frame = to_next_frame(duration_s)
    state, rows = initial_state(world, 512, clock), []
    for number in range(1440):
        state, told = frame(state, world, jnp.asarray(number % 2 == 0))
        if told[4]:
            rows.append(np.asarray(told[:4]))
        if state.subject_left:
            break
    return np.asarray(rows), state


def differences(found: np.ndarray, log: np.ndarray) -> np.ndarray:
    place = np.searchsorted(log[:, 0], found[:, 0] - 0.01)
    inside = place < len(log)
    return np.abs(found[inside] - log[place[inside]])


# what else there is must not bend the log: other classes, drivers who differ, lane changes that take time
WITH_EFFECTS = {effect.name: EffectSetting(effect.weak) for effect in EFFECTS}


@pytest.mark.long
@pytest.mark.parametrize(("duration_s", "effects"), [(0.0, {}), (3.0, {}), (0.0, WITH_EFFECTS)])
def test_the_surrogate_repeats_the_log(
    problem: CalibrationProblem, duration_s: float, effects: dict[str, EffectSetting]
) -> None:
    log = logged(problem)
    table = Effects(jnp.asarray(settings_table(effects), jnp.float32)) if effects else None
    found, state = in_surrogate(problem, 1.0, duration_s, table)
    assert len(log) - 4 <= len(found) <= len(log)  # it enters at a decision
    apart = differences(found, log).max(axis=0)
    assert apart[1] < 1e-3
    assert apart[2] < 1e-4
    assert np.mean(differences(found, log)[:, 3] == 0) > 0.97  # frames between a lane change and the next decision
    assert int(state.num_lost) == 0
    assert bool(state.subject_left)


@pytest.mark.long
def test_traffic_that_it_runs_into_is_counted_and_the_order_of_all_others_holds(problem: CalibrationProblem) -> None:
    log = logged(problem)
    found, state = in_surrogate(problem, 1.9)
    assert differences(found, log)[:, 1].max() < 1e-3
    assert int(state.num_subject_overlaps) > 50
    assert int(state.num_collisions) <= 3 * int(state.num_subject_overlaps)
    row, position = np.asarray(state.vehicles.row), np.asarray(state.vehicles.position_m)
    same = (row[1:] == row[:-1]) & (row[1:] < state.head.shape[0] - 1)
    assert np.all(position[1:][same] <= position[:-1][same])


@pytest.mark.long
@pytest.mark.parametrize(("demand", "duration_s"), [(1.0, 3.0), (2.5, 0.0)])  # 2.5 leaves no room to enter for minutes
def test_sumo_repeats_the_log(demand: float, duration_s: float, tmp_path: Path) -> None:
    problem = replayed_case(tmp_path, duration_s)
    log = logged(problem)
    values = problem.template.base_values()
    values[: problem.layout.num_inputs] *= demand
    request = RunRequest(tuple(values.tolist()), 4, problem.case.drives[0].depart_s)
    with sumo_engine(problem, num_processes=1) as engine:
        run = engine.begin(request).result()
    assert isinstance(run, SumoRun), run
    is_subject = run.vehicle == -1
    found = np.stack([run.time_s, run.position_m, run.speed_mps, run.row], axis=1)[is_subject]
    found = found[found[:, 0] >= log[0, 0] - 0.01]
    assert found[0, 0] < log[0, 0] + 0.6
    assert len(found) > len(log) - 4
    apart = differences(found, log)
    assert apart[:, 1].max() < 1e-3
    assert apart[:, 2].max() < 0.3  # the mean over a step against the speed at its end
    assert np.mean(apart[:, 3] == 0) > 0.97
    assert run.num_teleports == 0
