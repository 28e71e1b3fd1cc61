"""Each effect on drivers moves what it must, as computed by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.effects.base import EffectSetting
from surrogate.effects.driver_heterogeneity import DRIVER_HETEROGENEITY
from surrogate.effects.lane_change_relaxation import LANE_CHANGE_RELAXATION
from surrogate.effects.reaction_delay import acts_now
from surrogate.effects.registry import EFFECT_NAMES
from surrogate.road.traffic_state import with_changes
from surrogate.vehicle.habits import Habits
from tests.surrogate.effects.effects_stage import (
    NUM_STEPS,
    S0,
    SEED,
    STEP_S,
    V0,
    A,
    B,
    T,
    drive,
    effects_of,
    moment_of,
    platoon,
)

FAR = [49000.0, 41000.0, 33000.0, 25000.0, 17000.0, 9000.0]  # no vehicle sees another
LEADER, SUBJECT = 1, 6


def test_all_off_is_the_same_as_without_any_setting_whatever_place_and_time_say() -> None:
    close = [500.0, 470.0, 452.0, 431.0, 399.0, 371.0]
    speeds = [18.0, 17.0, 20.0, 16.0, 19.0, 18.0]
    off = {name: EffectSetting(0.0, 380.0, 700.0, 10.0, 60.0, choice=1.0, time_constant_s=7.0) for name in EFFECT_NAMES}
    bare, dialled = drive(platoon(close, speeds, {}), {}), drive(platoon(close, speeds, off), off)
    assert bare.position_m.tobytes() == dialled.position_m.tobytes()
    assert bare.acceleration_mps2.tobytes() == dialled.acceleration_mps2.tobytes()


@pytest.mark.parametrize("slope", [0.013, 0.034])
def test_grade_lowers_the_free_speed_as_the_balance_of_forces_says_for_humans_only(slope: float) -> None:
    settings = {"grade": EffectSetting(slope)}
    after = drive(platoon(FAR, [20.0] * 6, settings), settings)
    balance = V0 * (1.0 - 9.81 * slope / A) ** 0.25
    np.testing.assert_allclose(after.speed_mps[-1, 1:SUBJECT], balance, rtol=2e-4)
    assert after.speed_mps[-1, SUBJECT] == pytest.approx(V0, rel=2e-3)


def test_grade_acts_on_its_stretch_only() -> None:
    settings = {"grade": EffectSetting(0.03, route_from_m=15000.0, route_to_m=35000.0)}
    after = drive(platoon(FAR, [24.0] * 6, settings), settings)
    bare = drive(platoon(FAR, [24.0] * 6, {}), {})
    first = after.acceleration_mps2[0] - bare.acceleration_mps2[0]
    np.testing.assert_allclose(first[1:], [0.0, 0.0, -0.2943, -0.2943, -0.2943, 0.0], atol=1e-5)


def test_delayed_drivers_act_at_their_interval_each_at_a_phase_of_his_own() -> None:
    vehicles = platoon(FAR, [20.0] * 6, {})
    interval = jnp.full((7,), 0.7)
    acts = np.stack([acts_now(interval, moment_of(vehicles, step)) for step in range(1, 141)])
    instants = [np.flatnonzero(acts[:, vehicle]) for vehicle in range(7)]
    assert all((np.diff(one) == 7).all() and len(one) == 20 for one in instants)
    assert len({int(one[0]) for one in instants}) > 2


def test_a_delayed_driver_answers_at_his_next_instant_and_keeps_his_answer() -> None:
    settings = {"reaction_delay": EffectSetting(1.1)}
    after = drive(platoon([3000.0, 2950.0, 2910.0, 2870.0, 2830.0, 2790.0], [15.0] * 6, settings), settings)
    for vehicle in range(1, SUBJECT):
        changes = np.flatnonzero(np.abs(np.diff(after.acceleration_mps2[:300, vehicle])) > 1e-4)
        assert len(changes) > 5
        assert (np.diff(changes) % 11 == 0).all()
    smooth = np.diff(after.acceleration_mps2[20:60, SUBJECT])
    assert (np.abs(smooth) > 0.0).all()  # the subject vehicle is not delayed


def test_the_subject_vehicle_alone_is_held_by_its_actuation_lag() -> None:
    settings = {"subject_actuation_lag": EffectSetting(0.5)}
    start = [3000.0, 2950.0, 2910.0, 2870.0, 2830.0, 2790.0], [15.0] * 6
    after, bare = drive(platoon(*start, settings), settings), drive(platoon(*start, {}), {})
    assert after.position_m[:, :SUBJECT].tobytes() == bare.position_m[:, :SUBJECT].tobytes()
    changes = np.flatnonzero(np.abs(np.diff(after.acceleration_mps2[:200, SUBJECT])) > 1e-4)
    assert len(changes) > 10
    assert (np.diff(changes) % 5 == 0).all()


def test_multi_anticipation_answers_to_the_second_leader_by_its_weight() -> None:
    settings = {"multi_anticipation": EffectSetting(0.4)}
    position, speed = [700.0, 660.0, 630.0, 300.0, 270.0, 100.0], [10.0, 18.0, 17.0, 20.0, 19.0, 21.0]
    first = drive(platoon(position, speed, settings), settings).acceleration_mps2[0]

    def idm(v: float, gap: float, leader: float) -> float:
        wanted = S0 + v * T + v * (v - leader) / (2.0 * np.sqrt(A * B))
        return A * (1.0 - (v / V0) ** 4 - (wanted / gap) ** 2)

    assert first[3] == pytest.approx(idm(17.0, 660.0 - 4.8 - 630.0, 18.0 + 0.4 * (10.0 - 18.0)), abs=1e-4)
    assert first[5] == pytest.approx(idm(19.0, 300.0 - 4.8 - 270.0, 20.0), abs=1e-4)  # the second is too far away
    assert first[2] == pytest.approx(idm(18.0, 700.0 - 4.8 - 660.0, 10.0), abs=1e-4)  # there is no second


def test_memory_lengthens_the_time_gap_as_its_level_falls() -> None:
    """At a constant speed v the level goes to v / v0 with the time constant, and IDM's gap follows."""
    settings = {"memory": EffectSetting(0.7, time_constant_s=20.0)}
    after = drive(platoon(FAR, [0.0] * 6, settings), settings)
    level = after.personal["memory"]["level"]
    expected, value = [], np.ones(7)
    for speed in after.speed_mps:
        value = np.minimum(value + STEP_S / 20.0 * (speed / V0 - value), 1.0)
        expected.append(value)
    np.testing.assert_allclose(level, np.stack(expected), rtol=1e-5)
    assert level[:, 3].min() < 0.85

    held = with_changes(
        platoon([500.0, 470.0, 440.0, 410.0, 380.0, 350.0], [12.0] * 6, settings),
        personal=platoon(FAR, [0.0] * 6, settings).personal | {"memory": {"level": jnp.full((7,), 0.25)}},
    )
    first = drive(held, settings).acceleration_mps2[0]
    gap = S0 + 12.0 * T * (1.0 + 0.7 * 0.75)
    assert first[3] == pytest.approx(A * (1.0 - (12.0 / V0) ** 4 - (gap / 25.2) ** 2), rel=1e-4)


