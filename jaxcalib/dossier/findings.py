"""What the runs show: calibration with its uncertainty, validation within margins, the gap with its causes."""

from collections.abc import Sequence
from typing import Any

from jaxcalib.diagnosis.answer.report import TITLES
from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section
from jaxcalib.html.page import percent
from jaxcalib.measures.registry import safety_measures

SHOWN_CAUSES = 5
WIDE = 0.5  # of what a parameter is: an interval wider than that says that the logs do not tell it


def calibration(evidence: Evidence) -> Section:
    """Parameters with their intervals, and errors before and after."""
    result = evidence.result
    section = Section("Calibration and its uncertainty", "Validation: uncertainty of inputs and parameters")
    rows, open_ones = [], []
    for name, entry in result["parameter_table"].items():
        lower, upper, value = entry["lower"], entry["upper"], entry["value"]
        told = "" if lower is None else f"{lower:.4g} to {upper:.4g}"
        rows.append((name, entry["scenario"], value, told, entry["unit"], entry["source"]))
        if entry["at_bound"]:
            open_ones.append(f"{name} (at its bound)")
        elif lower is None or upper - lower > 2.0 * WIDE * abs(value):
            open_ones.append(f"{name} (interval as wide as the value)")
    columns = ("parameter", "scenario", "calibrated", "90 % interval", "unit", "where its first value came from")
    section.show("Parameters", columns, rows, "result.json: parameter_table")
    if open_ones:
        section.lack(f"Not identified by these logs: {', '.join(open_ones)}.")
    for role in ("held_out", "fit"):
        before, after = (result["moes"][kind].get(role, {}) for kind in ("no_calibration", "calibrated"))
        floor, high = result["moes"]["noise_floor"].get(role, {}), result["noise_floor_high"].get(role, {})
        intervals = result["intervals"]["calibrated"].get(role, {})
        rows = [
            (
                name.replace("_", " "),
                percent(before.get(name)),
                percent(value),
                _interval(intervals.get(name)),
                percent(floor.get(name)),
                percent(high.get(name)),
            )
            for name, value in after.items()
        ]
        columns = ("error", "before", "after", "90 % interval", "chance, mean", "chance, 95 %")
        section.show(f"Errors on the {role.replace('_', '-')} drives", columns, rows, "result.json: moes, intervals")
        above = [
            name.replace("_", " ")
            for name, value in after.items()
            if None not in (value, high.get(name)) and value > high[name]
        ]
        if above:
            section.say(
                f"Beyond chance on the {role.replace('_', '-')} drives: {', '.join(above)}.", "result.json: moes"
            )
        _show_safety(section, result["mops"], role)
    return section


def _show_safety(section: Section, mops: Any, role: str) -> None:
    """Tails of traffic, which nothing was fitted to."""
    field, simulated = (mops[source].get(role, {}) for source in ("field", "sumo"))
    rows = [(name, field.get(name), simulated.get(name)) for name in safety_measures() if name in field]
    columns = ("measure", "field", "simulated")
    section.show(f"Safety measures on the {role.replace('_', '-')} drives", columns, rows, "result.json: mops")
    if not rows:
        section.lack(f"Safety measures on the {role.replace('_', '-')} drives: this result was made without them.")


def validation(evidence: Evidence) -> Section:
    """Criteria, and what is the same within which margin."""
    found = evidence.validation
    section = Section(
        "Validation within margins", "Validation: measures, goodness of fit, accuracy requirement, results"
    )
    if found is None:
        section.lack("No validation was run: `jaxcalib validate CASE RUN`.")
        return section
    who = "held-out drives" if found["role"] == "held_out" else "drives that were fitted"
    section.say(
        f"Judged by {len(found['drives'])} {who}, {found['num_rounds']} rounds, in SUMO, on seeds "
        f"{found['seeds'][0]} to {found['seeds'][1]}, which the calibration has not used.",
        "validation.json: role, seeds",
    )
    if found["role"] == "fit":
        section.lack("Validation by held-out drives: these were fitted.")
    rows = []
    for one in found["criteria"]:
        if one["passes"] is None:
            section.lack(f"{one['name']} ({one['standard']}): {one['note']}")
            continue
        bound = f"{'at most' if one['is_upper'] else 'at least'} {one['limit']:.4g}"
        rows.append((one["name"], one["standard"], one["value"], bound, "pass" if one["passes"] else "fail"))
    section.show("Criteria", ("criterion", "standard", "value", "limit", ""), rows, "validation.json: criteria")
    rows = []
    for name, one in found["equivalence"].items():
        told = (name, percent(one["difference"]), _interval(one["interval_90"]), percent(one["margin"]))
        rows.append((*told, one["verdict"], one["source"]))
        if one["verdict"] == "different":
            section.say(f"{name} is known to differ by {percent(one['difference'])}.", "validation.json: equivalence")
        elif one["verdict"] != "equivalent":
            more = f"; {one['more_drives']} more would tell" if one.get("more_drives") else ""
            section.lack(f"Whether {name} is the same within {percent(one['margin'])}: not enough drives{more}.")
    columns = ("quantity", "difference", "90 % interval", "margin", "verdict", "source of the margin")
    section.show("The same within a margin", columns, rows, "validation.json: equivalence")
    return section


def gap(evidence: Evidence) -> Section:
    """What is missing in the simulation, how sure that is, and what could not have been seen."""
    found = evidence.diagnosis
    section = Section("The gap, its causes, and what was done", "Validation: uncertainty of the model's form")
    if found is None:
        section.lack("No diagnosis was run: `jaxcalib diagnose CASE --out RUN/diagnosis`.")
        return section
    names = ", ".join(name.replace("_", " ") for name in found["effects"])
    section.say(TITLES[found["verdict"]] + (f": {names}." if names else "."), "diagnosis.json: verdict, effects")
    rows = [
        (
            one["effect"].replace("_", " "),
            f"{one['probability']:.2g}",
            one["strength"],
            _bounds(one["strength_ci90"]),
        )
        for one in found["ranking"][:SHOWN_CAUSES]
    ]
    section.show("Explanations", ("explanation", "probability", "strength", "90 % interval"), rows, "diagnosis.json")
    far = found["how_far"]
    if far.get("fraction_closed") is not None:
        section.say(
            f"With it the gap on held-out drives shrinks by {far['fraction_closed']:.0%} "
            f"(90 % interval {_interval(far.get('fraction_closed_ci90'))}).",
            "diagnosis.json: how_far",
        )
    invisible = [name for name, least in found["undetectable_below"].items() if least is None]
    section.show(
        "What these drives would have shown, from which strength on",
        ("effect", "visible from"),
        [(name.replace("_", " "), least) for name, least in found["undetectable_below"].items() if least is not None],
        "diagnosis.json: undetectable_below",
    )
    if invisible:
        words = ", ".join(name.replace("_", " ") for name in invisible)
        section.lack(f"Not visible on these drives at any strength, so neither shown nor excluded: {words}.")
    for line in found["next_steps"]:
        section.lack(f"Open: {line}")
    return section


def _interval(bounds: Sequence[float] | None) -> str:
    return "-" if bounds is None else f"{percent(bounds[0])} to {percent(bounds[1])}"


def _bounds(bounds: Any) -> str:
    return "-" if not bounds else f"{bounds[0]:.3g} to {bounds[1]:.3g}"
