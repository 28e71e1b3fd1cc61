"""An effect of one's own, one file and one entry: its diagnosis looks where it may be, tries it, ranks it and finds it.

The field is a platoon in one lane, moved by the surrogate's own step, behind a leader whose speed swings. The same
platoon without the effect stands in for SUMO.
"""

import dataclasses
import functools
import sys
from collections.abc import Iterator, Sequence
from types import SimpleNamespace
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.answer.remarks import not_testable
from jaxcalib.diagnosis.features.conventions import Conventions, ExpectedDrivers
from jaxcalib.diagnosis.features.drive_features import DriveFeatures
from jaxcalib.diagnosis.features.features import DriveTallies, gather_tallies
from jaxcalib.diagnosis.inference.atlas import parameter_trials
from jaxcalib.diagnosis.inference.baseline import Baseline
from jaxcalib.diagnosis.inference.investigation import prepare
from jaxcalib.diagnosis.inference.marginal_likelihood import best_gain
from jaxcalib.diagnosis.inference.overdispersion import LEAST_TEMPERATURE
from jaxcalib.diagnosis.inference.verdict import judge
from jaxcalib.diagnosis.runs.finished_parts import FinishedParts
from jaxcalib.diagnosis.runs.null_runs import NullRuns, alterations_of
from jaxcalib.diagnosis.runs.trial_book import TrialBook
from jaxcalib.diagnosis.runs.trials import TrialRunner
from jaxcalib.diagnosis.stages.tried import Tried, try_effects
from jaxcalib.runs.progress import Silent
from jaxcalib.runs.stopwatch import Stopwatch
from sim_adapters.interface import DriveStart, ParameterLayout, RunRequest, Status
from surrogate.car_following.idm import Idm
from surrogate.effects import registry
from surrogate.effects.apply import classes_with_effects, with_memories
from surrogate.effects.base import ActsOn, Dial, Effect, EffectSetting, Memory, Moment
from surrogate.effects.recorded_drives import alter_drive
from surrogate.effects.settings import Effects, settings_table
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.loop.kinematics import move
from surrogate.road.drive_table import DriveTable, LogFormat, as_logged
from surrogate.road.neighbours import own_leader, second_leader
from surrogate.road.perception import PerceptionFrame
from surrogate.road.traffic_state import HEAD, VehicleArrays, empty_vehicles, with_changes
from surrogate.vehicle.car_following_model import FollowingSituation
from surrogate.vehicle.vehicle_class import VehicleClass

STEP_S, FRAME_S, NUM_STEPS, LIMIT_MPS, LENGTH_M = 0.1, 0.5, 900, 25.0, 4.8
NUM_VEHICLES, SUBJECT, BATCH = 8, 4, 64
NUM_NULL, NUM_ALTERED, NUM_FIELD, NUM_TRIAL = 24, 6, 6, 12
LOG = LogFormat(ahead_m=150.0, behind_m=120.0, place_step_m=0.01, speed_step_mps=0.01 / 3.6)
ROAD = Conventions(
    step_s=STEP_S,
    nominal_length_m=LENGTH_M,
    stretch_m=np.linspace(0.0, 2000.0, 11),
    period_s=np.arange(0.0, 180.0, 60.0),
    lane_from_left=np.asarray([1]),
    segment_end_m=np.asarray([np.inf]),
    limit_mps=np.full((1, 1), LIMIT_MPS),
    merge_m=np.zeros((0, 2)),
    log=LOG,
)
LAYOUT = ParameterLayout(("main",), (("flow",),), ("car",), ("tau",))
VALUES = np.asarray([1800.0, 1.3])
OPEN_STEPS = np.full(len(VALUES), 1.5)


def _perceive(dial: Dial, situation: FollowingSituation, moment: Moment) -> FollowingSituation:
    is_there = moment.is_background & dial.covers(moment.vehicles.position_m, moment.time_s)
    seen_m = jnp.where(is_there, (1.0 - dial.strength) * situation.gap_m, situation.gap_m)
    return eqx.tree_at(lambda s: s.gap_m, situation, seen_m)


SUN_GLARE = Effect(
    name="sun_glare", title="low sun makes gaps look shorter on one stretch", unit="share by which gaps look shorter",
    weak=0.1, medium=0.2, strong=0.4, acts_on=ActsOn.PERCEPTION, source="made up for this test", has_place=True,
    perceive=_perceive,
)  # fmt: skip


