"""Driver parameters that the logs show before any traffic is simulated, each with its error."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxcalib.field.field_log import DriveLog
from jaxcalib.initial_values.accepted_gaps import accepted_gaps, assertiveness
from jaxcalib.initial_values.dawdling import dawdling_mps2, fit_beside_dawdling
from jaxcalib.initial_values.desired_speeds import DesiredSpeeds, desired_speeds
from jaxcalib.initial_values.following_fit import SCALES_MPS2, FollowingFit, fit_following, loss_of_pairs
from jaxcalib.initial_values.following_loss import ModelOf, following_data
from jaxcalib.initial_values.following_samples import FollowingSamples, following_samples
from jaxcalib.problem.parameter_space import ParameterSpace
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import following_attributes, vehicle_class, with_attribute
from surrogate.vehicle.car_following_model import CarFollowingModel

MOST_SAMPLES = 100_000
FEWEST_FOLLOWED_S = 200.0
NOISE_MPS2 = 2.0 * SCALES_MPS2[-1]  # of the mean acceleration between two moments, within which a model explains them
LONGEST_SPAN_S = 4.0
LEAST_EXPLAINED_SHARE = 0.25  # below it the model does not describe these drivers, and its fit says nothing
LEAST_OF_MEANS = 0.5  # the same of accelerations averaged over several steps, from which most noise is gone
AT_BOUND = 0.005  # of the range
MOST_AT_BOUNDS = 0.5  # of what is fitted: with more the model mimics drivers whom it does not describe
LEAST_ERROR = 0.002  # of the unit range
UNEXPLAINED_ERROR = 0.02  # of the unit range, where as many moments stay unexplained as are explained
SPEED_FACTOR_ERROR = 0.02  # drivers as fast as the subject vehicle are met less often than others
SPEED_DEVIATION_ERROR = 0.01
DAWDLING_SPEED_FACTOR_ERROR = 0.06  # of drivers who dawdle: 0.03 too low and 0.10 too high on two public roads
DAWDLING_ERROR = 0.05  # of the unit range, of accel and sigma


@dataclass(frozen=True)
class DriverEstimate:
    """What the logs say of each driver parameter."""

    # estimates, in the order of the layout's driver parameters; the scenario's values where the logs are silent
    values: np.ndarray
    unit_error: np.ndarray  # standard errors in the unit cube; inf where the logs are silent
    source: tuple[str, ...]  # where each comes from, for the report
    following: FollowingFit | None  # the fit of car-following; None where there was too little to fit
    num_samples: int  # moments of car-following found
    fitted: tuple[str, ...] = ()  # names of the parameters that the pairs were fitted with
    # mean loss of the pairs for values of these parameters, drivers' desired speeds held; differentiable; None
    # where there was too little to fit, or where the model does not describe the pairs
    replay_loss: Callable[[Array], Array] | None = None


def estimate_drivers(
    scenario: Scenario,
    space: ParameterSpace,
    drives: Sequence[DriveLog],
    scenario_values: np.ndarray,
    step_s: float,
    seed: int,
) -> DriverEstimate:
    """Estimate the driver parameters of one group of vTypes from logs.

    Gaps are what the simulation's vehicles leave of the spacing in the logs: `minGap` has to make up for their length.

    Args:
        scenario: for the model and the speed limits.
        space: inputs, and driver parameters of that group.
        drives: logs that the calibration may use.
        scenario_values: the scenario's driver parameters.
        step_s: length of a simulation step.
        seed: of random starts.
    """
    attributes, num_inputs = space.layout.attributes, space.layout.num_inputs
    length_m = usual_length_m(scenario)
    values = np.array(scenario_values, float)
    unit_error = np.full(len(attributes), np.inf)
    source = ["scenario"] * len(attributes)
    vtype = space.layout.vtype_groups[0][0]
    model, numbers = scenario.model_of(vtype), scenario.values_of(vtype)
    base = vehicle_class(numbers, model)

    def note(name: str, value: float, error: float, origin: str) -> None:
        index = attributes.index(name)
        one = space.ranges[num_inputs + index]
        if np.isfinite(value) and np.isfinite(error):
            values[index] = np.clip(value, one.lower, one.upper)
            unit_error[index] = max(error, LEAST_ERROR)
            source[index] = origin

    following, num_samples, replay_loss = None, 0, None
    num_steps = steps_between_moments(numbers, step_s)
    fitted = [name for name in following_attributes(model) if name in attributes]
    chosen = np.asarray([num_inputs + attributes.index(name) for name in fitted], int)
    dawdled_mps2: float | None = None
    wanted: DesiredSpeeds | None = None
    if fitted:
        samples = following_samples(drives, length_m, step_s, num_steps)
        num_samples = len(samples)

        def model_of(theta: Array) -> CarFollowingModel:
            one = base
            for index, name in enumerate(fitted):
                one = with_attribute(one, model, name, theta[index])
            return one.car_following

        if num_samples * step_s >= FEWEST_FOLLOWED_S:
            samples = samples.thin(MOST_SAMPLES // num_steps)
            lower, upper = space.lower[chosen], space.upper[chosen]
            start = np.clip(np.asarray([numbers[name] for name in fitted]), lower, upper)
            limit = limits_at(scenario, samples)

            def fit(model: ModelOf, names: list[int]) -> FollowingFit:
                return fit_following(samples, limit, model, start[names], lower[names], upper[names], seed)

            following = fit(model_of, list(range(len(fitted))))
            if "sigma" in fitted and numbers["sigma"] > 0.0:
                single = following_samples(drives, length_m, step_s, 1)
                single = single.select(np.isin(single.vehicle, samples.vehicle))
                calm = np.where(np.asarray(fitted) == "sigma", 0.0, following.values)
                dawdled_mps2 = dawdling_mps2(
                    single,
                    following_data(single, limits_at(scenario, single)),
                    model_of(jnp.asarray(calm)),
                    following.speed_factor[np.isin(np.unique(samples.vehicle), single.vehicle)],
                )
                if dawdled_mps2 is not None:
                    following = fit_beside_dawdling(fit, model_of, fitted, dawdled_mps2, numbers["accel"])
            if is_believed(following, lower, upper, num_steps):
                replay_loss = loss_of_pairs(samples, limit, model_of, following)
                wanted = desired_speeds(following, samples, limit, seed)
    if following is not None and replay_loss is not None:
        found = np.concatenate([space.lower[:num_inputs], values])
        found[chosen] = np.clip(following.values, space.lower[chosen], space.upper[chosen])
        slope = space.slope_of(found)[chosen]
        for index, name in enumerate(fitted):
            error = following.error[index] / abs(slope[index]) + _model_error(following.explained_share)
            if (num_steps > 1 or dawdled_mps2 is not None) and name in ("accel", "sigma"):
                error = np.hypot(error, DAWDLING_ERROR)
            note(name, following.values[index], error, "leader-follower pairs")
        if wanted is not None:
            least = DAWDLING_SPEED_FACTOR_ERROR if num_steps > 1 else SPEED_FACTOR_ERROR
            for name, value, error in (
                ("speedFactor", wanted.mean, np.hypot(least, wanted.mean_error)),
                ("speedDev", wanted.deviation, np.hypot(SPEED_DEVIATION_ERROR, wanted.deviation_error)),
            ):
                if name in attributes:
                    one = space.ranges[num_inputs + attributes.index(name)]
                    note(name, value, float(error) / (one.upper - one.lower), "desired speeds in leader-follower pairs")
    if "lcAssertive" in attributes:
        fitted_model = base
        for index, name in enumerate(attributes):
            fitted_model = with_attribute(fitted_model, model, name, float(values[index]))
        assertive = assertiveness(accepted_gaps(drives, length_m, step_s), fitted_model.car_following, step_s)
        one = space.ranges[num_inputs + attributes.index("lcAssertive")]
        error = assertive.logarithmic_error / np.log(one.upper / one.lower)
        note("lcAssertive", assertive.value, float(error), "accepted gaps")
    return DriverEstimate(values, unit_error, tuple(source), following, num_samples, tuple(fitted), replay_loss)


def usual_length_m(scenario: Scenario) -> float:
    """Return the length that half of the simulated vehicles do not exceed."""
    flows = sorted(scenario.flows, key=lambda flow: scenario.values_of(flow.vtype)["length"])
    number = np.cumsum([flow.rate_vehps * (min(flow.end_s, scenario.end_s) - flow.begin_s) for flow in flows])
    return scenario.values_of(flows[int(np.searchsorted(number, 0.5 * number[-1]))].vtype)["length"]


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


def _model_error(explained_share: float) -> float:
    """Return how far a fit may be off because not all moments obey the model, in the unit range."""
    return LEAST_ERROR + UNEXPLAINED_ERROR * (1.0 / explained_share - 1.0)


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
