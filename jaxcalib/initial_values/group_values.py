"""Driver parameters of several groups of vTypes, fitted together: logs do not say who is of which vType."""

from dataclasses import replace

import numpy as np

from jaxcalib.initial_values.driver_values import DriverEstimate
from jaxcalib.problem.parameter_space import ParameterSpace
from sim_adapters.scenario.scenario import Scenario

# Of the unit range: how far the drivers of another group may be from the scenario's by another factor than those of the
# first. Half of what the scenario's own values are trusted with where the logs say nothing at all.
OTHER_GROUP_ERROR = 0.125


def drivers_of_all_groups(
    first: DriverEstimate, scenario: Scenario, space: ParameterSpace, scenario_values: np.ndarray
) -> DriverEstimate:
    """Return the estimate of all groups' parameters from that of the first group's.

    The vehicles of all groups are fitted as if they were the first's. What that says is a factor on the scenario's
    value, and every other group gets the same factor on its own, less certain. The others among those who were fitted
    bend the first group's values, too: by as much as they may differ, times their share.

    Args:
        first: what all vehicles show by the first group's model and values.
        scenario: for the share of the other groups' vehicles.
        space: all parameters.
        scenario_values: the scenario's driver parameters, of all groups.
    """
    groups, number = space.layout.vtype_groups, len(space.layout.attributes)
    if len(groups) == 1:
        return first
    begin, share = space.layout.num_inputs, _share_of_others(scenario, groups)
    values, source = np.array(scenario_values, float), ["scenario"] * len(scenario_values)
    values[:number], source[:number] = first.values, first.source
    error = np.full(len(values), np.inf)
    error[:number] = np.hypot(first.unit_error, share * OTHER_GROUP_ERROR)
    lower, upper = space.lower[begin:], space.upper[begin:]
    for own in range(number, len(values)):
        of_first = own % number
        if not (np.isfinite(first.unit_error[of_first]) and scenario_values[of_first] and scenario_values[own]):
            continue
        factor = first.values[of_first] / scenario_values[of_first]
        values[own] = np.clip(factor * scenario_values[own], lower[own], upper[own])
        source[own] = f"{first.source[of_first]}, by the factor of {groups[0][0]}"
    slope = space.slope_of(np.concatenate([space.lower[:begin], values]))[begin:]
    for own in range(number, len(values)):
        of_first = own % number
        if source[own] != "scenario":
            stretch = abs(slope[of_first] / slope[own] * scenario_values[own] / scenario_values[of_first])
            error[own] = np.hypot(stretch * first.unit_error[of_first], OTHER_GROUP_ERROR)
    return replace(
        first,
        values=values,
        unit_error=error,
        source=tuple(source),
        fitted=tuple(space.layout.names_of(name)[0] for name in first.fitted),
        replay_loss=None,  # of pairs of all groups together, which is a function of no group's values alone
    )


def _share_of_others(scenario: Scenario, groups: tuple[tuple[str, ...], ...]) -> float:
    """Return the share of vehicles that are of other groups than the first."""
    vehicles: dict[str, float] = {}
    for flow in scenario.flows:
        number = flow.rate_vehps * max(flow.end_s - flow.begin_s, 0.0)
        vehicles[flow.vtype] = vehicles.get(flow.vtype, 0.0) + number
    others = sum(vehicles.get(vtype, 0.0) for group in groups[1:] for vtype in group)
    return others / max(sum(vehicles.values()), 1e-12)
