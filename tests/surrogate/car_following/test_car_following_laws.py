"""Laws that every car-following model obeys on the road, and what only some of them promise."""

import functools
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.registry import CAR_FOLLOWING_MODELS
from surrogate.car_following.replay import ReplayStart, ReplayState, replay
from surrogate.vehicle.car_following_model import CarFollowingModel, FollowingSituation
from surrogate.vehicle.model_entry import ModelEntry

STEP_S = 0.1
ROUNDING = 1e-4


def off_usual(entry: ModelEntry) -> CarFollowingModel:
    """Return a model of the registry whose parameters are not the usual ones, to one side or the other."""
    values = {}
    for place, one in enumerate(entry.parameters):
        up = place % 2 == 1
        values[one.name] = one.usual + (0.03 * (one.upper - one.usual) if up else -0.04 * (one.usual - one.lower))
    return entry.build(values)


MODELS: Mapping[str, Callable[[], CarFollowingModel]] = {
    entry.name: functools.partial(off_usual, entry) for entry in CAR_FOLLOWING_MODELS
}
# Not every model promises all laws. Both W99 judge by thresholds, at which the acceleration jumps: with more gap a
# driver may pass from keeping his speed to closing in, and SUMO's wants CC8 + CC9 v + random, of which SUMO grants
# CC8. GHR brakes less hard the larger the gap, but speeds up less as well, and creeps up to who stands. FVD forgets a
# slower leader beyond its interaction gap. AOVRV jumps where the leader's speed passes its own, and its gains know no
# braking distance. ACC's heuristic looks at where the leader's speed will end. Krauss' emergency rule brakes harder
# for what is a little further away than usual braking reaches.
MONOTONOUS_IN_GAP = ("idm", "iidm", "gipps", "aovrv")
MONOTONOUS_IN_LEADER_SPEED = ("idm", "iidm", "krauss", "gipps", "fvd", "ghr")
STOPS_IN_TIME = tuple(name for name in MODELS if name != "ghr")
NEVER_OVERLAPS = tuple(name for name in MODELS if name != "aovrv")
BOUNDED = tuple(name for name in MODELS if not name.startswith("w99") and name not in ("gipps", "ghr"))
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


@pytest.mark.parametrize("name", BOUNDED)
def test_what_the_driver_wants_never_exceeds_the_model_s_maximum(name: str) -> None:
    model = MODELS[name]()
    wanted = model.acceleration(following(random_situations(2, 4000)), STEP_S)
    assert np.isfinite(np.asarray(wanted)).all()
    assert float(wanted.max()) <= float(model.max_acceleration_mps2) + ROUNDING
    assert float(wanted.max()) > 0.5


@every_model
def test_what_the_driver_wants_is_finite_in_any_situation(name: str) -> None:
    assert np.isfinite(np.asarray(MODELS[name]().acceleration(following(random_situations(5, 4000)), STEP_S))).all()


@pytest.mark.parametrize("name", MONOTONOUS_IN_GAP)
def test_more_gap_never_makes_a_driver_slower(name: str) -> None:
    situations = random_situations(3, 60)
    gaps = np.append(np.linspace(0.4, 250.0, 400), np.inf)
    with jax.enable_x64():
        by_gap = following({k: v[:, None] for k, v in situations.items()} | {"gap_m": gaps[None]})
        wanted = np.asarray(MODELS[name]().acceleration(by_gap, STEP_S))
    assert (np.diff(wanted, axis=1) >= -1e-9).all()
    assert (wanted[:, -1] > wanted[:, 0] + 0.5).mean() > 0.3  # others are held by their acceleration or desired speed


@pytest.mark.parametrize("name", MONOTONOUS_IN_LEADER_SPEED)
def test_a_faster_leader_never_makes_a_driver_slower(name: str) -> None:
    situations = random_situations(3, 60)
    speeds = np.linspace(0.0, 34.0, 200)
    with jax.enable_x64():
        by_leader = following({k: v[:, None] for k, v in situations.items()} | {"leader_speed_mps": speeds[None]})
        wanted = np.asarray(MODELS[name]().acceleration(by_leader, STEP_S))
    assert (np.diff(wanted, axis=1) >= -1e-9).all()
    assert (wanted[:, -1] > wanted[:, 0] + 0.5).mean() > 0.3


