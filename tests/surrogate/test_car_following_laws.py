"""Laws that every car-following model obeys on the road, and what only some of them promise."""

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.base import CarFollowingModel, FollowingSituation
from surrogate.car_following.idm import Idm
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.wiedemann99 import Wiedemann99Sumo
from surrogate.car_following.wiedemann99_vissim import Wiedemann99Vissim
from surrogate.replay import ReplayStart, ReplayState, replay

STEP_S = 0.1
ROUNDING = 1e-4
COMMON = {"max_deceleration_mps2": 3.4, "emergency_deceleration_mps2": 8.3}
IDM = COMMON | {"jam_gap_m": 2.3, "time_gap_s": 1.15, "max_acceleration_mps2": 1.7, "acceleration_exponent": 3.6}
KRAUSS = COMMON | {"jam_gap_m": 2.3, "time_gap_s": 1.15, "max_acceleration_mps2": 1.7, "imperfection": 0.0}
W99 = COMMON | {
    "cc0_standstill_gap_m": 1.8,
    "cc1_time_gap_s": 1.2,
    "cc2_following_variation_m": 7.0,
    "cc3_following_threshold_s": -11.0,
    "cc4_negative_speed_threshold_mps": -0.3,
    "cc5_positive_speed_threshold_mps": 0.4,
    "cc6_oscillation_speed_dependency": 6.5,
    "cc7_oscillation_acceleration_mps2": 0.3,
    "cc8_standstill_acceleration_mps2": 2.2,
    "cc9_acceleration_at_80kmh_mps2": 1.4,
}
MODELS: Mapping[str, Callable[[], CarFollowingModel]] = {
    "IDM": lambda: Idm(**{name: jnp.asarray(value) for name, value in IDM.items()}),
    "Krauss": lambda: Krauss(**{name: jnp.asarray(value) for name, value in KRAUSS.items()}),
    "W99": lambda: Wiedemann99Sumo(**{name: jnp.asarray(value) for name, value in W99.items()}),
    "W99 of VISSIM": lambda: Wiedemann99Vissim(**{name: jnp.asarray(value) for name, value in W99.items()}),
}
# Two laws are IDM's and Krauss's only. Both W99 judge by thresholds, at which the acceleration jumps: with more gap a
# driver may pass from keeping his speed to closing in. And SUMO's wants CC8 + CC9 v + random, of which SUMO grants CC8.
every_model = pytest.mark.parametrize("name", MODELS)
jitted_replay = jax.jit(replay, static_argnames="step_s")


def drive(
    model: CarFollowingModel,
    speed: np.ndarray,
    gap: np.ndarray,
    desired: np.ndarray,
    leader_speed: np.ndarray,
    leader_acceleration: np.ndarray | float = 0.0,
    acceleration: np.ndarray | float = 0.0,
) -> ReplayState:
    """Return the followers after every step behind leaders whose speeds are given, [step, follower]."""

    def filled(value: np.ndarray | float) -> jnp.ndarray:
        return jnp.asarray(np.broadcast_to(value, np.shape(speed)), jnp.float32)

    start = ReplayStart(filled(speed), filled(acceleration), filled(gap), filled(leader_acceleration), filled(desired))
    uniform = filled(np.linspace(0.03, 0.96, np.size(speed)))
    return jitted_replay(model, start, jnp.asarray(leader_speed, jnp.float32), uniform, step_s=STEP_S)[1]


