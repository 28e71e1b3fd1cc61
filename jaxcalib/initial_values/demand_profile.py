"""Inflows that the logs show: traffic volume along the route, and what joins and leaves in between.

The volume on a section is the sum of the inflows upstream, each by the share of its vehicles that get that far. The
subject vehicle samples that volume in a window that moves with it, so single sections are noisy; the scenario's own
inflows keep those that the logs hardly show near where they are (ridge towards the scenario).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from jaxcalib.measures.observed_road import ObservedRoad
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.units import SECONDS_PER_HOUR
from sim_adapters.world.world_builder import WorldTemplate

SCENARIO_TRUST = 0.15  # relative standard deviation of the true inflows around the scenario's, beyond a common factor
COMMON_TRUST = 0.5  # of the common factor
# Degrees of freedom of an input's own deviation: most counts are right to 15 %, and one that is wrong is far off. A
# normal prior would hold it, and let the other inputs pay.
DEGREES_OF_FREEDOM = 3.0
NUM_REWEIGHTINGS = 30
BENT_SHARE = 0.25  # of a change of the demand that may be off because volumes do not answer in proportion
LEAST_FACTOR = 0.05  # that inflows keep of the scenario's
LEAST_VEHPH = 1e-9


@dataclass(frozen=True)
class DemandEstimate:
    """Inflows that the logs show."""

    values_vehph: np.ndarray  # estimate of each input
    error_vehph: np.ndarray  # standard error of each
    scenario_vehph: np.ndarray  # the scenario's own inflows
    # relative standard deviation of each around the scenario's, beyond a common factor, as wide as the logs ask for
    trust: np.ndarray
    misfit: float = 0.0  # squared difference of the volumes, field less simulated, in standard errors

    def half_way_from(self, simulated_vehph: Float[np.ndarray, " input"]) -> "DemandEstimate":
        """Half of the step from the simulated inflows, where the whole led to no better volumes; that is its error."""
        half = 0.5 * (self.values_vehph - simulated_vehph)
        return replace(
            self, values_vehph=self.values_vehph - half, error_vehph=np.hypot(self.error_vehph, np.abs(half))
        )


@dataclass(frozen=True)
class SectionVolumes:
    """Volume that drives show along the route."""

    vehph: Float[np.ndarray, " section"]  # on all lanes of each section; nan where nothing was observed
    error_vehph: Float[np.ndarray, " section"]  # its standard error


def estimate_demand(
    scenario: Scenario,
    template: WorldTemplate,
    road: ObservedRoad,
    field: SectionVolumes,
    simulated: SectionVolumes | None = None,
    observed_s: Sequence[tuple[float, float]] = (),
    simulated_vehph: Float[np.ndarray, " input"] | None = None,
) -> DemandEstimate:
    """Estimate the inputs from the volume on each section.

    A drive does not see the demand itself: it counts itself, gathers others behind it, looks at its own hours only, and
    sees of a full entrance what the lanes carry. Where the same drives have been simulated at a known demand, the field
    is compared with what they saw there, which all of that is in.

    Args:
        scenario: for routes and places.
        template: for the inputs and their flows.
        road: the sections.
        field: volumes that the field's drives show.
        simulated: volumes that simulated drives show at a known demand; what the scenario's demand would be without
            any drive, where None.
        observed_s: begin and end of each of the field's drives on the scenario's clock: what comes at another time is
            not seen. All of it is where there are none.
        simulated_vehph: inflows at which they were simulated; the scenario's unless given.
    """
    base = template.base_demand_vehph()
    passing, fixed_vehph = _steady_volumes(scenario, template, road, observed_s)
    at = np.zeros(len(base)) if simulated_vehph is None else simulated_vehph / np.maximum(base, LEAST_VEHPH) - 1.0
    steady_vehph = passing @ (1.0 + at) + fixed_vehph
    believed = SectionVolumes(steady_vehph, np.zeros(len(steady_vehph))) if simulated is None else simulated
    error_vehph = np.hypot(field.error_vehph, believed.error_vehph)
    seen = np.isfinite(field.vehph - believed.vehph) & np.isfinite(error_vehph) & (error_vehph > 0)
    # where a drive sees less than the demand, it sees as much less of what is added to it
    answer = np.minimum(believed.vehph / np.maximum(steady_vehph, LEAST_VEHPH), 1.0)
    design = passing[seen] * answer[seen, None] / error_vehph[seen, None]
    target = (field.vehph - believed.vehph)[seen] / error_vehph[seen] + design @ at  # changes count from the scenario
    # unknowns: common factor and each input's own deviation from it
    num_inputs = len(base)
    wide = np.concatenate([design.sum(axis=1, keepdims=True), design], axis=1)
    trust = np.full(num_inputs, COMMON_TRUST)  # what the logs say goes first: from the other side one may be held
    deviation, covariance = _deviations(wide, target, trust)
    for _ in range(NUM_REWEIGHTINGS):
        trust = _trust_after(deviation[1:], covariance.diagonal()[1:])
        deviation, covariance = _deviations(wide, target, trust)
    combine = np.concatenate([np.ones((num_inputs, 1)), np.eye(num_inputs)], axis=1)
    change = combine @ deviation
    error = np.sqrt(np.diag(combine @ covariance @ combine.T))
    if simulated is not None:  # volumes answer in proportion near the simulated demand only
        error = np.hypot(error, BENT_SHARE * (change - at))
    return DemandEstimate(
        values_vehph=base * np.maximum(1.0 + change, LEAST_FACTOR),
        error_vehph=base * error,
        scenario_vehph=base,
        trust=trust,
        misfit=float(np.sum(((field.vehph - believed.vehph)[seen] / error_vehph[seen]) ** 2)),
    )


def demand_covariance(demand: DemandEstimate) -> np.ndarray:
    """Return how the true inflows vary around the scenario's, [input, input], veh/h squared."""
    relative = COMMON_TRUST**2 + np.diag(demand.trust**2)
    return np.outer(demand.scenario_vehph, demand.scenario_vehph) * relative


