"""Whether scenario, clock and drives of a case fit together; each fault is one line that says what was expected."""

from collections.abc import Sequence

from jaxcalib.case.case import Case, ScenarioParts
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError, quote, shorten
from jaxcalib.field.field_log import DriveLog
from sim_adapters.interface import ParameterLayout
from sim_adapters.scenario.scenario import Scenario

LEAST_STEP_S, MOST_STEP_S = 0.05, 1.0


def clock_faults(scenario: Scenario, parts: ScenarioParts, case: Case) -> list[CaseError]:
    """What is wrong where case, configuration and drives do not have one clock."""
    faults, step_s, config = [], parts.scenario.step_s, scenario.configuration
    if abs(step_s - config.step_s) > 1e-9:
        expected = f"expected the step-length of the configuration, {config.step_s:g}, got {step_s:g}."
        faults.append(CaseError(FILE_NAME, "scenario.step_s", expected))
    elif not LEAST_STEP_S <= step_s <= MOST_STEP_S:
        expected = f"expected {LEAST_STEP_S:g} to {MOST_STEP_S:g} s, got {step_s:g}."
        faults.append(CaseError(FILE_NAME, "scenario.step_s", expected))
    begin_s, end_s = config.begin_s, config.end_s
    if end_s is not None and end_s <= begin_s:
        expected = f"expected an end after its begin, {begin_s:g} s, got {end_s:g} s; SUMO would not begin."
        return [*faults, CaseError(config.file, "option 'end'", expected)]
    for drive in case.drives:
        if drive.depart_s < begin_s or (end_s is not None and drive.depart_s >= end_s):
            until = "" if end_s is None else f" to {end_s:g}"
            expected = (
                f"expected a departure within the scenario's clock, {begin_s:g}{until} s (begin and end of "
                f"{parts.scenario.config_file.name}), got {drive.depart_s:g}."
            )
            faults.append(CaseError(FILE_NAME, f"drive[{drive.id}].depart_s", expected))
    return faults


def model_faults(scenario: Scenario, parts: ScenarioParts) -> list[CaseError]:
    """What is wrong where models and types are not those of the scenario."""
    faults = []
    for vtype in parts.behaviour.vtypes:
        if vtype not in scenario.demand.vtypes:
            known = ", ".join(map(quote, scenario.demand.vtypes))
            expected = f"expected vTypes of the scenario ({known}), got {quote(vtype)}."
            faults.append(CaseError(FILE_NAME, "behaviour.vtypes", expected))
            continue
        model = scenario.demand.vtypes[vtype].get("carFollowModel", "Krauss")
        if model != parts.behaviour.car_following:
            expected = (
                f"expected {quote(model)}, as in vType {quote(vtype)}, got {quote(parts.behaviour.car_following)}."
            )
            faults.append(CaseError(FILE_NAME, "behaviour.car_following", expected))
    if scenario.demand.subject_vtype != parts.subject.vtype:
        expected = (
            f"expected the type of vehicle {quote(parts.subject.vehicle)}, {quote(scenario.demand.subject_vtype)}, "
            f"got {quote(parts.subject.vtype)}."
        )
        faults.append(CaseError(FILE_NAME, "subject.vtype", expected))
    return faults


def vtype_warnings(scenario: Scenario, layout: ParameterLayout) -> list[str]:
    """Return a line where vTypes that move together differ in the scenario."""
    differ = any(
        scenario.values_of(vtype)[attribute] != scenario.values_of(group[0])[attribute]
        for group in layout.vtype_groups
        for vtype in group
        for attribute in layout.attributes
    )
    if not differ:
        return []
    how = "keep their proportions to the first" if layout.factors else "all get the same calibrated values"
    of_group = " of a group" if layout.groups else ""
    return [f"case.toml: behaviour.vtypes{of_group} differ in the scenario; they {how}."]


def input_faults(scenario: Scenario, parts: ScenarioParts) -> list[CaseError]:
    """What is wrong where inputs are not made of flows that bring vehicles onto the route."""
    faults, known = [], scenario.flow_ids
    for one in parts.inputs:
        place = f"input {quote(one.id)}"
        unknown = [flow for flow in one.flows if flow not in known]
        for flow in unknown:
            expected = f"expected a <flow id='{shorten(flow)}'> on the subject vehicle's route; there is none."
            faults.append(CaseError(FILE_NAME, place, expected))
        if not unknown and not sum(map(scenario.mean_rate_vehps, one.flows)) > 0.0:
            expected = "expected flows with vehicles in the scenario, got 0 veh/h: nothing to scale."
            faults.append(CaseError(FILE_NAME, place, expected))
    return faults


def raise_first(faults: Sequence[CaseError]) -> None:
    """Refuse a case for the first of its faults; `jaxcalib check` shows all of them.

    Raises:
        CaseError: there is one.
    """
    if faults:
        raise faults[0]


def drive_faults(case: Case, drives: Sequence[DriveLog], is_seen: Sequence[bool], interval_s: float) -> list[CaseError]:
    """What is wrong where a drive shows nothing, or none of those to fit the traffic around it.

    Args:
        case: for the files' names.
        drives: its drives.
        is_seen: whether a drive has a frame.
        interval_s: time between frames.
    """
    expected = f"expected rows at the instants that count, every {interval_s:g} s; got none."
    faults = [
        CaseError(drive.subject_file, "", expected) for drive, one in zip(case.drives, is_seen, strict=True) if not one
    ]
    to_fit = case.drives_of("fit")
    if to_fit and not any(len(log.objects.offset_m) for log in drives if log.role == "fit"):
        expected = "expected detected vehicles in one of the drives to fit at least; their tables have none to go by."
        faults.append(CaseError(to_fit[0].objects_file, "", expected))
    return faults