def random_situations(seed: int, number: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {
        "speed_mps": rng.uniform(0.0, 33.0, number),
        "gap_m": np.where(rng.random(number) < 0.1, np.inf, rng.gamma(1.5, 25.0, number)),
        "leader_speed_mps": rng.uniform(0.0, 33.0, number),
        "leader_acceleration_mps2": rng.normal(-0.3, 1.5, number),
        "acceleration_mps2": rng.normal(0.2, 1.0, number),
        "desired_speed_mps": rng.uniform(8.0, 36.0, number),
        "uniform": rng.uniform(0.01, 0.99, number),
    }


def following(situations: dict[str, np.ndarray]) -> FollowingSituation:
    return FollowingSituation(**{name: jnp.asarray(values) for name, values in situations.items()})


@every_model
def test_on_a_free_road_a_vehicle_at_its_desired_speed_keeps_it(name: str) -> None:
    desired = np.asarray([7.3, 19.6, 31.4])
    states = drive(MODELS[name](), desired, np.full(3, np.inf), desired, np.full((200, 3), 4.0))
    np.testing.assert_allclose(np.asarray(states.acceleration_mps2), 0.0, atol=2e-3)
    np.testing.assert_allclose(np.asarray(states.speed_mps), np.broadcast_to(desired, (200, 3)), rtol=1e-5)


@every_model
def test_on_a_free_road_a_slower_vehicle_reaches_its_desired_speed_and_never_exceeds_it(name: str) -> None:
    speed, desired = np.asarray([0.0, 2.7, 14.2]), np.asarray([16.8, 21.9, 17.3])
    states = drive(MODELS[name](), speed, np.full(3, np.inf), desired, np.full((900, 3), 4.0))
    assert (np.asarray(states.speed_mps) <= desired + ROUNDING).all()
    assert (np.diff(np.asarray(states.speed_mps), axis=0) >= -ROUNDING).all()
    np.testing.assert_allclose(np.asarray(states.speed_mps[-1]), desired, rtol=2e-3)


@every_model
def test_no_vehicle_accelerates_or_brakes_harder_than_it_can_in_any_situation(name: str) -> None:
    model, s = MODELS[name](), random_situations(1, 4000)
    states = drive(
        model,
        s["speed_mps"],
        s["gap_m"],
        s["desired_speed_mps"],
        s["leader_speed_mps"][None],
        s["leader_acceleration_mps2"],
        s["acceleration_mps2"],
    )
    gained = np.asarray(states.speed_mps[0]) - s["speed_mps"]
    assert (gained <= float(model.max_acceleration_mps2) * STEP_S + ROUNDING).all()
    assert (gained >= -float(model.emergency_deceleration_mps2) * STEP_S - ROUNDING).all()
    assert (np.asarray(states.speed_mps) >= 0.0).all()
    is_slower = s["speed_mps"] < s["desired_speed_mps"]
    assert (np.asarray(states.speed_mps[0]) <= np.where(is_slower, s["desired_speed_mps"], s["speed_mps"]) + 1e-5).all()


@pytest.mark.parametrize("name", ["IDM", "Krauss"])
def test_what_the_driver_wants_never_exceeds_the_model_s_maximum(name: str) -> None:
    wanted = MODELS[name]().acceleration(following(random_situations(2, 4000)), STEP_S)
    assert np.isfinite(np.asarray(wanted)).all()
    assert float(wanted.max()) <= 1.7 + ROUNDING
    assert float(wanted.max()) > 1.0


@pytest.mark.parametrize("name", ["IDM", "Krauss"])
def test_more_gap_or_a_faster_leader_never_makes_a_driver_slower(name: str) -> None:
    situations = random_situations(3, 60)
    gaps = np.append(np.linspace(0.4, 250.0, 400), np.inf)
    speeds = np.linspace(0.0, 34.0, 200)
    with jax.enable_x64():
        model = MODELS[name]()
        by_gap = following({k: v[:, None] for k, v in situations.items()} | {"gap_m": gaps[None]})
        by_gap = np.asarray(model.acceleration(by_gap, STEP_S))
        by_leader = following({k: v[:, None] for k, v in situations.items()} | {"leader_speed_mps": speeds[None]})
        by_leader = np.asarray(model.acceleration(by_leader, STEP_S))
    assert (np.diff(by_gap, axis=1) >= -1e-9).all()
    assert (np.diff(by_leader, axis=1) >= -1e-9).all()
    matters = [(wanted[:, -1] > wanted[:, 0] + 0.5).mean() for wanted in (by_gap, by_leader)]
    assert min(matters) > 0.3  # the others are held by their own acceleration or desired speed


@every_model
def test_a_vehicle_that_comes_upon_a_standing_obstacle_stops_before_it(name: str) -> None:
    gap = np.asarray([58.0, 71.5, 96.0, 133.0, 187.5, 260.0, 341.0])
    states = drive(MODELS[name](), np.full(7, 20.0), gap, np.full(7, 26.0), np.zeros((1200, 7)))
    assert (np.asarray(states.gap_m) >= 0.0).all()
    assert (np.asarray(states.speed_mps[-1]) < 0.05).all()
    assert (np.asarray(states.gap_m[-1]) < 10.0).all()


@every_model
def test_behind_a_leader_who_stops_and_goes_nobody_overlaps(name: str) -> None:
    time_s = STEP_S * np.arange(1500)
    wave = np.maximum(0.0, 9.0 - 12.0 * np.sin(time_s / 9.0))  # stands for a while, brakes with less than 1.4 m/s^2
    speed = np.asarray([9.0, 6.1, 12.4])
    states = drive(
        MODELS[name](), speed, np.asarray([14.0, 33.0, 80.0]), np.full(3, 24.0), np.stack([wave] * 3, axis=1)
    )
    assert (np.asarray(states.gap_m) > 0.0).all()
    assert (np.asarray(states.gap_m[-300:]) < 120.0).all()


@every_model
def test_every_parameter_has_a_finite_gradient_at_a_standstill_and_on_a_free_road(name: str) -> None:
    def sum_of_speeds(model: CarFollowingModel) -> jnp.ndarray:
        start = ReplayStart(
            speed_mps=jnp.asarray([0.0, 0.0, 20.0, 20.0]),
            acceleration_mps2=jnp.zeros(4),
            gap_m=jnp.asarray([jnp.inf, 1.2, 70.0, jnp.inf]),
            leader_acceleration_mps2=jnp.zeros(4),
            desired_speed_mps=jnp.asarray([14.0, 25.0, 25.0, 20.0]),
        )
        _, states = replay(model, start, jnp.zeros((150, 4)), jnp.full(4, 0.3), STEP_S)
        return jnp.sum(states.speed_mps)

    gradient = jax.jit(jax.grad(sum_of_speeds))(MODELS[name]())
    assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(gradient))
    assert any(abs(float(leaf)) > 1e-3 for leaf in jax.tree.leaves(gradient))
