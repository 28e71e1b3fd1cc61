"""Where the search begins: what the logs say of inputs and driver parameters, with its error."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.initial_values.demand_profile import DemandEstimate, SectionVolumes, estimate_demand
from jaxcalib.initial_values.driver_values import DriverEstimate, estimate_drivers
from jaxcalib.initial_values.group_values import drivers_of_all_groups
from jaxcalib.problem.parameter_space import ParameterSpace, parameter_space, round_values
from jaxcalib.problem.problem import CalibrationProblem
from jaxcalib.statistics.jackknife import jackknife
from sim_adapters.units import SECONDS_PER_HOUR

LEAST_VOLUME_ERROR = 0.03  # relative, of a section's volume: vehicles between two sections are counted in neither
ERROR_OF_ONE_DRIVE = 0.1  # relative: a single drive says nothing of its own error
KNOWN_WIDTHS = 3.0  # standard errors around what the logs say that are searched
MOST_ROUNDS = 3  # of simulated drives at the demand that the round before found
SETTLED = 0.05  # relative: a demand that changes by less was simulated near enough
LEAST_INFLOW_ERROR = 0.05  # relative: what all sections share, such as a bottleneck that holds back what wants to come


@dataclass(frozen=True)
class InitialPoint:
    """Where the search begins."""

    space: ParameterSpace  # bounds of all parameters, inputs around their initial values (Eqs. 5-6).
    scenario_values: np.ndarray  # what the scenario says: no calibration
    values: np.ndarray  # initial values
    unit_error: np.ndarray  # standard error of each in the unit cube; inf where the logs are silent
    source: tuple[str, ...]  # where each comes from
    drivers: DriverEstimate  # estimates behind the driver parameters
    demand: DemandEstimate  # estimates behind the inputs


def find_initial_point(
    problem: CalibrationProblem,
    scaling_factor: float,
    bounds: Mapping[str, tuple[float, float]],
    seed: int,
    simulated: Callable[[Float[np.ndarray, " parameter"]], Float[np.ndarray, "run tally"] | None] = lambda values: None,
) -> InitialPoint:
    """Initial point of a problem.

    Args:
        problem: the problem.
        scaling_factor: delta of Eqs. 5 and 6: how far inputs may leave their initial values, at least; the paper has a
            scenario's counts there, here it is three standard errors where a few drives say less.
        bounds: the user's bounds, by name.
        seed: of random starts.
        simulated: returns tallies of the drives to fit for values of all parameters, see `estimate_demand`: with the
            drivers that the logs show, for with the scenario's own a road may jam that does not with real ones, and
            what it then lacks would be taken for missing demand. First at the scenario's demand, then, while that
            changes, at the demand found, since volumes answer in proportion near a demand only.

    Raises:
        CaseError: bounds are wrong.
    """
    scenario_values = round_values(problem.template.base_values())
    layout, model = problem.layout, problem.model
    behaviour = scenario_values[layout.num_inputs :]

    def space_around(input_vehph: np.ndarray, share: float | np.ndarray) -> ParameterSpace:
        return parameter_space(layout, model, input_vehph, share, bounds, behaviour=behaviour.tolist())

    base_vehph = problem.template.base_demand_vehph()
    around_scenario = space_around(base_vehph, scaling_factor)  # of it, the drivers' part alone
    drivers = estimate_drivers(
        problem.scenario,
        around_scenario.of_first_group(),
        [drive for drive in problem.drives if drive.role == "fit"],
        behaviour[: len(layout.attributes)],
        problem.parts.scenario.step_s,
        seed,
    )
    drivers = drivers_of_all_groups(drivers, problem.scenario, around_scenario, behaviour)
    demand = _settled_demand(problem, drivers.values, simulated)
    inflow_error = np.hypot(demand.error_vehph, LEAST_INFLOW_ERROR * demand.values_vehph)
    reach = np.maximum(scaling_factor, KNOWN_WIDTHS * inflow_error / demand.values_vehph)
    space = space_around(np.minimum(demand.values_vehph, problem.template.most_demand_vehph), reach)
    for number, most_vehph in enumerate(problem.template.most_demand_vehph):
        bounds_vehph = space.ranges[number]
        if bounds_vehph.upper > most_vehph:
            lower_vehph = min(bounds_vehph.lower, (1.0 - float(reach[number])) * most_vehph)
            space = space.with_range(space.names[number], lower_vehph, float(most_vehph))
    values = np.clip(np.concatenate([demand.values_vehph, drivers.values]), space.lower, space.upper)
    width = (space.upper - space.lower)[: layout.num_inputs]
    return InitialPoint(
        space=space,
        scenario_values=scenario_values,
        values=round_values(values),
        unit_error=np.concatenate([inflow_error / width, drivers.unit_error]),
        source=("volume along the route",) * layout.num_inputs + drivers.source,
        drivers=drivers,
        demand=demand,
    )


def without_driver_logs(initial: InitialPoint) -> InitialPoint:
    """Return the initial point with the scenario's driver parameters, as if the logs were silent about them."""
    num_inputs = len(initial.demand.values_vehph)
    scenario = initial.scenario_values[num_inputs:]
    inside = np.clip(scenario, initial.space.lower[num_inputs:], initial.space.upper[num_inputs:])
    silent = np.full(len(scenario), np.inf)
    source = ("scenario",) * len(scenario)
    drivers = replace(initial.drivers, values=inside, unit_error=silent, source=source, replay_loss=None)
    return replace(
        initial,
        values=np.concatenate([initial.values[:num_inputs], round_values(inside)]),
        unit_error=np.concatenate([initial.unit_error[:num_inputs], silent]),
        source=(*initial.source[:num_inputs], *source),
        drivers=drivers,
    )


