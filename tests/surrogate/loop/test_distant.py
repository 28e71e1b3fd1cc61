"""Vehicles that follow by another model beyond the sensors' range."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.errors import ScenarioError
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario, read_scenario
from sim_adapters.world.world_builder import WorldTemplate, build_template
from surrogate.car_following.idm import Idm
from surrogate.car_following.wiedemann99 import Wiedemann99Sumo
from surrogate.loop.world import World
from surrogate.road.traffic_state import TrafficState

AHEAD_M, BEHIND_M = 150.0, 90.0
DEPART_S = 40
DECISIONS = 75
SPEED_FACTOR = 0.93
ALIKE = 'id="far" vClass="passenger" length="4.8" carFollowModel="IDM" accel="2.6" decel="4.5" tau="1.0" minGap="2.5" '
ALIKE += 'delta="4" speedFactor="1.0" speedDev="0.1"'
OTHER = f'id="far" vClass="passenger" length="4.8" carFollowModel="W99" speedFactor="{SPEED_FACTOR}" lcSpeedGain="0.2"'

Drive = Callable[[World, int], list[TrafficState]]


def scenario_with(far: str, corridor_folder: Path, tmp_path: Path) -> Scenario:
    """Return the corridor with one more vType."""
    folder = tmp_path / "scenario"
    folder.mkdir()
    for file in (corridor_folder / "scenario").iterdir():
        text = file.read_text(encoding="utf-8")
        (folder / file.name).write_text(text.replace("<vType id=", f"<vType {far}/>\n<vType id=", 1), encoding="utf-8")
    return read_scenario(folder / "scenario.sumocfg", "ego", 720.0)


def world_of(template: WorldTemplate) -> World:
    values = jnp.asarray(template.base_values(), jnp.float32)
    return template.world(values, jnp.asarray(7, jnp.int32), jnp.asarray(DEPART_S, jnp.float32))


@pytest.fixture(scope="module")
def mixed(
    corridor_folder: Path, layout: ParameterLayout, tmp_path_factory: pytest.TempPathFactory, drive_on: Drive
) -> tuple[World, list[TrafficState]]:
    """The corridor whose distant vehicles follow W99, and its states."""
    scenario = scenario_with(OTHER, corridor_folder, tmp_path_factory.mktemp("mixed"))
    world = world_of(build_template(scenario, layout, None, (AHEAD_M, BEHIND_M), {"car": "far"}))
    return world, drive_on(world, DECISIONS)


def test_a_vehicle_s_class_says_whether_it_is_near(mixed: tuple[World, list[TrafficState]]) -> None:
    world, states = mixed
    car, far, subject = range(3)
    assert isinstance(world.classes[car].car_following, Idm)
    assert isinstance(world.classes[far].car_following, Wiedemann99Sumo)
    assert world.subject_class == subject
    counts = np.zeros(2, int)
    for before, state in itertools.pairwise(states):
        vehicles = state.vehicles
        known = np.asarray(before.vehicles.identity)[np.asarray(before.vehicles.vehicle_class) >= 0]
        settled = (np.asarray(vehicles.vehicle_class) >= 0) & np.isin(np.asarray(vehicles.identity), known)
        place = np.asarray(vehicles.vehicle_class) == subject
        moved_m = 60.0  # since the decision at which classes were given; newcomers waited for it
        if not place.any():
            assert np.all(np.asarray(vehicles.vehicle_class)[settled] == far)
            continue
        ahead_m = np.asarray(vehicles.position_m) - float(np.asarray(vehicles.position_m)[place][0])
        if not np.any(np.asarray(before.vehicles.vehicle_class) == subject):
            continue  # it has entered at this decision, after the classes were given
        others = settled & ~place
        inside = others & (ahead_m < AHEAD_M - moved_m) & (ahead_m > -BEHIND_M + moved_m)
        outside = others & ((ahead_m > AHEAD_M + moved_m) | (ahead_m < -BEHIND_M - moved_m))
        assert np.all(np.asarray(vehicles.vehicle_class)[inside] == car)
        assert np.all(np.asarray(vehicles.vehicle_class)[outside] == far)
        counts += inside.sum(), outside.sum()
    assert np.all(counts > 100)


def test_nobody_jumps_who_changes_over(mixed: tuple[World, list[TrafficState]]) -> None:
    """A second's change of speed is what braking and accelerating can do, also of those who have changed class."""
    _, states = mixed
    num_changed = 0
    for before, after in itertools.pairwise(states):
        one, other = before.vehicles, after.vehicles
        known = {int(i): k for k, i in enumerate(np.asarray(one.identity)) if int(one.vehicle_class[k]) >= 0}
        for place, identity in enumerate(np.asarray(other.identity)):
            if int(other.vehicle_class[place]) < 0 or int(identity) not in known:
                continue
            k = known[int(identity)]
            if int(one.vehicle_class[k]) == int(other.vehicle_class[place]):
                continue
            num_changed += 1
            assert -9.1 < float(other.speed_mps[place] - one.speed_mps[k]) < 3.6
            moved = float(other.speed_factor[place] - one.speed_factor[k])
            sign = 1.0 if int(other.vehicle_class[place]) == 0 else -1.0
            assert moved == pytest.approx(sign * (1.0 - SPEED_FACTOR), abs=1e-5)
    assert num_changed > 20


