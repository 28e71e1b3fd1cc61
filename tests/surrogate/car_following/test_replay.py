"""Replays of IDM followers against a loop in double precision, and their gradients against differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from surrogate.car_following.idm import Idm
from surrogate.car_following.replay import ReplayStart, ReplayState, replay

STEP_S = 0.1
NUM_STEPS = 260
# s0, T, a, b, delta
PARAMETERS = np.asarray([2.2, 1.35, 1.4, 2.1, 3.7])
EMERGENCY_MPS2 = 7.9
SPEED = np.asarray([13.1, 8.4, 17.0])
GAP = np.asarray([24.0, 41.0, 66.0])
DESIRED = np.asarray([21.0, 24.5, 28.0])


def leader_speeds() -> np.ndarray:
    time_s = STEP_S * np.arange(NUM_STEPS)[:, None]
    return np.asarray([13.0, 9.5, 16.0]) + np.asarray([2.6, 1.9, 3.2]) * np.sin(
        time_s / np.asarray([3.1, 4.7, 2.3]) + np.asarray([0.4, 2.0, -1.1])
    )


def replayed(parameters: jax.Array, leaders: jax.Array) -> ReplayState:
    def like(values: np.ndarray | float) -> jax.Array:
        return jnp.asarray(values, parameters.dtype)

    s0, t, a, b, delta = parameters
    model = Idm(s0, t, a, b, like(EMERGENCY_MPS2), delta)
    before, leaders_before = like(np.asarray([0.3, -0.5, 0.1])), like(np.asarray([0.2, 0.0, -0.7]))
    start = ReplayStart(like(SPEED), before, like(GAP), leaders_before, like(DESIRED))
    return replay(model, start, leaders, like(np.full(3, 0.4)), STEP_S)[1]


def looped(leaders: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds and gaps after every step, one follower and one step after the other."""
    s0, t, a, b, delta = PARAMETERS
    speeds, gaps = np.zeros_like(leaders), np.zeros_like(leaders)
    for follower in range(leaders.shape[1]):
        v, leader_m, own_m = SPEED[follower], GAP[follower], 0.0
        for step in range(len(leaders)):
            gap, closing = leader_m - own_m, v - leaders[step, follower]
            wanted = s0 + max(0.0, v * t + v * closing / (2.0 * np.sqrt(a * b)))
            acceleration = a * (1.0 - (v / DESIRED[follower]) ** delta - (wanted / gap) ** 2)
            acceleration = max(-EMERGENCY_MPS2, min(acceleration, a, (DESIRED[follower] - v) / STEP_S))
            v = max(0.0, v + STEP_S * acceleration)
            own_m += STEP_S * v
            leader_m += STEP_S * leaders[min(step + 1, len(leaders) - 1), follower]
            speeds[step, follower], gaps[step, follower] = v, leader_m - own_m
    return speeds, gaps


def loss(parameters: jax.Array, leaders: jax.Array) -> jax.Array:
    """Weigh followers and steps unequally, so that nothing cancels."""
    states = replayed(parameters, leaders)
    weight = jnp.linspace(0.2, 1.7, NUM_STEPS)[:, None] * jnp.asarray([1.0, 0.6, 2.3])
    return jnp.mean(weight * ((states.gap_m - 19.0) ** 2 + 3.0 * (states.speed_mps - 11.0) ** 2))


def test_a_replay_is_the_semi_implicit_euler_loop() -> None:
    leaders = leader_speeds()
    speeds, gaps = looped(leaders)
    with jax.enable_x64():
        states = jax.device_get(replayed(jnp.asarray(PARAMETERS), jnp.asarray(leaders)))
    np.testing.assert_allclose(states.speed_mps, speeds, rtol=1e-10)
    np.testing.assert_allclose(states.gap_m, gaps, rtol=1e-10)
    change = np.diff(np.concatenate([SPEED[None], speeds]), axis=0) / STEP_S
    np.testing.assert_allclose(states.acceleration_mps2, change, atol=1e-9)


def test_a_replay_in_single_precision_stays_within_a_centimetre() -> None:
    leaders = leader_speeds()
    _, gaps = looped(leaders)
    states = jax.device_get(replayed(jnp.asarray(PARAMETERS, jnp.float32), jnp.asarray(leaders, jnp.float32)))
    assert states.gap_m.dtype == np.float32
    assert np.abs(states.gap_m - gaps).max() < 0.01


def test_behind_a_steady_leader_the_gap_settles_at_the_idm_s_equilibrium() -> None:
    steady = np.asarray([12.3, 7.9, 15.6])
    s0, t, _, _, delta = PARAMETERS
    with jax.enable_x64():
        leaders = jnp.broadcast_to(jnp.asarray(steady), (4000, 3))
        states = jax.device_get(replayed(jnp.asarray(PARAMETERS), leaders))
    np.testing.assert_allclose(states.speed_mps[-1], steady, rtol=1e-6)
    np.testing.assert_allclose(
        states.gap_m[-1], (s0 + steady * t) / np.sqrt(1.0 - (steady / DESIRED) ** delta), rtol=1e-5
    )


def test_gradients_by_the_parameters_agree_with_central_differences() -> None:
    with jax.enable_x64():
        leaders = jnp.asarray(leader_speeds())
        gradient = np.asarray(jax.jit(jax.grad(loss))(jnp.asarray(PARAMETERS), leaders))
        value = jax.jit(loss)
        differences = np.zeros(len(PARAMETERS))
        for index, parameter in enumerate(PARAMETERS):
            step = 1e-5 * parameter
            up, down = PARAMETERS.copy(), PARAMETERS.copy()
            up[index], down[index] = parameter + step, parameter - step
            differences[index] = float(value(jnp.asarray(up), leaders) - value(jnp.asarray(down), leaders)) / (2 * step)
    assert (np.abs(gradient) > 0.1).all()
    np.testing.assert_allclose(gradient, differences, rtol=1e-5)


@pytest.mark.parametrize("follower", [0, 2])
def test_one_follower_s_gap_depends_on_his_own_leader_only(follower: int) -> None:
    leaders = leader_speeds()
    changed = leaders.copy()
    changed[40:, 1] += 0.8
    first = jax.device_get(replayed(jnp.asarray(PARAMETERS, jnp.float32), jnp.asarray(leaders, jnp.float32)))
    second = jax.device_get(replayed(jnp.asarray(PARAMETERS, jnp.float32), jnp.asarray(changed, jnp.float32)))
    np.testing.assert_array_equal(first.gap_m[:, follower], second.gap_m[:, follower])
    assert np.abs(first.gap_m[-1, 1] - second.gap_m[-1, 1]) > 0.1
