"""What leader-follower pairs say of drivers: their attributes, beside what dawdling takes away, and what they want."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxcalib.field.field_log import DriveLog
from jaxcalib.initial_values.dawdling import dawdling_mps2, fit_beside_dawdling
from jaxcalib.initial_values.desired_speeds import DesiredSpeeds, desired_speeds
from jaxcalib.initial_values.following_fit import SCALES_MPS2, FollowingFit, fit_following, loss_of_pairs
from jaxcalib.initial_values.following_loss import ModelOf, following_data
from jaxcalib.initial_values.following_samples import FollowingSamples, following_samples
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import vehicle_class, with_attribute
from surrogate.vehicle.car_following_model import CarFollowingModel

MOST_SAMPLES = 100_000
FEWEST_FOLLOWED_S = 200.0
NOISE_MPS2 = 2.0 * SCALES_MPS2[-1]  # of the mean acceleration between two moments, within which a model explains them
LONGEST_SPAN_S = 4.0
LEAST_EXPLAINED_SHARE = 0.25  # below it the model does not describe these drivers, and its fit says nothing
LEAST_OF_MEANS = 0.5  # the same of accelerations averaged over several steps, from which most noise is gone
AT_BOUND = 0.005  # of the range
MOST_AT_BOUNDS = 0.5  # of what is fitted: with more the model mimics drivers whom it does not describe


@dataclass(frozen=True)
class FittedPairs:
    """What the pairs say."""

    num_samples: int = 0  # moments of car-following found
    num_steps: int = 1  # steps over which their accelerations were averaged
    following: FollowingFit | None = None  # the fit; None where there was too little to fit
    is_dawdling: bool = False  # whether sigma follows from how speeds tremble, or accelerations were averaged
    # of values of the attributes, see `loss_of_pairs`; None where the model does not describe the pairs
    replay_loss: Callable[[Array], Array] | None = None
    desired_speeds: DesiredSpeeds | None = None  # None as well where too few drivers show theirs


NO_PAIRS = FittedPairs()


def fit_pairs(
    scenario: Scenario,
    vtype: str,
    names: Sequence[str],
    bounds: tuple[np.ndarray, np.ndarray],
    drives: Sequence[DriveLog],
    length_m: float,
    step_s: float,
    seed: int,
) -> FittedPairs:
    """Fit attributes of a vType to the pairs in logs.

    Args:
        scenario: for the model, what the vType has already, and the speed limits.
        vtype: the vType.
        names: attributes of car-following.
        bounds: least and greatest value of each.
        drives: the logs.
        length_m: of every vehicle.
        step_s: length of a simulation step.
        seed: of random starts.
    """
    model, numbers = scenario.model_of(vtype), scenario.values_of(vtype)
    base, (lower, upper) = vehicle_class(numbers, model), bounds
    num_steps = steps_between_moments(numbers, step_s)
    found = following_samples(drives, length_m, step_s, num_steps)
    if len(found) * step_s < FEWEST_FOLLOWED_S:
        return FittedPairs(len(found), num_steps)
    samples = found.thin(MOST_SAMPLES // num_steps)
    limit_mps = limits_at(scenario, samples)
    start = np.clip(np.asarray([numbers[name] for name in names]), lower, upper)

    def model_of(theta: Array) -> CarFollowingModel:
        one = base
        for index, name in enumerate(names):
            one = with_attribute(one, model, name, theta[index])
        return one.car_following

    def fit(some_model: ModelOf, some: list[int]) -> FollowingFit:
        return fit_following(samples, limit_mps, some_model, start[some], lower[some], upper[some], seed)

    following = fit(model_of, list(range(len(names))))
    dawdled_mps2: float | None = None
    if "sigma" in names and numbers["sigma"] > 0.0:
        single = found if num_steps == 1 else following_samples(drives, length_m, step_s, 1)
        single = single.select(np.isin(single.vehicle, samples.vehicle))
        dawdled_mps2 = dawdling_mps2(
            single,
            following_data(single, limits_at(scenario, single)),
            model_of(jnp.asarray(np.where(np.asarray(names) == "sigma", 0.0, following.values))),
            following.speed_factor[np.isin(np.unique(samples.vehicle), single.vehicle)],
        )
        if dawdled_mps2 is not None:
            following = fit_beside_dawdling(fit, model_of, names, dawdled_mps2, numbers["accel"])
    is_dawdling = num_steps > 1 or dawdled_mps2 is not None
    if not is_believed(following, lower, upper, num_steps):
        return FittedPairs(len(found), num_steps, following, is_dawdling)
    return FittedPairs(
        num_samples=len(found),
        num_steps=num_steps,
        following=following,
        is_dawdling=is_dawdling,
        replay_loss=loss_of_pairs(samples, limit_mps, model_of, following),
        desired_speeds=desired_speeds(following, samples, limit_mps, seed),
    )


def is_believed(following: FollowingFit, lower: np.ndarray, upper: np.ndarray, num_steps: int) -> bool:
    """Whether the model describes the pairs: it explains them, and not by values at the bounds of what drivers have.

    Args:
        following: the fit.
        lower: bounds of what was fitted.
        upper: the same.
        num_steps: steps over which accelerations were averaged.
    """
    margin = AT_BOUND * (upper - lower)
    # 0 is an ordinary value of what begins there
    is_at_bound = (following.values > upper - margin) | ((following.values < lower + margin) & (lower > 0.0))
    least_share = LEAST_EXPLAINED_SHARE if num_steps == 1 else LEAST_OF_MEANS
    return bool(following.explained_share >= least_share and np.mean(is_at_bound) < MOST_AT_BOUNDS)


def steps_between_moments(numbers: Mapping[str, float], step_s: float) -> int:
    """Steps over which accelerations are averaged, so that a driver's random part leaves his rules to be seen.

    Args:
        numbers: the vType's attributes as the scenario has them.
        step_s: length of a step.

    Source: Krauss' dawdling takes a uniform share of up to sigma times accel off each step's acceleration.
    """
    noise_mps2 = numbers.get("sigma", 0.0) * numbers.get("accel", 0.0) / np.sqrt(12.0)
    wanted = int(np.ceil((noise_mps2 / NOISE_MPS2) ** 2))
    return int(np.clip(wanted, 1, max(1, round(LONGEST_SPAN_S / step_s))))


def limits_at(scenario: Scenario, samples: FollowingSamples) -> np.ndarray:
    """Return the speed limit where each sample's follower was."""
    network = scenario.network
    starts = np.asarray([network.edge_start_m(edge) for edge in network.main_edges])
    edge = np.clip(np.searchsorted(starts, samples.position_m, side="right") - 1, 0, len(starts) - 1)
    limits = np.full((len(starts), scenario.row_map.num_rows), np.nan)
    for index, name in enumerate(network.main_edges):
        for lane in network.edge_lanes(name):
            limits[index, scenario.row_map.row_of_lane[lane.key]] = lane.speed_limit_mps
        limits[index] = np.where(np.isnan(limits[index]), np.nanmax(limits[index]), limits[index])
    return limits[edge, samples.row]