def test_distant_vehicles_that_follow_alike_change_nothing(
    corridor_folder: Path, layout: ParameterLayout, tmp_path: Path, drive_on: Drive, corridor: Scenario
) -> None:
    scenario = scenario_with(ALIKE, corridor_folder, tmp_path)
    alike = drive_on(world_of(build_template(scenario, layout, None, (AHEAD_M, BEHIND_M), {"car": "far"})), DECISIONS)
    plain = drive_on(world_of(build_template(corridor, layout)), DECISIONS)
    one, other = alike[-1].vehicles, plain[-1].vehicles
    np.testing.assert_array_equal(one.row, other.row)
    np.testing.assert_allclose(one.position_m, other.position_m, atol=1e-3)
    assert np.sum(np.asarray(one.vehicle_class) == 1) > 10


def test_calibrated_lane_changing_goes_with_the_vehicle(
    corridor_folder: Path, layout: ParameterLayout, tmp_path: Path
) -> None:
    """SUMO's setType leaves lane changing alone, and so does the surrogate: the vType's own attributes do not count."""
    scenario = scenario_with(OTHER, corridor_folder, tmp_path)
    wide = replace(layout, attributes=("tau", "lcSpeedGain"))
    template = build_template(scenario, wide, None, (AHEAD_M, BEHIND_M), {"car": "far"})
    values = jnp.asarray([*template.base_values()[:2], 1.7, 2.3], jnp.float32)
    classes = template.world(values, jnp.asarray(1), jnp.asarray(60.0)).classes
    assert float(classes[1].lane_change.speed_gain) == pytest.approx(2.3)
    assert float(classes[1].speed_factor_mean) == pytest.approx(SPEED_FACTOR)


@pytest.mark.parametrize(
    ("far", "chosen", "expected"),
    [
        (OTHER, {"lorry": "far"}, "<flow type='lorry'>"),
        (OTHER, {"car": "missing"}, "<vType id='missing'>"),
        (OTHER, {"car": "subject"}, "enters nowhere"),
        (OTHER.replace("4.8", "6.0"), {"car": "far"}, "length"),
    ],
)
def test_distant_vtypes_that_cannot_be_are_refused(
    far: str, chosen: dict[str, str], expected: str, corridor_folder: Path, layout: ParameterLayout, tmp_path: Path
) -> None:
    scenario = scenario_with(far, corridor_folder, tmp_path)
    with pytest.raises(ScenarioError, match=expected):
        build_template(scenario, layout, None, (AHEAD_M, BEHIND_M), chosen)
