"""Which number of a parameter vector means what: inputs, then the driver parameters of each group of vTypes."""

import math
from collections.abc import Mapping, Sequence

from jaxcalib.case.case import ScenarioParts
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError, quote
from jaxcalib.problem.parameter_space import behaviour_parameters, ranges_of
from jaxcalib.problem.vtype_groups import groups_of
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.scenario.sumo_names import NEAREST_MODEL, SUMO_MODELS, nearest_model

# The largest orthogonal array of four levels has no more columns.
MOST_DRIVER_PARAMETERS = 341


def layout_of(parts: ScenarioParts, scenario: Scenario) -> ParameterLayout:
    """Return which number of a parameter vector means what.

    Raises:
        CaseError: the case names a car-following model or a parameter that is not known, or groups of vTypes that
            cannot be.
    """
    behaviour = parts.behaviour
    model = behaviour.car_following
    if model not in (*SUMO_MODELS, *NEAREST_MODEL):
        known = ", ".join((*SUMO_MODELS, *NEAREST_MODEL))
        raise CaseError(FILE_NAME, "behaviour.car_following", f"expected one of {known}, got {quote(model)}.")
    model = nearest_model(model)
    attributes = behaviour_parameters(FILE_NAME, model, behaviour.parameters)
    groups = groups_of(behaviour, scenario)
    _check_number(groups, attributes)
    factors, most = (), ()
    if behaviour.common == "factors":
        first_of = {vtype: group[0] for group in groups for vtype in group}
        factors = _common_factors({vtype: first_of[vtype] for vtype in behaviour.vtypes}, attributes, scenario)
        ranges = ranges_of(model)  # a share stays one, however large its factor
        most = tuple(1.0 if ranges[attribute].upper == 1.0 else math.inf for attribute in attributes) if factors else ()
    return ParameterLayout(
        input_ids=tuple(entrance.id for entrance in parts.inputs),
        input_flows=tuple(entrance.flows for entrance in parts.inputs),
        vtypes=behaviour.vtypes,
        attributes=attributes,
        factors=factors,
        most=most,
        groups=() if behaviour.apart is None else groups,
    )


def _check_number(groups: Sequence[Sequence[str]], attributes: Sequence[str]) -> None:
    number = len(groups) * len(attributes)
    if number > MOST_DRIVER_PARAMETERS:
        expected = (
            f"expected at most {MOST_DRIVER_PARAMETERS} driver parameters, got {len(groups)} groups of "
            f"{len(attributes)}: name fewer in behaviour.parameters, or let more vTypes move together."
        )
        raise CaseError(FILE_NAME, "behaviour.apart", expected)


def _common_factors(
    first_of: Mapping[str, str], attributes: Sequence[str], scenario: Scenario
) -> tuple[tuple[float, ...], ...]:
    """Factors between vTypes and the first of their group, [vtype, attribute]; none where all are alike."""
    known = scenario.demand.vtypes
    own = {vtype: scenario.values_of(vtype) if vtype in known else {} for vtype in first_of}
    factors = tuple(
        tuple(_factor(own[vtype], own[first], attribute) for attribute in attributes)
        for vtype, first in first_of.items()
    )
    return () if all(factor == 1.0 for row in factors for factor in row) else factors


def _factor(values: Mapping[str, float], of_first: Mapping[str, float], attribute: str) -> float:
    """Factor between a vType's attribute and the first vType's; 1 where either is 0, which no factor can tell."""
    own, first = values.get(attribute, 0.0), of_first.get(attribute, 0.0)
    return own / first if own > 0.0 and first > 0.0 else 1.0