@pytest.mark.parametrize("name", STOPS_IN_TIME)
def test_a_vehicle_that_comes_upon_a_standing_obstacle_stops_before_it(name: str) -> None:
    gap = np.asarray([58.0, 71.5, 96.0, 133.0, 187.5, 260.0, 341.0])
    states = drive(MODELS[name](), np.full(7, 20.0), gap, np.full(7, 26.0), np.zeros((1200, 7)))
    assert (np.asarray(states.gap_m) >= 0.0).all()
    assert (np.asarray(states.speed_mps[-1]) < 0.05).all()
    assert (np.asarray(states.gap_m[-1]) < 10.0).all()


@pytest.mark.parametrize("name", NEVER_OVERLAPS)
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


def entering(gap: np.ndarray, wanted: float = 27.0, leader: float = 19.0) -> FollowingSituation:
    """Return what vehicles see that would be put on the road with one speed at several gaps."""

    def filled(value: float) -> jnp.ndarray:
        return jnp.full(gap.shape, value, jnp.float32)

    return FollowingSituation(
        filled(wanted),
        jnp.asarray(gap, jnp.float32),
        filled(leader),
        filled(0.0),
        filled(0.0),
        filled(31.0),
        filled(0.5),
    )


@every_model
def test_with_room_a_vehicle_enters_as_fast_as_it_wants_and_never_faster(name: str) -> None:
    gap = np.linspace(0.5, 400.0, 150)
    speed = np.asarray(MODELS[name]().insertion_speed_mps(entering(gap), jnp.asarray(4.3), STEP_S))
    assert speed[-1] == 27.0
    assert (speed >= 0.0).all()
    assert (speed <= 27.0).all()
    assert (np.diff(speed) >= -ROUNDING).all()
    assert speed[0] < 27.0


@pytest.mark.parametrize("name", [name for name in MODELS if name not in ("idm", "iidm", "acc")])
def test_a_vehicle_enters_with_a_secure_gap(name: str) -> None:
    model, gap = MODELS[name](), np.linspace(0.5, 400.0, 150)
    speed = model.insertion_speed_mps(entering(gap), jnp.asarray(4.3), STEP_S)
    needed = np.asarray(model.secure_gap_m(speed, jnp.full(gap.shape, 19.0), jnp.asarray(4.3), STEP_S))
    fits = gap >= float(model.jam_gap_m)
    assert (needed[fits] <= gap[fits] - float(model.jam_gap_m) + ROUNDING).all()
    faster = np.asarray(
        model.secure_gap_m(speed + 0.1, jnp.full(gap.shape, 19.0), jnp.asarray(4.3), STEP_S)
    )  # a little faster, and the gap would not do
    below = fits & (np.asarray(speed) < 26.9)
    assert below.any()
    assert (faster[below] > gap[below] - float(model.jam_gap_m) - ROUNDING).all()


@pytest.mark.parametrize("name", ["idm", "iidm", "acc"])
def test_an_idm_driver_brakes_one_step_where_his_gap_is_too_small_to_enter(name: str) -> None:
    """Source: `MSCFModel_IDM::insertionFollowSpeed`."""
    model, gap = MODELS[name](), np.linspace(20.0, 400.0, 150)
    speed = np.asarray(model.insertion_speed_mps(entering(gap), jnp.asarray(4.3), STEP_S))
    needed = float(model.secure_gap_m(jnp.asarray(27.0), jnp.asarray(19.0), jnp.asarray(4.3), STEP_S))
    fits = needed <= gap - float(model.jam_gap_m)
    assert fits.any()
    assert (~fits).any()
    assert (speed[fits] == 27.0).all()
    one_step = 27.0 + STEP_S * np.asarray(model.acceleration(entering(gap), STEP_S))
    np.testing.assert_allclose(speed[~fits], np.clip(one_step, 0.0, 27.0)[~fits], rtol=1e-5)