def _sense(dial: Dial, frame: PerceptionFrame, memory: Memory, seed: jax.Array) -> tuple[PerceptionFrame, Memory]:
    del seed
    factor = jnp.where(frame.object_is_subject, 1.0, 1.0 + dial.strength)
    return eqx.tree_at(lambda f: f.object_speed_mps, frame, frame.object_speed_mps * factor), memory


SPEED_SENSOR_BIAS = Effect(
    name="speed_sensor_bias", title="objects' speeds read too high by a factor", unit="factor - 1",
    weak=0.01, medium=0.03, strong=0.08, acts_on=ActsOn.SENSOR, source="made up for this test", is_signed=True,
    sense=_sense,
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def entered() -> Iterator[None]:
    """Enter both effects in the registry."""
    before, everything = registry.EFFECTS, (*registry.EFFECTS, SUN_GLARE, SPEED_SENSOR_BIAS)
    with pytest.MonkeyPatch.context() as patch:
        for number, effect in enumerate(everything[len(before) :], len(before)):
            patch.setitem(registry.EFFECT_NUMBER, effect.name, number)
        for module in list(sys.modules.values()):
            if getattr(module, "EFFECTS", None) is before:
                patch.setattr(module, "EFFECTS", everything)
        yield


def _classes(tau_s: Any) -> tuple[VehicleClass, VehicleClass]:
    lane_change = Lc2013(*(jnp.asarray(v, jnp.float32) for v in (1.0, 0.3, 0.25, 1.0, 0.1, 20.0, 0.1, 1.2, 2.0)))
    model = Idm(*(jnp.asarray(v, jnp.float32) for v in (2.1, tau_s, 1.45, 1.9, 9.0, 4.0)))
    human = VehicleClass(model, lane_change, *(jnp.asarray(v, jnp.float32) for v in (LENGTH_M, 55.0, 1.0, 0.0)))
    return human, human


@functools.partial(jax.jit, static_argnums=0)
def _platoons(effects_known: tuple[Effect, ...], values: jax.Array, table: jax.Array, seeds: jax.Array) -> jax.Array:
    """Positions and speeds after each step, [run, step, quantity, vehicle]; the leader comes first."""

    def run(value: jax.Array, settings: jax.Array, seed: jax.Array) -> jax.Array:
        effects = Effects(settings)
        classes = classes_with_effects(_classes(value[1]), effects)
        key_spacing, key_phase = jax.random.split(jax.random.key(seed))
        spacing_m = 1.1e5 / value[0] * jax.random.uniform(key_spacing, (NUM_VEHICLES,), minval=0.5, maxval=0.9)
        phase = 2.0 * jnp.pi * jax.random.uniform(key_phase, (2,))
        start = with_changes(
            empty_vehicles(1, 1 + NUM_VEHICLES),
            position_m=jnp.concatenate([jnp.asarray([jnp.inf]), 420.0 - jnp.cumsum(spacing_m)]),
            speed_mps=jnp.full((1 + NUM_VEHICLES,), 17.0),
            row=jnp.zeros((1 + NUM_VEHICLES,), jnp.int32),
            vehicle_class=jnp.zeros((1 + NUM_VEHICLES,), jnp.int32)
            .at[0]
            .set(HEAD)
            .at[1 + SUBJECT]
            .set(len(classes) - 1),
            identity=jnp.arange(1 + NUM_VEHICLES, dtype=jnp.int32),
            speed_factor=jnp.ones((1 + NUM_VEHICLES,)),
            speed_limit_mps=jnp.full((1 + NUM_VEHICLES,), LIMIT_MPS),
        )

        def step(vehicles: VehicleArrays, number: jax.Array) -> tuple[VehicleArrays, jax.Array]:
            time_s = STEP_S * number
            swing = 3.0 * jnp.sin(0.21 * time_s + phase[0]) + 2.0 * jnp.sin(0.47 * time_s + phase[1])
            limit_mps = jnp.full((1 + NUM_VEHICLES,), LIMIT_MPS).at[1].set(17.0 + swing)
            vehicles = with_changes(vehicles, speed_limit_mps=limit_mps)
            leader = own_leader(vehicles)
            moved, _ = move(
                vehicles, leader, classes, jnp.ones((1 + NUM_VEHICLES,)), seed, number, STEP_S, effects,
                second_leader(leader),
            )  # fmt: skip
            return moved, jnp.stack([moved.position_m[1:], moved.speed_mps[1:]])

        return jax.lax.scan(step, with_memories(effects, start, seed), jnp.arange(NUM_STEPS))[1]

    del effects_known
    return jax.vmap(run)(values, table, seeds)


def platoons(values: Sequence[Any], settings: Sequence[dict[str, EffectSetting]], seeds: Sequence[int]) -> np.ndarray:
    """Positions and speeds of runs, made in batches of one shape."""
    made = []
    for begin in range(0, len(seeds), BATCH):
        spare = BATCH - len(seeds[begin : begin + BATCH])
        part = [[*each[begin : begin + BATCH], *[each[0]] * spare] for each in (values, settings, seeds)]
        told = np.asarray(part[0], np.float32), np.stack([settings_table(one) for one in part[1]]), np.asarray(part[2])
        made.append(np.asarray(_platoons(registry.EFFECTS, *told))[: BATCH - spare])
    return np.concatenate(made).astype(np.float64)


def table_of(platoon: np.ndarray, interval_s: float) -> DriveTable:
    """The drive of a platoon's subject vehicle."""
    every = round(interval_s / STEP_S)
    position_m, speed_mps = platoon[every - 1 :: every, 0], platoon[every - 1 :: every, 1]
    num_instants = len(position_m)
    offset_m = position_m - position_m[:, [SUBJECT]]
    instant, vehicle = np.nonzero((offset_m <= LOG.ahead_m) & (offset_m >= -LOG.behind_m))
    subject_mps = speed_mps[:, SUBJECT]
    return DriveTable(
        interval_s=interval_s,
        time_s=interval_s * np.arange(1.0, num_instants + 1.0),
        is_valid=np.ones(num_instants, bool),
        subject_acceleration_mps2=np.diff(subject_mps, prepend=subject_mps[0]) / interval_s,
        subject_speed_mps=subject_mps,
        instant=instant,
        track=np.where(vehicle == SUBJECT, -1, vehicle),
        lane=np.zeros(len(instant), int),
        offset_m=offset_m[instant, vehicle],
        position_m=position_m[instant, vehicle],
        speed_mps=speed_mps[instant, vehicle],
        lateral_m=np.zeros(len(instant)),
    )


class PlatoonEngine:
    """Stands in for the surrogate: a run is a platoon."""

    def run(self, requests: Sequence[RunRequest]) -> list[Any]:
        made = platoons(
            [request.values for request in requests],
            [dict(request.effects) for request in requests],
            [request.seed for request in requests],
        )
        return [SimpleNamespace(status=Status.OK, observed=platoon) for platoon in made]

    def table(self, observed: np.ndarray, interval_s: float) -> DriveTable:
        return table_of(observed, interval_s)


@dataclasses.dataclass(frozen=True)
class Null:
    """The calibrated simulation: what is counted, its runs, and the trials of its parameters."""

    features: DriveFeatures
    runs: NullRuns
    runner: TrialRunner
    trials: dict[str, DriveTallies]


def drives(tables: Sequence[DriveTable], features: DriveFeatures) -> DriveTallies:
    return gather_tallies([features.of_table(table) for table in tables], [0.0] * len(tables))


@pytest.fixture(scope="module")
def null(entered: None) -> Null:
    del entered
    human, subject = (ExpectedDrivers(each, STEP_S) for each in _classes(VALUES[1]))
    features = DriveFeatures(ROAD, human, subject, FRAME_S)
    made = platoons([VALUES] * NUM_NULL, [{}] * NUM_NULL, range(5000, 5000 + NUM_NULL))
    tables = [as_logged(table_of(platoon, STEP_S), LOG) for platoon in made]
    altered = {
        (name, strength): drives(
            [
                alter_drive(table, registry.effect_named(name), strength, LOG, np.random.default_rng(number))
                for number, table in enumerate(tables[:NUM_ALTERED])
            ],
            features,
        )
        for name, strength in alterations_of(STEP_S, FRAME_S)
        if registry.effect_named(name).is_sensor_s
    }
    engine = PlatoonEngine()
    runner = TrialRunner(cast(Any, engine), cast(Any, engine), features, (DriveStart(0.0),), 9000, FRAME_S)
    trials = runner.run(parameter_trials(LAYOUT, VALUES, NUM_TRIAL), lambda number: None)
    return Null(features, NullRuns(drives(tables, features), altered), runner, trials)


def diagnosed(null: Null, field: Sequence[DriveTable]) -> tuple[Tried, Any]:
    """The stage that tries all effects, and its verdict."""
    problem = cast(
        Any,
        SimpleNamespace(
            layout=LAYOUT,
            template=SimpleNamespace(base_demand_vehph=lambda: VALUES[:1], base_values=lambda: VALUES),
            scenario=SimpleNamespace(
                flows=[SimpleNamespace(id="flow", route=("edge",))], demand=SimpleNamespace(subject_route=("edge",))
            ),
        ),
    )
    tallies = drives(field, null.features)
    fitted = prepare(problem, tallies, null.runs, null.trials, OPEN_STEPS)
    baseline = Baseline(
        VALUES, null.features, cast(Any, None), null.runs, null.runner, null.trials, tallies, fitted, OPEN_STEPS
    )
    session = cast(
        Any,
        SimpleNamespace(
            problem=problem,
            plan=SimpleNamespace(effect_runs=NUM_TRIAL, local_runs=NUM_TRIAL),
            progress=Silent(),
            stopwatch=Stopwatch(lambda: 0.0),
        ),
    )
    book = TrialBook(null.runner, FinishedParts(None), "", null.trials, lambda number: None)
    tried = try_effects(session, baseline, book)
    null.trials.update(book.run("known", ()))  # the next field meets the same trials
    return tried, judge(tried.explained, best_gain(tried.explained), LEAST_TEMPERATURE, 0.0, False)


def field_of(settings: dict[str, EffectSetting]) -> list[DriveTable]:
    made = platoons([VALUES] * NUM_FIELD, [settings] * NUM_FIELD, range(70, 70 + NUM_FIELD))
    return [as_logged(table_of(platoon, STEP_S), LOG) for platoon in made]


def reasons(tried: Tried) -> dict[str, str]:
    problem = SimpleNamespace(layout=LAYOUT)
    return not_testable(cast(Findings, SimpleNamespace(problem=problem, explained=tried.explained)))


def test_a_local_one_is_found_at_its_place(null: Null):
    place_m = (800.0, 1200.0)
    tried, verdict = diagnosed(null, field_of({SUN_GLARE.name: EffectSetting(0.35, *place_m)}))
    assert verdict.effects[0] == SUN_GLARE.name
    found = next(one for one in tried.explained if one.name == SUN_GLARE.name)
    assert found.strength == pytest.approx(0.35, rel=0.3)
    assert found.setting is not None
    shared_m = min(place_m[1], found.setting["route_to_m"]) - max(place_m[0], found.setting["route_from_m"])
    whole_m = max(place_m[1], found.setting["route_to_m"]) - min(place_m[0], found.setting["route_from_m"])
    assert shared_m > 0.6 * whole_m
    assert not {SUN_GLARE.name, SPEED_SENSOR_BIAS.name} & reasons(tried).keys()


def test_a_sensor_s_one_is_found_without_code_for_drives(null: Null):
    def wrong(table: DriveTable) -> DriveTable:
        factor = np.where(table.is_subject, 1.0, 1.05)
        return as_logged(dataclasses.replace(table, speed_mps=factor * table.speed_mps), LOG)

    tried, verdict = diagnosed(null, [wrong(table) for table in field_of({})])
    assert verdict.effects == (SPEED_SENSOR_BIAS.name,)
    found = next(one for one in tried.explained if one.name == SPEED_SENSOR_BIAS.name)
    assert found.strength == pytest.approx(0.05, rel=0.3)
    assert SPEED_SENSOR_BIAS.name not in reasons(tried)


def test_without_either_neither_is_named(null: Null):
    tried, verdict = diagnosed(null, field_of({}))
    assert verdict.effects == ()
    ranked = {one.name for one in tried.explained}
    assert SPEED_SENSOR_BIAS.name in ranked
