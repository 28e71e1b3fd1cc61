"""Whether scenario, clock and drives of a case fit together; each error is one line that says what was expected."""

from collections.abc import Sequence

import numpy as np

from jaxcalib.case.case import ROLES, Case, ScenarioParts
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError, quote
from jaxcalib.field.field_log import DriveLog
from sim_adapters.scenario.scenario import Scenario
from sim_adapters.world.world_builder import WorldTemplate

LEAST_STEP_S, MOST_STEP_S = 0.05, 1.0
LEAST_COVERED = 0.8  # of the route, by a drive that counts as a whole one without a warning


def check_clock(scenario: Scenario, parts: ScenarioParts, case: Case) -> None:
    """Check that case, configuration and drives have one clock.

    Raises:
        CaseError: they are not.
    """
    step_s = parts.scenario.step_s
    if abs(step_s - scenario.configuration.step_s) > 1e-9:
        raise CaseError(
            FILE_NAME,
            "scenario.step_s",
            f"expected the step-length of the configuration, {scenario.configuration.step_s:g}, got {step_s:g}.",
        )
    if not LEAST_STEP_S <= step_s <= MOST_STEP_S:
        expected = f"expected {LEAST_STEP_S:g} to {MOST_STEP_S:g} s, got {step_s:g}."
        raise CaseError(FILE_NAME, "scenario.step_s", expected)
    begin_s, end_s = scenario.configuration.begin_s, scenario.configuration.end_s
    for drive in case.drives:
        if drive.depart_s < begin_s or (end_s is not None and drive.depart_s >= end_s):
            until = "" if end_s is None else f" to {end_s:g}"
            expected = (
                f"expected a departure within the scenario's clock, {begin_s:g}{until} s (begin and end of "
                f"{parts.scenario.config_file.name}), got {drive.depart_s:g}."
            )
            raise CaseError(FILE_NAME, f"drive[{drive.id}].depart_s", expected)


def check_models(scenario: Scenario, parts: ScenarioParts) -> None:
    """Check that models and types are those of the scenario.

    Raises:
        CaseError: they are not.
    """
    for vtype in parts.behaviour.vtypes:
        if vtype not in scenario.demand.vtypes:
            known = ", ".join(map(quote, scenario.demand.vtypes))
            raise CaseError(
                FILE_NAME, "behaviour.vtypes", f"expected vTypes of the scenario ({known}), got {quote(vtype)}."
            )
        model = scenario.demand.vtypes[vtype].get("carFollowModel", "Krauss")
        if model != parts.behaviour.car_following:
            raise CaseError(
                FILE_NAME,
                "behaviour.car_following",
                f"expected {quote(model)}, as in vType {quote(vtype)}, got {quote(parts.behaviour.car_following)}.",
            )
    if scenario.demand.subject_vtype != parts.subject.vtype:
        raise CaseError(
            FILE_NAME,
            "subject.vtype",
            f"expected the type of vehicle {quote(parts.subject.vehicle)}, {quote(scenario.demand.subject_vtype)}, "
            f"got {quote(parts.subject.vtype)}.",
        )


def check_inflows(template: WorldTemplate) -> None:
    """Check that each input has vehicles in the scenario.

    Raises:
        CaseError: one has none.
    """
    for name, rate_vehph in zip(template.layout.input_ids, template.base_demand_vehph(), strict=True):
        if not rate_vehph > 0.0:
            expected = f"expected flows with vehicles in the scenario, got {rate_vehph:g} veh/h: nothing to scale."
            raise CaseError(FILE_NAME, f"input {quote(name)}", expected)


def check_drives(case: Case, drives: Sequence[DriveLog], is_seen: Sequence[bool], frame_interval_s: float) -> None:
    """Check that each drive shows something, and one of those to fit the traffic around it.

    Args:
        case: for the files' names.
        drives: its drives.
        is_seen: whether a drive has a frame.
        frame_interval_s: time between frames.

    Raises:
        CaseError: one shows nothing.
    """
    for drive, one in zip(case.drives, is_seen, strict=True):
        if not one:
            expected = f"expected rows at the instants that count, every {frame_interval_s:g} s; got none."
            raise CaseError(drive.subject_file, "", expected)
    if not any(len(log.objects.offset_m) for log in drives if log.role == "fit"):
        expected = "expected detected vehicles in one of the drives to fit at least; their tables have none to go by."
        raise CaseError(case.drives_of("fit")[0].objects_file, "", expected)


def replay_warnings(case: Case) -> list[str]:
    """Return a line where a search may replay held-out drives: a run finds its drive by departure and seed alone."""
    fit, held_out = ({drive.depart_s for drive in case.drives_of(role)} for role in ROLES)
    if not fit & held_out:
        return []
    return [
        "case.toml: drives to fit and held-out ones depart at the same time, and a replay takes any of them by the "
        "run's seed: how the subject vehicle moved in held-out drives enters the search. Let them depart at times of "
        "their own."
    ]


def coverage_warnings(drives: Sequence[DriveLog], length_m: float) -> list[str]:
    """Return one line for each log that covers only a part of the route."""
    lines = []
    for drive in drives:
        covered_m = float(np.ptp(drive.subject.position_m))
        if covered_m < LEAST_COVERED * length_m:
            lines.append(
                f"drive {drive.id}: the log covers {covered_m:.0f} of {length_m:.0f} m of the route; counts per drive "
                "and the travel time take it for a whole drive."
            )
    return lines
