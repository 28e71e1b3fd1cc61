"""Driver parameters that the logs show before any traffic is simulated, each with its error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Array

from jaxcalib.field.field_log import DriveLog
from jaxcalib.initial_values.accepted_gaps import accepted_gaps, assertiveness
from jaxcalib.initial_values.fitted_pairs import NO_PAIRS, fit_pairs
from jaxcalib.initial_values.following_fit import FollowingFit
from jaxcalib.problem.parameter_space import ParameterSpace
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import following_attributes, vehicle_class, with_attribute

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

    fitted = [name for name in following_attributes(model) if name in attributes]
    chosen = np.asarray([num_inputs + attributes.index(name) for name in fitted], int)
    bounds = space.lower[chosen], space.upper[chosen]
    pairs = fit_pairs(scenario, vtype, fitted, bounds, drives, length_m, step_s, seed) if fitted else NO_PAIRS
    following = pairs.following
    if following is not None and pairs.replay_loss is not None:
        found = np.concatenate([space.lower[:num_inputs], values])
        found[chosen] = np.clip(following.values, space.lower[chosen], space.upper[chosen])
        slope = space.slope_of(found)[chosen]
        for index, name in enumerate(fitted):
            error = following.error[index] / abs(slope[index]) + _model_error(following.explained_share)
            if pairs.is_dawdling and name in ("accel", "sigma"):
                error = np.hypot(error, DAWDLING_ERROR)
            note(name, following.values[index], error, "leader-follower pairs")
        if (wanted := pairs.desired_speeds) is not None:
            least = DAWDLING_SPEED_FACTOR_ERROR if pairs.num_steps > 1 else SPEED_FACTOR_ERROR
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
    return DriverEstimate(
        values, unit_error, tuple(source), following, pairs.num_samples, tuple(fitted), pairs.replay_loss
    )


def usual_length_m(scenario: Scenario) -> float:
    """Return the length that half of the simulated vehicles do not exceed."""
    flows = sorted(scenario.flows, key=lambda flow: scenario.values_of(flow.vtype)["length"])
    number = np.cumsum([flow.rate_vehps * (min(flow.end_s, scenario.end_s) - flow.begin_s) for flow in flows])
    return scenario.values_of(flows[int(np.searchsorted(number, 0.5 * number[-1]))].vtype)["length"]


def _model_error(explained_share: float) -> float:
    """Return how far a fit may be off because not all moments obey the model, in the unit range."""
    return LEAST_ERROR + UNEXPLAINED_ERROR * (1.0 / explained_share - 1.0)
