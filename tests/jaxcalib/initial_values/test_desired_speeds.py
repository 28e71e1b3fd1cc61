"""Who is held back shows only that he wants no less than he drives; the distribution of all is found nevertheless."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxcalib.initial_values.desired_speeds import DesiredSpeeds, desired_speeds
from jaxcalib.initial_values.following_fit import FollowingFit
from jaxcalib.initial_values.following_loss import following_data, least_rise
from jaxcalib.initial_values.following_samples import FollowingSamples
from surrogate.car_following.krauss import Krauss
from surrogate.car_following.replay import ReplayStart, replay

LIMIT_MPS, STEP_S = 31.0, 0.5
MEAN, DEVIATION = 0.93, 0.11


def samples(vehicle: np.ndarray, driven: np.ndarray) -> FollowingSamples:
    """Two moments of each vehicle, of which one is at the most that it drives."""
    number = np.repeat(vehicle, 2)
    speed_mps = np.stack([0.4 * driven, driven], axis=1).ravel() * LIMIT_MPS
    nothing = np.zeros(len(number))
    return FollowingSamples(
        vehicle=number, drive=nothing.astype(int), row=nothing.astype(int), position_m=nothing, speed_mps=speed_mps,
        acceleration_mps2=nothing, gap_m=nothing + 20.0, leader_speed_mps=speed_mps[:, None],
        leader_acceleration_mps2=nothing, later_speed_mps=0.9 * speed_mps, step_s=STEP_S,
    )  # fmt: skip


def estimated(wanted: np.ndarray, leaders: np.ndarray) -> tuple[DesiredSpeeds | None, np.ndarray]:
    """What is found of drivers who drive what they want or what their leaders do, and who of them shows it."""
    shows = wanted < leaders
    driven, some = np.minimum(wanted, leaders), np.ones(len(wanted))
    fit = FollowingFit(
        values=some, error=some, speed_factor=np.where(shows, wanted, leaders + 0.01),
        speed_factor_error=np.where(shows, 0.002, 0.004), speed_factor_rise=np.where(shows, 9.0, 0.1),
        explained_share=0.9, loss=0.1,
    )  # fmt: skip
    given = samples(3 * np.arange(len(wanted)) + 4, driven)
    return desired_speeds(fit, given, np.full(len(given), LIMIT_MPS), seed=2), shows


@pytest.mark.parametrize("of_leaders", [0.8, 0.95, 1.3])
def test_however_many_are_held_back_all_drivers_are_found(of_leaders: float) -> None:
    random = np.random.default_rng(11)
    wanted = random.normal(MEAN, DEVIATION, 250)
    found, shows = estimated(wanted, random.normal(of_leaders, 0.1, 250))
    assert found is not None
    assert abs(found.mean - MEAN) < 3.0 * found.mean_error < 0.08
    assert abs(found.deviation - DEVIATION) < 3.0 * found.deviation_error < 0.08
    if of_leaders < 1.0:  # those who show what they want are those who want little
        assert np.median(wanted[shows]) < MEAN - 4.0 * found.mean_error


@pytest.mark.long
def test_errors_are_those_of_repetitions() -> None:
    random = np.random.default_rng(5)
    found = [estimated(random.normal(MEAN, DEVIATION, 80), random.normal(0.95, 0.1, 80))[0] for _ in range(16)]
    means = [one.mean for one in found if one is not None]
    told = np.mean([one.mean_error for one in found if one is not None])
    assert np.std(means) == pytest.approx(told, rel=0.5)


def test_where_hardly_anybody_shows_what_he_wants_nothing_is_said() -> None:
    wanted = np.linspace(0.8, 1.1, 60)
    assert estimated(wanted, np.where(np.arange(60) < 9, 2.0, 0.5))[0] is None
    assert estimated(np.full(60, 0.9), np.full(60, 2.0))[0] is None


def test_the_loss_rises_for_those_alone_who_drive_what_they_want() -> None:
    values = (2.3, 1.1, 2.1, 3.7, 9.0, 0.0)
    model = Krauss(*(jnp.asarray(value, jnp.float32) for value in values))
    factor = np.asarray([0.7, 0.75, 0.9, 1.05])
    num_steps = 60
    leader = np.full((num_steps, 4), 0.8 * LIMIT_MPS) + 0.8 * np.sin(np.arange(num_steps) / 4.0)[:, None]
    state = jnp.asarray(np.minimum(factor * LIMIT_MPS, 0.8 * LIMIT_MPS), jnp.float32)
    start = ReplayStart(state, jnp.zeros(4), state * 1.1 + 2.3, jnp.zeros(4), jnp.asarray(factor * LIMIT_MPS))
    _, states = replay(model, start, jnp.asarray(leader, jnp.float32), jnp.zeros(4), STEP_S)
    speed, gap = (np.asarray(one, float) for one in (states.speed_mps, states.gap_m))
    at, who = (part.ravel() for part in np.mgrid[5 : num_steps - 1, :4])
    given = FollowingSamples(
        vehicle=who, drive=np.zeros(len(at), int), row=np.zeros(len(at), int), position_m=np.zeros(len(at)),
        speed_mps=speed[at - 1, who], acceleration_mps2=np.zeros(len(at)), gap_m=gap[at - 1, who],
        leader_speed_mps=leader[at, who][:, None], leader_acceleration_mps2=np.zeros(len(at)),
        later_speed_mps=speed[at, who], step_s=STEP_S,
    )  # fmt: skip
    data = following_data(given, np.full(len(given), LIMIT_MPS))
    rise = np.asarray(least_rise(model, jnp.asarray(np.minimum(factor, 0.85), jnp.float32), data, 0.05))
    assert (rise[:2] > 10.0).all()
    assert (rise[2:] < 0.5).all()