def _settled_demand(
    problem: CalibrationProblem,
    drivers: Float[np.ndarray, " driver_parameter"],
    simulated: Callable[[Float[np.ndarray, " parameter"]], Float[np.ndarray, "run tally"] | None],
) -> DemandEstimate:
    """Inflows that the drives to fit show, simulated near those inflows."""
    at_vehph = problem.template.base_demand_vehph()
    demand = demand_from_logs(problem, simulated(round_values(np.concatenate([at_vehph, drivers]))), at_vehph)
    for _ in range(MOST_ROUNDS - 1):
        found_vehph = np.minimum(demand.values_vehph, problem.template.most_demand_vehph)
        if np.all(np.abs(found_vehph - at_vehph) <= SETTLED * at_vehph):
            break
        tallies = simulated(round_values(np.concatenate([found_vehph, drivers])))
        if tallies is None or not len(tallies):
            break
        nearer = demand_from_logs(problem, tallies, found_vehph)
        if nearer.misfit >= demand.misfit:  # a jam lets fewer through the more there come
            return demand.half_way_from(at_vehph)
        demand, at_vehph = nearer, found_vehph
    return demand


def demand_from_logs(
    problem: CalibrationProblem,
    simulated: Float[np.ndarray, "run tally"] | None = None,
    simulated_vehph: Float[np.ndarray, " input"] | None = None,
) -> DemandEstimate:
    """Inflows that the drives to fit show.

    Args:
        problem: the problem.
        simulated: tallies of the same drives at a known demand; None where there are none.
        simulated_vehph: that demand; the scenario's unless given.
    """
    simulated_volume = None if simulated is None or not len(simulated) else section_volumes(problem, simulated)
    field_volume = section_volumes(problem, problem.field_of("fit"))
    observed_s = [
        (drive.depart_s, drive.depart_s + float(np.ptp(log.subject.time_s)))
        for drive, log in zip(problem.case.drives, problem.drives, strict=True)
        if drive.role == "fit"
    ]
    return estimate_demand(
        problem.scenario, problem.template, problem.road, field_volume, simulated_volume, observed_s, simulated_vehph
    )


def section_volumes(problem: CalibrationProblem, tallies: Float[np.ndarray, "drive tally"]) -> SectionVolumes:
    """Volume on all lanes of each section that drives show.

    Args:
        problem: for sections and tallies.
        tallies: of each drive.
    """
    index, road = problem.tally_index, problem.road
    sections = range(road.num_sections)
    speed = np.asarray([index[f"section_speed[{section}]"] for section in sections])
    lane_m = np.asarray([index[f"section_lane_m[{section}]"] for section in sections])
    border_m = np.asarray(road.section_border_m, float)
    lanes = np.diff(np.asarray(road.lane_m_before(road.section_border_m), float)) / np.diff(border_m)

    def volume(tally: Float[np.ndarray, " tally"]) -> Float[np.ndarray, " section"]:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(tally[lane_m] > 0.0, SECONDS_PER_HOUR * lanes * tally[speed] / tally[lane_m], np.nan)

    pooled, error = jackknife(tallies, volume)
    error = ERROR_OF_ONE_DRIVE * pooled if len(tallies) == 1 else error
    return SectionVolumes(pooled, np.hypot(error, LEAST_VOLUME_ERROR * pooled))