def _deviations(
    wide: Float[np.ndarray, "section unknown"], target: Float[np.ndarray, " section"], trust: np.ndarray
) -> tuple[Float[np.ndarray, " unknown"], Float[np.ndarray, "unknown unknown"]]:
    """Return the common factor's deviation and each input's own with their covariance, as far as each is trusted."""
    prior = np.diag(np.concatenate([[COMMON_TRUST], trust]) ** -2.0)
    covariance = np.linalg.inv(wide.T @ wide + prior)
    return covariance @ (wide.T @ target), covariance


def _trust_after(deviation: Float[np.ndarray, " input"], variance: Float[np.ndarray, " input"]) -> np.ndarray:
    """Return the deviation that each input is trusted to, once the logs have shown by how much it may be off.

    Source: Student's t as a scale mixture of normal distributions, expectation maximisation; Lange, Little & Taylor
    (1989), J. Am. Stat. Assoc. 84, 881-896, sec. 3.
    """
    square = (deviation**2 + variance) / SCENARIO_TRUST**2
    return SCENARIO_TRUST * np.sqrt((DEGREES_OF_FREEDOM + square) / (DEGREES_OF_FREEDOM + 1.0))


def _steady_volumes(
    scenario: Scenario, template: WorldTemplate, road: ObservedRoad, observed_s: Sequence[tuple[float, float]]
) -> tuple[Float[np.ndarray, "section input"], Float[np.ndarray, " section"]]:
    """Volume that each input, and all that belongs to none, brings to each section while drives are under way, veh/h.

    A section that a route reaches in part counts in part.
    """
    input_of = {flow: index for index, flows in enumerate(template.layout.input_flows) for flow in flows}
    volume = np.zeros((road.num_sections, template.layout.num_inputs + 1))
    for flow in scenario.flows:
        vehph = flow.rate_vehps * SECONDS_PER_HOUR * _share_observed(flow.begin_s, flow.end_s, observed_s)
        volume[:, input_of.get(flow.id, -1)] += vehph * _part_passed(scenario, flow.route, road)
    return volume[:, :-1], volume[:, -1]


def _share_observed(begin_s: float, end_s: float, observed_s: Sequence[tuple[float, float]]) -> float:
    """Share of the drives' time in which a flow comes."""
    inside_s = sum(max(0.0, min(end_s, until_s) - max(begin_s, from_s)) for from_s, until_s in observed_s)
    all_s = sum(until_s - from_s for from_s, until_s in observed_s)
    return inside_s / all_s if all_s > 0.0 else 1.0


def _part_passed(scenario: Scenario, route: tuple[str, ...], road: ObservedRoad) -> np.ndarray:
    network = scenario.network
    on_main = [edge for edge in route if edge in network.main_edges]
    begin_m, end_m = network.edge_start_m(on_main[0]), network.edge_end_m(on_main[-1])
    border = np.asarray(road.section_border_m, float)
    passed = np.minimum(border[1:], end_m) - np.maximum(border[:-1], begin_m)
    return np.clip(passed / np.diff(border), 0.0, 1.0)
