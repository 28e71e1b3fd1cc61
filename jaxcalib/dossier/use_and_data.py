"""What the simulation is for, what it was made from, and what it takes for granted."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section, searched_in
from surrogate.subject.registry import DESCRIPTIONS

# Whoever does not say them is asked under this heading; `accuracy_requirement` under that of the validation.
ASKED_OF_PEOPLE = {
    "purpose": "Which decision will rest on this simulation?",
    "scope": "Which tests and which quantities is it to be used for?",
    "operational_design_domain": "In which roads, weather, traffic and speeds is the tested vehicle to drive?",
    "criticality": "What happens if the simulation is wrong?",
    "responsible": "Who made it, and what is their experience?",
    "review": "Who, independent of them, has looked at it?",
}
DEFAULT_LANE_CHANGE = "LC2013"  # of SUMO, where a vType names none
# What calibrated SUMO traffic takes for granted whatever the case; a test that depends on one of these is out of scope.
ASSUMPTIONS = (
    "Traffic is SUMO's: vehicles in lanes, whose drivers follow and change lane by a model with the calibrated "
    "parameters; weather, light, road surface and vehicle dynamics are no part of it.",
    "Drivers of one vType differ in desired speed alone, unless the scenario says otherwise.",
    "Drivers, demand and road are those of the recorded hours; other hours and roads are extrapolation.",
    "What lies beyond the range of the sensors was not observed; there the simulation rests on the scenario.",
)


def purpose_and_scope(evidence: Evidence) -> Section:
    """What people say of the use."""
    section = Section("Purpose and scope of use", "Scope and criticality; M&S management: team, life cycle")
    for key, question in ASKED_OF_PEOPLE.items():
        if key in evidence.stated:
            section.say(f"{key.replace('_', ' ')}: {evidence.stated[key].strip()}", f"statement: {key}")
        else:
            section.lack(f"{question} (`{key}` of --statement)")
    return section


def data(evidence: Evidence) -> Section:
    """The logs and what was found wrong with them."""
    problem = evidence.problem
    section = Section("Data and their checks", "M&S management: pedigree of inputs")
    sensor = problem.case.perception
    section.say(
        f"{len(problem.drives)} drives, sensors to {sensor.ahead_m:g} m ahead and {sensor.behind_m:g} m behind.",
        "case.toml: drive, perception",
    )
    rows = [
        (
            drive.id,
            drive.role.replace("_", "-"),
            stated.depart_s,
            float(np.ptp(drive.subject.time_s)),
            drive.counts.object_rows,
            drive.counts.tracks,
            drive.counts.object_rows - len(drive.objects.offset_m),
        )
        for stated, drive in zip(problem.case.drives, problem.drives, strict=True)
    ]
    columns = ("drive", "role", "departs, s", "lasts, s", "object rows", "tracks", "rows left out")
    section.show("Drives", columns, rows, "field/: tables of the drives")
    found = problem.log_warnings
    for line in found:
        section.say(f"Found, and dealt with as said: {line}", "jaxcalib check")
    if not found:
        section.say("The quantities of the logs do not contradict one another.", "jaxcalib check")
    if not problem.case.drives_of("held_out"):
        section.lack("No drive is held out: nothing was judged by data that the calibration has not seen.")
    for line in evidence.changes:
        section.lack(f"The case is no longer what was calibrated: {line}")
    section.lack("How the sensors were calibrated, and who recorded the drives: no file of a case says so.")
    return section


def model_and_limits(evidence: Evidence) -> Section:
    """The model, its assumptions and limits."""
    problem, parts = evidence.problem, evidence.problem.parts
    section = Section("Model, assumptions and limits", "M&S analysis and description")
    behaviour = parts.behaviour
    section.say(
        f"SUMO {evidence.result['versions']['libsumo']}, car-following model {behaviour.car_following} for "
        f"{', '.join(behaviour.vtypes)}; steps of {parts.scenario.step_s:g} s.",
        "case.toml: behaviour, scenario",
    )
    road = problem.road
    section.say(
        f"Observed road: {float(np.max(np.asarray(road.section_border_m))):.0f} m in {road.num_sections} sections; "
        f"{len(parts.inputs)} inflows.",
        "scenario/: network and routes",
    )
    vtypes, subject = problem.scenario.demand.vtypes, parts.subject
    models = sorted({vtypes[name].get("laneChangeModel", DEFAULT_LANE_CHANGE) for name in behaviour.vtypes})
    section.say(
        f"Lane changes by SUMO's {', '.join(models)}; {subject.vehicle}, the subject vehicle, is driven by "
        f"{DESCRIPTIONS[subject.model.name]}.",
        "scenario/, case.toml: subject",
    )
    for line in ASSUMPTIONS:
        section.say(f"Assumed: {line}", "the program: what SUMO's traffic is")
    _simulators(section, evidence.result["confirmation"])
    for entry in evidence.result.get("scenario") or []:
        section.say(
            f"Limit of the surrogate: {entry.get('words', '')} ({entry.get('level', '')})", "result.json: scenario"
        )
    warnings = [*evidence.result.get("warnings", [])]
    for line in warnings:
        section.say(f"Warning: {line}", "result.json: warnings")
    return section


def _simulators(section: Section, confirmation: Mapping[str, Any]) -> None:
    """In which simulator values were searched, and whether both see the traffic alike."""
    further = "".join(f", then by {way}" for way in confirmation.get("went_on_by") or ())
    section.say(
        f"Values were searched in {searched_in(confirmation)}{further}; "
        "errors, measures and health of the result are SUMO's.",
        "result.json: confirmation",
    )
    for one in confirmation.get("agreement") or ():
        where = one["where"][:1].upper() + one["where"][1:]
        alike = f"in {one['share_alike']:.0%} of the sections surrogate and SUMO drive alike"
        section.say(f"{where}: {alike}.", "result.json: confirmation.agreement")
        if not one["holds"] and not confirmation.get("searched_in_sumo"):
            section.lack(f"{where}, sensitivities and intervals in SUMO: only {alike}.")
