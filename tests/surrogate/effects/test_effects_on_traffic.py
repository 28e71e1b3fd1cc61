"""Effects on demand, composition, road and lane changing, each against its own rule."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.world.world_builder import WorldTemplate
from surrogate.car_following.idm import Idm
from surrogate.effects.apply import NUM_CLASSES_OF_EFFECTS, true_newcomers
from surrogate.effects.base import Arrivals, EffectSetting, Newcomers
from surrogate.effects.blockage import BLOCKAGE
from surrogate.effects.lane_change_duration import LANE_CHANGE_DURATION
from surrogate.effects.local_speed_reduction import LOCAL_SPEED_REDUCTION
from surrogate.effects.platooned_arrivals import PLATOONED_ARRIVALS
from surrogate.effects.registry import effect_named
from surrogate.effects.rubbernecking import RUBBERNECKING
from surrogate.keyed_random import Purpose, exponential
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.road.road import Road
from surrogate.road.traffic_state import VehicleArrays, with_changes
from surrogate.vehicle.lane_change_model import LEFT, RIGHT, STAY, LaneChangeDecision
from tests.surrogate.effects.effects_stage import B, classes_of, effects_of, idm_class, moment_of, platoon

SEED = jnp.asarray(9)
POSITIONS = [1500.0, 1450.0, 1390.0, 1300.0, 1200.0, 900.0]


def vehicles_with(settings: dict[str, EffectSetting], speed_mps: float = 20.0) -> VehicleArrays:
    return platoon(POSITIONS, [speed_mps] * 6, settings)


def as_seen(
    vehicles: VehicleArrays, effect: str, settings: dict[str, EffectSetting], step: int, road: Road
) -> VehicleArrays:
    hook = effect_named(effect).road
    assert hook is not None
    return hook(effects_of(settings).dial(effect), vehicles, road, moment_of(vehicles, step))


def test_platoons_keep_the_mean_flow_and_bunch_the_given_share() -> None:
    """Of 28,000 arrivals at one entrance, 60 % in platoons in which they follow within 1.4 s / 3 lanes."""
    effect, demand = PLATOONED_ARRIVALS, 1.1
    assert effect.arrival is not None
    dial = effects_of({effect.name: EffectSetting(0.6)}).dial(effect.name)
    count = 28_000
    arrival = jnp.arange(count)
    gap = exponential(SEED, arrival, 0, Purpose.ARRIVAL)

    def bunched(is_mainline: bool) -> np.ndarray:
        # the entrances of this call are one entrance at many arrivals, so the number of each is taken off again
        flags = jnp.full((count,), is_mainline)
        shifted = Arrivals(arrival, jnp.full((count,), 3), jnp.full((count,), demand), flags, SEED)
        return np.asarray(effect.arrival(dial, gap, shifted))  # pyright: ignore[reportOptionalCall]

    np.testing.assert_array_equal(bunched(False), gap)
    gaps = bunched(True)
    assert gaps.mean() == pytest.approx(1.0, abs=0.04)
    within = 1.4 / 3 * demand
    is_later = (np.arange(count) % 14 > 0) & (gaps != np.asarray(gap))
    assert is_later.mean() == pytest.approx(0.6 * 13 / 14, abs=0.02)
    assert gaps[is_later].min() >= 0.6 * within
    assert gaps[is_later].mean() == pytest.approx(within, rel=0.02)


def test_ramp_error_scales_one_input_and_no_other(template: WorldTemplate) -> None:
    values = jnp.asarray(template.base_values(), jnp.float32)
    at = jnp.asarray(3), jnp.asarray(300.0)
    usual = template.world(values, *at, effects_of({}))
    wrong = template.world(values, *at, effects_of({"ramp_inflow_error": EffectSetting(-0.3, choice=1)}))
    share = np.asarray(wrong.demand_vehps) / np.asarray(usual.demand_vehps)
    np.testing.assert_allclose(sorted(share), [0.7, 1.0], rtol=1e-6)
    assert np.asarray(usual.demand_vehps).tobytes() == np.asarray(template.world(values, *at).demand_vehps).tobytes()


def test_lorries_come_at_their_share_and_are_long_and_slow() -> None:
    settings = {"heavy_vehicles": EffectSetting(0.15)}
    classes = classes_of(effects_of(settings))
    assert len(classes) == 2 + NUM_CLASSES_OF_EFFECTS
    heavy = classes[1]
    assert isinstance(heavy.car_following, Idm)
    assert heavy.length_m == 13.5
    assert heavy.max_speed_mps == pytest.approx(85.0 / 3.6)
    assert heavy.car_following.max_acceleration_mps2 < idm_class().car_following.max_acceleration_mps2
    many = 20_000
    shape = (1, many)
    newcomers = Newcomers(
        identity=jnp.arange(many).reshape(shape),
        vehicle_class=jnp.zeros(shape, jnp.int32),
        speed_factor=jnp.ones(shape),
        is_subject=(jnp.arange(many) == 5).reshape(shape),
    )
    made = true_newcomers(effects_of({"heavy_vehicles": EffectSetting(1.0)}), newcomers, classes, SEED)
    assert np.asarray(made.vehicle_class)[0, :7].tolist() == [1, 1, 1, 1, 1, 0, 1]
    made = true_newcomers(effects_of(settings), newcomers, classes, SEED)
    assert np.mean(np.asarray(made.vehicle_class) == 1) == pytest.approx(0.15, abs=4 * np.sqrt(0.15 * 0.85 / many))


@pytest.mark.parametrize(("added", "expected"), [(0.4, 0.7), (0.9, 1.0), (-0.5, 0.0)])
def test_yielding_adds_willingness_up_to_one(added: float, expected: float) -> None:
    model = classes_of(effects_of({"cooperative_yielding": EffectSetting(added)}))[0].lane_change
    assert isinstance(model, Lc2013)
    assert model.cooperative == pytest.approx(expected, abs=1e-6)
    assert model.cooperative_speed == pytest.approx(min(max(0.25 + added, 0.0), 1.0), abs=1e-6)


def test_keep_right_adds_to_the_humans_eagerness_and_leaves_the_subject_vehicle() -> None:
    classes = classes_of(effects_of({"keep_right": EffectSetting(3.0)}))
    eagerness = [float(one.lane_change.keep_right) for one in classes]  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_allclose(eagerness, [3.1, 3.1, 0.1], rtol=1e-6)


def test_a_slower_stretch_is_driven_slower_and_announced_upstream(template: WorldTemplate) -> None:
    settings = {"local_speed_reduction": EffectSetting(0.2, route_from_m=1250.0, route_to_m=1400.0)}
    vehicles = vehicles_with(settings)
    after = as_seen(vehicles, LOCAL_SPEED_REDUCTION.name, settings, 100, template.road)
    limits = np.asarray(after.speed_limit_mps) / np.asarray(vehicles.speed_limit_mps)
    np.testing.assert_allclose(limits[1:], [1.0, 1.0, 0.8, 0.8, 1.0, 1.0], rtol=1e-6)
    np.testing.assert_array_equal(after.slow_position_m[1:], [*[np.inf] * 4, 1250.0, np.inf])
    np.testing.assert_allclose(after.slow_limit_mps[5], 0.8 * np.asarray(vehicles.speed_limit_mps)[5], rtol=1e-6)


def test_curious_drivers_slow_by_a_third_within_place_and_time(template: WorldTemplate) -> None:
    setting = EffectSetting(0.5, 1190.0, 1460.0, 30.0, 60.0)
    settings = {"rubbernecking": setting}
    share = []
    for shift in range(40):
        vehicles = with_changes(vehicles_with(settings), identity=jnp.arange(7) + 50 * shift)
        late = as_seen(vehicles, RUBBERNECKING.name, settings, 601, template.road)
        np.testing.assert_array_equal(late.speed_limit_mps, vehicles.speed_limit_mps)
        after = as_seen(vehicles, RUBBERNECKING.name, settings, 450, template.road)
        ratio = np.asarray(after.speed_limit_mps / vehicles.speed_limit_mps)
        assert (np.isclose(ratio[2:6], 0.65) | (ratio[2:6] == 1.0)).all()
        assert (ratio[[1, 6]] == 1.0).all()  # beyond the place; the subject vehicle
        share.append(np.mean(ratio[2:6] < 1.0))
    assert np.mean(share) == pytest.approx(0.5, abs=4 * np.sqrt(0.25 / 160))


def test_the_first_vehicle_that_can_still_stop_blocks_the_lane_for_its_time(template: WorldTemplate) -> None:
    road = template.road
    place_m, speed = 1480.0, 20.0
    braking_m = speed**2 / (2.0 * B)
    assert 1450.0 + braking_m > place_m > 1300.0 + braking_m + 5.0
    settings = {BLOCKAGE.name: EffectSetting(90.0, route_from_m=place_m, time_from_s=50.0, choice=1.0)}
    lanes = np.flatnonzero(np.asarray(road.is_carriageway)[:, int(road.segment_at(jnp.asarray(place_m)))])
    dial = effects_of(settings).dial(BLOCKAGE.name)
    vehicles = vehicles_with(settings, speed)

    def settled(vehicles: VehicleArrays, step: int) -> VehicleArrays:
        vehicles = as_seen(vehicles, BLOCKAGE.name, settings, step, road)
        memory = BLOCKAGE.settle(dial, moment_of(vehicles, step), jnp.zeros((7,), jnp.int32))  # pyright: ignore
        return with_changes(vehicles, personal=dict(vehicles.personal or {}) | {BLOCKAGE.name: memory})

    elsewhere = settled(vehicles, 500)  # row 0 is the furthest right
    assert not elsewhere.personal[BLOCKAGE.name]["stops"].any()  # pyright: ignore[reportOptionalSubscript]
    vehicles = with_changes(vehicles, row=jnp.full_like(vehicles.row, int(lanes[-1])))
    early = settled(vehicles, 390)
    assert not early.personal[BLOCKAGE.name]["stops"].any()  # pyright: ignore[reportOptionalSubscript]
    during = settled(vehicles, 500)
    stops = during.personal[BLOCKAGE.name]["stops"]  # pyright: ignore[reportOptionalSubscript]
    assert np.flatnonzero(stops).tolist() == [4]  # 1300 m; to brake takes 105 m, and from 1390 m there are 90
    again = settled(during, 510)
    np.testing.assert_array_equal(again.personal[BLOCKAGE.name]["stops"], stops)  # pyright: ignore
    assert np.asarray(again.stop_position_m)[4] == place_m
    assert (np.asarray(again.stop_position_m)[[1, 2, 3, 5, 6]] == np.inf).all()
    over = settled(with_changes(again, stop_position_m=jnp.full((7,), jnp.inf)), 1401)
    assert (np.asarray(over.stop_position_m) == np.inf).all()


def test_nobody_begins_a_lane_change_in_the_midst_of_one() -> None:
    effect = LANE_CHANGE_DURATION
    assert effect.settle is not None
    assert effect.decide is not None
    assert effect.remember is not None
    settings = {effect.name: EffectSetting(2.5)}
    dial = effects_of(settings).dial(effect.name)
    vehicles = vehicles_with(settings)
    direction = jnp.asarray([STAY, LEFT, STAY, RIGHT, STAY, STAY, STAY])
    memory = effect.settle(dial, moment_of(vehicles), direction)
    wish = {name: jnp.zeros((7,)) for name in LaneChangeDecision.__dataclass_fields__}
    decision = dataclasses.replace(LaneChangeDecision(**wish), direction=jnp.full((7,), LEFT, jnp.int32))
    for step in range(30):
        vehicles = with_changes(vehicles, personal=dict(vehicles.personal or {}) | {effect.name: memory})
        moment = moment_of(vehicles, step)
        is_busy = step < 25
        expected = [LEFT, STAY if is_busy else LEFT, LEFT, STAY if is_busy else LEFT, LEFT, LEFT, LEFT]
        if step not in (24, 25, 26):  # where rounding decides
            np.testing.assert_array_equal(effect.decide(dial, decision, moment).direction, expected)
        memory = effect.remember(dial, moment, vehicles.speed_mps)
