"""Criteria, safety and encounters against the field, and what is the same within which margin."""

from collections.abc import Mapping
from typing import Any

from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section, between, number_range, words_of
from jaxcalib.html.page import percent
from jaxcalib.measures.registry import safety_measures
from jaxcalib.validation.comparison import FEWEST_EVENTS
from jaxcalib.validation.encounters import ALL
from jaxcalib.validation.equivalence import MOST_MORE

FILE = "validation.json"


def validation(evidence: Evidence) -> Section:
    """What a validation found; without one, that there is none."""
    found = evidence.validation
    section = Section(
        "Validation within margins", "Validation: measures, goodness of fit, accuracy requirement, results"
    )
    if "accuracy_requirement" in evidence.stated:
        section.say(
            f"Accuracy required: {evidence.stated['accuracy_requirement'].strip()}", "statement: accuracy_requirement"
        )
    else:
        section.lack(
            "Which accuracy does the purpose ask for? Margins are usual ones (`accuracy_requirement` of --statement)"
        )
    if found is None:
        section.lack("No validation was run: `jaxcalib validate CASE RUN`.")
        return section
    for line in found.get("warnings", []):
        section.say(f"Warning: {line}", f"{FILE}: warnings")
    _criteria(section, found)
    _margins(section, found)
    _safety(section, found)
    _encounters(section, found)
    return section


def _criteria(section: Section, found: Mapping[str, Any]) -> None:
    who = "held-out drives" if found["role"] == "held_out" else "drives that were fitted"
    section.say(
        f"Judged by {len(found['drives'])} {who}, {found['num_rounds']} rounds, in SUMO, on seeds "
        f"{found['seeds'][0]} to {found['seeds'][1]}, which the calibration has not used.",
        f"{FILE}: role, seeds",
    )
    if found["role"] == "fit":
        section.lack("Validation by held-out drives: these were fitted.")
    rows, num_failed = [], 0
    for one in found["criteria"]:
        if one["passes"] is None:
            section.lack(f"{one['name']} ({one['standard']}): {one['note']}")
            continue
        bound = f"{'at most' if one['is_upper'] else 'at least'} {one['limit']:.4g}"
        rows.append(
            (one["name"], one["standard"], one["value"], bound, "pass" if one["passes"] else "fail", one["note"])
        )
        if not one["passes"]:
            num_failed += 1
            section.fail(f"{one['name']}: {one['value']:.4g}, {bound} ({one['standard']}). {one['note']}".strip())
    verdict = "Not valid" if num_failed else "Valid"
    section.say(f"{verdict}: {num_failed} of {len(rows)} criteria fail.", f"{FILE}: criteria")
    section.show("Criteria", ("criterion", "standard", "value", "limit", "", "note"), rows, f"{FILE}: criteria")


def _margins(section: Section, found: Mapping[str, Any]) -> None:
    rows = []
    for name, one in found["equivalence"].items():
        told = (name, percent(one["difference"]), between(one["interval_90"]), percent(one["margin"]))
        rows.append((*told, one["verdict"], one["source"]))
        if one["verdict"] == "different":
            section.fail(f"{name} is known to differ by {percent(one['difference'])}.")
        elif one["verdict"] != "equivalent":
            number = one.get("more_drives")
            least = "at least " if number == MOST_MORE else ""
            more = f"; {least}{number} more would tell" if number else ""
            why = one.get("note") or f"{one['verdict']}{more}"
            section.lack(f"Whether {name} is the same within {percent(one['margin'])}: {why}.")
    columns = ("quantity", "difference", "90 % interval", "margin", "verdict", "source of the margin")
    section.show("The same within a margin", columns, rows, f"{FILE}: equivalence")


def _safety(section: Section, found: Mapping[str, Any]) -> None:
    """What no criterion judges by itself: each safety measure beside rounds of drives."""
    rows, unjudged = [], []
    for name in safety_measures():
        one = found["measures"].get(name)
        if one is None or (one["field"] is None and one["simulated"] is None):  # the road has no exit, say
            continue
        rows.append(
            (
                name, one["field"], one["num_observations"], one["simulated"], number_range(one["interval_90"]),
                one["p_adjusted"],
            )
        )  # fmt: skip
        if one["p_value"] is None:
            unjudged.append(name)
        elif one["is_beyond_chance"]:
            section.fail(f"{name} lies beyond what chance makes of simulated rounds.")
    columns = ("measure", "field", "observations", "simulated", "90 % of rounds", "corrected probability")
    section.show("Safety measures", columns, rows, f"{FILE}: measures")
    if unjudged:
        section.lack(f"Safety measures that rest on too little to be judged: {', '.join(unjudged)}.")


def _encounters(section: Section, found: Mapping[str, Any]) -> None:
    rows = []
    for kind, one in found["encounters"].items():
        scores = (one["recall"], one["precision"], one["f1"], one["among_simulated"], one["limit"])
        rows.append((words_of(kind), *(_total(one[side]) for side in ("field", "simulated")), *scores))
        in_field, simulated = (_total(one[side]) for side in ("field", "simulated"))
        if in_field is not None and in_field >= FEWEST_EVENTS and not simulated:
            section.fail(f"The field has {in_field:.0f} encounters of the kind {words_of(kind)}, the simulation none.")
        # single kinds are shown alone: four tests at 5 % would often speak against a simulation that is right
        if kind == ALL and None not in (one["f1"], one["limit"]) and one["f1"] < one["limit"]:
            section.fail("The field's encounters are recalled worse than rounds recall each other's.")
    if found["encounters"][ALL]["limit"] is None:
        section.lack("Whether encounters are the field's: fewer than 19 rounds, or hardly one that has any.")
    columns = ("encounters", "field", "simulated", "recall", "precision", "F1", "F1 among rounds", "5 % of these below")
    section.show("Encounters around the subject vehicle", columns, rows, f"{FILE}: encounters")
    rows = [
        (actor, side, one["exceedances"], one["level_mps2"], number_range(one["interval_90"]))
        for actor, both in found["tails"].items()
        for side, one in both.items()
    ]
    columns = ("who brakes", "", "exceedances", "level, m/s2", "90 % interval")
    section.show("Deceleration needed once in 1000 km", columns, rows, f"{FILE}: tails")
    unknown = [f"{actor} in the {side}" for actor, side, _, level, _ in rows if level is None]
    if unknown:
        section.lack(f"Deceleration needed once in 1000 km: too few exceedances or drives, {', '.join(unknown)}.")


def _total(by_severity: Mapping[str, float | None] | None) -> float | None:
    return None if by_severity is None else sum(value or 0.0 for value in by_severity.values())
