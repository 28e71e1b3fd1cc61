"""VISSIM's W99: every regime with numbers worked out by hand, and what follows from them on the road."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sim_adapters.scenario.sumo_names import attribute_values, vehicle_class
from surrogate.car_following.replay import ReplayStart, ReplayState, replay
from surrogate.car_following.wiedemann99 import Wiedemann99, Wiedemann99Sumo
from surrogate.car_following.wiedemann99_vissim import Wiedemann99Vissim, vissim_from_sumo
from surrogate.lane_change.lc2013 import Lc2013
from surrogate.loop.kinematics import move
from surrogate.road.neighbours import own_leader
from surrogate.road.traffic_state import HEAD, empty_vehicles
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.vehicle_class import VehicleClass

STEP_S = 0.1
CC = {
    "minGap": 1.6, "cc1": 0.9, "cc2": 4.2, "cc3": -8.5, "cc4": -0.36,
    "cc5": 0.42, "cc6": 11.0, "cc7": 0.27, "cc8": 3.3, "cc9": 1.4,
    "decel": 4.1, "emergencyDecel": 8.6,
}  # fmt: skip
CC9_SPEED = 80.0 / 3.6
jitted_replay = jax.jit(replay, static_argnames="step_s")


def as_class(**changes: float) -> VehicleClass:
    return vehicle_class(attribute_values({n: str(v) for n, v in (CC | changes).items()}, "W99"), "W99")


def sumo() -> Wiedemann99:
    model = as_class().car_following
    assert isinstance(model, Wiedemann99Sumo)
    return model


def vissim(**changes: float) -> Wiedemann99Vissim:
    model = as_class(**changes).car_following
    assert isinstance(model, Wiedemann99)
    return vissim_from_sumo(model)


def wanted(
    v: float, vl: float, dx: float, al: float = 0.0, last: float = 0.0, desired: float = 40.0, r: float = 0.5
) -> float:
    values = (jnp.asarray(value) for value in (v, dx, vl, al, last, desired, r))
    return float(vissim().acceleration(FollowingSituation(*values), STEP_S))


def drive(
    model: CarFollowingModel,
    speed: np.ndarray,
    gap: np.ndarray,
    desired: float,
    leader_speed: np.ndarray,
) -> ReplayState:
    def like(values: np.ndarray | float) -> jax.Array:
        return jnp.asarray(np.broadcast_to(values, speed.shape), jnp.float32)

    start = ReplayStart(like(speed), like(0.0), like(gap), like(0.0), like(desired))
    leaders = jnp.asarray(np.broadcast_to(leader_speed[:, None], (len(leader_speed), len(speed))), jnp.float32)
    uniform = like(np.linspace(0.04, 0.93, len(speed)))
    return jax.device_get(jitted_replay(model, start, leaders, uniform, step_s=STEP_S)[1])


def test_the_parameters_are_those_of_the_sumo_model_and_all_leaves() -> None:
    old, new = sumo(), vissim_from_sumo(sumo())
    assert jax.tree.leaves(old) == jax.tree.leaves(new)
    assert len(jax.tree.leaves(new)) == 12
    assert float(new.cc9_acceleration_at_80kmh_mps2) == pytest.approx(1.4)
    assert float(new.jam_gap_m) == pytest.approx(1.6)
    assert float(new.time_gap_s) == pytest.approx(0.9)
    assert float(new.max_acceleration_mps2) == pytest.approx(3.3)
    assert float(vissim(cc9=3.9).max_acceleration_mps2) == pytest.approx(3.9)


@pytest.mark.parametrize(("v", "a"), [(0.0, 3.3), (CC9_SPEED / 2, 2.35), (CC9_SPEED, 1.4), (31.0, 1.4)])
def test_the_free_acceleration_goes_from_cc8_at_standstill_to_cc9_at_80_kmh(v: float, a: float) -> None:
    assert wanted(v, 5.0, np.inf) == pytest.approx(a, rel=1e-5)
    assert wanted(v, 5.0, np.inf, desired=v + 0.8) == pytest.approx(0.8, rel=1e-5)


# dv = -1, SDXc = 1.6 + 0.9 (14 - 0.2) = 14.02 with r = 0.7, SDVo = 0.42 + 0.0011 * 100
@pytest.mark.parametrize(
    ("situation", "a"),
    [
        (dict(v=15.0, vl=14.0, dx=10.0, al=-0.5, last=-0.2, r=0.7), -0.5 - 1.0 / 8.4),
        (dict(v=15.0, vl=14.0, dx=10.0, al=-0.5, last=-2.0, r=0.7), -2.0),  # never brakes less than before
        (dict(v=15.0, vl=14.0, dx=10.0, al=1.4, last=0.3, r=0.7), -0.27),  # at least CC7
        (dict(v=15.0, vl=15.3, dx=10.0, al=0.9, last=-2.0), -0.27),  # opening, but too slowly to be noticed
        (dict(v=3.0, vl=2.0, dx=1.2, al=-0.1), -0.1 - 0.5 * (1.0 + 0.42 + 0.0011 * 1.44)),  # closer than CC0
        (dict(v=16.0, vl=4.0, dx=2.0), -8.0),  # -10 + sqrt(16) / 2
        (dict(v=0.0, vl=0.0, dx=1.0, last=-0.4), 0.0),
    ],
)
def test_emergency(situation: dict[str, float], a: float) -> None:
    assert wanted(**situation) == pytest.approx(a, rel=1e-5)


def test_emergency_begins_at_the_safety_distance_which_a_leader_s_braking_moves() -> None:
    # SDXc = 14.02, or 1.6 + 0.9 * 15 = 15.1 where the leader brakes harder than 1 m/s^2
    assert wanted(15.0, 14.0, 14.01, al=-0.9, r=0.7) == pytest.approx(-0.9 - 1.0 / 12.41, rel=1e-5)
    assert wanted(15.0, 14.0, 15.05, al=-1.1, r=0.7) == pytest.approx(-1.1 - 1.0 / 13.45, rel=1e-5)
    # outside, the driver closes in: SDVc = -0.36 - 0.0011 * 15.05^2 = -0.609, SDXv = 18.22 + 8.5 * 0.64
    assert wanted(15.0, 14.0, 15.05, al=-0.9, r=0.7) == pytest.approx(-0.5 / 1.13, rel=1e-4)


def test_closing_in() -> None:
    # dv = -6, SDXc = 1.6 + 0.9 * 18 = 17.8, so that speeds are equal 0.1 m before it
    assert wanted(24.0, 18.0, 50.0) == pytest.approx(-18.0 / 32.3, rel=1e-5)
    assert wanted(40.0, 18.0, 30.0) == -10.0  # 242 / 12.3 is more than anybody brakes


def test_closing_in_begins_at_cc3_seconds_before_the_largest_following_gap() -> None:
    # dv = -6 is noticed up to sqrt((6 - 0.36) / 0.0011) = 71.6 m; SDXv = 22.0 + 8.5 * 5.64 = 69.94
    assert wanted(24.0, 18.0, 69.9) == pytest.approx(-18.0 / 52.2, rel=1e-4)
    assert wanted(24.0, 18.0, 70.0) == pytest.approx(1.4, rel=1e-5)
    # dv = -3: SDVc = -3.11 at 50 m and -2.49 at 44 m; SDXv = 22.0 + 8.5 * 2.64 = 44.44
    assert wanted(21.0, 18.0, 50.0) > 1.0
    assert wanted(21.0, 18.0, 44.0) == pytest.approx(-4.5 / 26.3, rel=1e-4)


def test_before_a_standing_leader_every_closing_speed_is_noticed_and_cc0_is_kept() -> None:
    # SDXc = 1.6, SDXv = 5.8 + 8.5 * 19.64 = 172.74
    assert wanted(20.0, 0.0, 120.0) == pytest.approx(-200.0 / 118.5, rel=1e-5)
    assert wanted(20.0, 0.0, 172.7) == pytest.approx(-200.0 / 171.2, rel=1e-5)
    assert wanted(20.0, 0.0, 172.8) > 1.0


# dv = 0.1, SDXc = 1.6 + 0.9 * 20 = 19.6, SDXo = 23.8, SDVo = 0.42 + 0.0011 * 21.5^2 = 0.928
@pytest.mark.parametrize(
    ("last", "desired", "a"),
    [(0.1, 40.0, 0.27), (0.6, 40.0, 0.6), (0.6, 20.2, 0.2), (0.0, 40.0, -0.27), (-0.8, 40.0, -0.8)],
)
def test_following(last: float, desired: float, a: float) -> None:
    assert wanted(20.0, 20.1, 21.5, last=last, desired=desired) == pytest.approx(a, rel=1e-4)


def test_a_leader_who_draws_away_is_followed_by_the_free_regime() -> None:
    assert wanted(20.0, 21.5, 21.5) == pytest.approx(2.25 / 2.3, rel=1e-5)
    assert wanted(20.0, 23.0, 21.5) == pytest.approx(3.3 - 1.9 * 0.9, rel=1e-5)  # 9 / 2.3 is more than a_max
    assert wanted(20.0, 23.0, 19.0) == 0.0  # still too close


def test_behind_a_steady_leader_the_gap_swings_around_the_band_of_following() -> None:
    states = drive(vissim(), np.full(5, 20.0), np.asarray([19.0, 24.0, 40.0, 70.0, 150.0]), 33.0, np.full(3000, 20.0))
    gap, speed = states.gap_m[1000:], states.speed_mps[1000:]
    least = 1.6 + 0.9 * 20.0
    # where r counts, v_slower differs from 20 m/s by half of dv at most, which moves SDXc by less than 0.5 m
    assert (gap > least - 0.5).all()
    assert (gap < least + 4.2 + 0.5).all()
    assert (np.ptp(gap, axis=0) > 1.5).all()
    turns = (np.diff(np.sign(speed - 20.0), axis=0) != 0).sum(axis=0)
    assert (turns >= 20).all()  # within 200 s
    # SDVo = 0.42 + 0.0011 * 23^2 = 1.0 is the largest opening speed that passes unnoticed, and SDVc about as much
    assert (np.abs(speed - 20.0) < 1.2).all()


@pytest.mark.parametrize("braking_mps2", [1.5, 3.0, 5.0])
def test_behind_a_leader_who_brakes_to_a_standstill_nobody_overlaps(braking_mps2: float) -> None:
    leader = np.maximum(0.0, 22.0 - braking_mps2 * np.maximum(0.0, STEP_S * np.arange(600) - 20.0))
    states = drive(vissim(), np.full(4, 22.0), np.asarray([21.5, 25.0, 33.0, 60.0]), 33.0, leader)
    assert (states.gap_m > 0.0).all()
    assert (states.speed_mps[-1] < 0.05).all()
    assert (states.gap_m[-1] < 1.6 + 4.2 + 0.1).all()


def test_gradients_by_the_parameters_are_finite_and_each_regime_s_parameters_act() -> None:
    time_s = STEP_S * np.arange(600)
    leader = jnp.asarray(np.stack([17.0 + 4.0 * np.sin(time_s / 6.0)] * 3, axis=1), jnp.float32)
    start = ReplayStart(
        speed_mps=jnp.asarray([0.0, 16.0, 23.0]),
        acceleration_mps2=jnp.zeros(3),
        gap_m=jnp.asarray([jnp.inf, 19.0, 70.0]),
        leader_acceleration_mps2=jnp.zeros(3),
        desired_speed_mps=jnp.full(3, 30.0),
    )

    def sum_of_speeds(model: Wiedemann99Vissim) -> jax.Array:
        return jnp.sum(replay(model, start, leader, jnp.full(3, 0.3), STEP_S)[1].speed_mps)

    gradient = jax.jit(jax.grad(sum_of_speeds))(vissim())
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(gradient))
    for leaf in (
        gradient.cc0_standstill_gap_m,
        gradient.cc1_time_gap_s,
        gradient.cc2_following_variation_m,
        gradient.cc7_oscillation_acceleration_mps2,
        gradient.cc8_standstill_acceleration_mps2,
        gradient.cc9_acceleration_at_80kmh_mps2,
    ):
        assert abs(float(leaf)) > 1e-3


def new_speeds(model: CarFollowingModel, step: int) -> np.ndarray:
    """Return the speeds after one step of twelve pairs, each in a row of its own; followers close in."""
    pairs = 12
    entries = np.arange(3 * pairs).reshape(pairs, 3)
    empty = empty_vehicles(pairs, 3 * pairs)
    position = np.tile([np.inf, 560.0, 500.0], pairs)
    changes = {
        "position_m": position,
        "speed_mps": np.tile([0.0, 18.0, 24.0], pairs),
        "acceleration_mps2": np.tile([0.0, 1.2, 0.0], pairs),  # SUMO's model draws behind such leaders only
        "row": np.repeat(np.arange(pairs), 3),
        "vehicle_class": np.tile([HEAD, 0, 0], pairs),
        "identity": np.arange(3 * pairs),
        "speed_factor": np.ones(3 * pairs),
        "speed_limit_mps": np.full(3 * pairs, 33.0),
        "slow_position_m": np.full(3 * pairs, np.inf),
        "slow_limit_mps": np.full(3 * pairs, 33.0),
        "stop_position_m": np.full(3 * pairs, np.inf),
    }
    fields = {name: getattr(empty, name) for name in type(empty).__dataclass_fields__}
    vehicles = type(empty)(**fields | {n: jnp.asarray(v, fields[n].dtype) for n, v in changes.items()})
    whole = as_class()
    assert isinstance(whole.lane_change, Lc2013)
    whole = VehicleClass(
        car_following=model,
        lane_change=whole.lane_change,
        length_m=whole.length_m,
        max_speed_mps=whole.max_speed_mps,
        speed_factor_mean=whole.speed_factor_mean,
        speed_factor_deviation=whole.speed_factor_deviation,
    )
    moved, _ = move(
        vehicles, own_leader(vehicles), (whole,), jnp.ones(3 * pairs), jnp.asarray(5), jnp.asarray(step), STEP_S
    )
    return np.asarray(moved.speed_mps)[entries[:, 2]]


def test_on_the_road_the_random_number_is_the_driver_s_in_vissim_and_the_step_s_in_sumo() -> None:
    early, late = new_speeds(vissim(), 31), new_speeds(vissim(), 812)
    np.testing.assert_array_equal(early, late)
    assert len(np.unique(early)) > 6  # drivers differ
    assert (new_speeds(sumo(), 31) != new_speeds(sumo(), 812)).any()