def test_slow_start_weakens_the_acceleration_between_its_two_speeds_only_after_a_queue() -> None:
    settings = {"slow_start": EffectSetting(0.3)}
    speeds = [0.0, 7.5, 8.1, 13.0, 14.5, 3.0]
    after, bare = drive(platoon(FAR, speeds, settings), settings), drive(platoon(FAR, speeds, {}), {})
    share = after.acceleration_mps2[5, 1:] / bare.acceleration_mps2[5, 1:]
    np.testing.assert_allclose(share, [0.7, 0.7, 1.0, 1.0, 1.0, 1.0], atol=0.02)
    recovers = after.personal["slow_start"]["recovers"][:, LEADER]
    end = int(np.argmin(recovers))
    assert after.speed_mps[end, LEADER] >= 14.0 > after.speed_mps[end - 1, LEADER]


def test_heterogeneity_is_lognormal_of_mean_one_with_the_given_variation() -> None:
    many = 40_000
    crowd = with_changes(platoon(FAR, [1.0] * 6, {}), identity=jnp.arange(many), speed_mps=jnp.ones((many,)))
    dial = effects_of({"driver_heterogeneity": EffectSetting(0.3)}).dial("driver_heterogeneity")
    assert DRIVER_HETEROGENEITY.begin is not None
    traits = DRIVER_HETEROGENEITY.begin(dial, crowd, jnp.asarray(SEED))
    for factor in traits.values():
        factor = np.asarray(factor, float)
        assert factor.mean() == pytest.approx(1.0, abs=4 * 0.3 / np.sqrt(many))
        assert factor.std() == pytest.approx(0.3, rel=0.03)
    assert abs(np.corrcoef(traits["time_gap"], traits["deceleration"])[0, 1]) < 4 / np.sqrt(many)


def test_perception_errors_spread_as_their_process_says() -> None:
    """The stationary spread is the noise's intensity, 0.2 times the strength; 90 s are 1.8 time scales of 50 s."""
    settings = {"acceleration_noise": EffectSetting(0.5)}
    errors = []
    for shift in range(60):
        start = with_changes(platoon(FAR, [20.0] * 6, settings), identity=jnp.arange(7) + 100 * shift)
        errors.append(drive(start, settings).personal["acceleration_noise"]["error"][-1])
    expected = 0.1 * np.sqrt(1.0 - np.exp(-2.0 * NUM_STEPS * STEP_S / 50.0))
    spread = np.std(np.concatenate(errors))
    assert spread == pytest.approx(expected, rel=4.0 / np.sqrt(2 * 420))  # four standard errors
    assert abs(np.mean(np.concatenate(errors))) < 4.0 * expected / np.sqrt(420)


def test_relaxation_gives_up_a_share_of_the_time_gap_and_takes_it_back_exponentially() -> None:
    effect = LANE_CHANGE_RELAXATION
    assert effect.settle is not None
    assert effect.adapt is not None
    assert effect.remember is not None
    settings = {effect.name: EffectSetting(0.4, time_constant_s=12.0)}
    dial = effects_of(settings).dial(effect.name)
    vehicles = platoon(FAR, [20.0] * 6, settings)
    changed = jnp.asarray([0, 0, 1, 0, 0, 0, 0])
    memory = effect.settle(dial, moment_of(vehicles), changed)
    np.testing.assert_array_equal(memory["patience"], [0, 0, 1, 1, 0, 0, 0])  # the changer and who is behind him
    for _ in range(30):
        vehicles = with_changes(vehicles, personal=dict(vehicles.personal or {}) | {effect.name: memory})
        memory = effect.remember(dial, moment_of(vehicles), vehicles.speed_mps)
    vehicles = with_changes(vehicles, personal=dict(vehicles.personal or {}) | {effect.name: memory})
    habits = effect.adapt(dial, Habits.usual(vehicles.speed_mps), moment_of(vehicles))
    factor = 1.0 - 0.4 * np.exp(-3.0 / 12.0)
    np.testing.assert_allclose(habits.time_gap, [1, 1, factor, factor, 1, 1, 1], rtol=1e-5)
    assert (habits.acceleration == 1.0).all()
