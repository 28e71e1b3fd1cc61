"""Parameters with their intervals, and errors before and after."""

from collections.abc import Mapping
from typing import Any

from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section, between, searched_in, words_of
from jaxcalib.html.page import percent
from jaxcalib.measures.registry import safety_measures

ROLES = ("held_out", "fit")


def calibration(evidence: Evidence) -> Section:
    """What was found, how sure that is, and by how much errors fell."""
    section = Section("Calibration and its uncertainty", "Validation: uncertainty of inputs and parameters")
    _parameters(section, evidence.result)
    for role in ROLES:
        _errors(section, evidence.result, role)
        _safety(section, evidence.result["mops"], role)
    section.lack("What errors of the logged places and speeds do to the parameters: their intervals rest on the logs.")
    return section


def _parameters(section: Section, result: Mapping[str, Any]) -> None:
    rows, open_ones = [], []
    for name, entry in result["parameter_table"].items():
        lower, upper = entry["lower"], entry["upper"]
        told = "" if lower is None else f"{lower:.4g} to {upper:.4g}"
        rows.append((name, entry["scenario"], entry["value"], told, entry["unit"], entry["source"]))
        if entry["at_bound"]:
            open_ones.append(f"{name} (at its bound)")
        elif entry.get("is_identified") is False:  # results of older programs do not say it
            open_ones.append(f"{name} (interval as wide as half of its range)")
    columns = ("parameter", "scenario", "calibrated", "90 % interval", "unit", "where its first value came from")
    title = f"Parameters; intervals by logs and {searched_in(result['confirmation'])}"
    section.show(title, columns, rows, "result.json: parameter_table")
    if open_ones:
        section.lack(f"Not identified by these logs: {', '.join(open_ones)}.")


def _errors(section: Section, result: Mapping[str, Any], role: str) -> None:
    drives = f"{role.replace('_', '-')} drives"
    before, after = (result["moes"][kind].get(role, {}) for kind in ("no_calibration", "calibrated"))
    floor, high = result["moes"]["noise_floor"].get(role, {}), result["noise_floor_high"].get(role, {})
    intervals = result["intervals"]["calibrated"].get(role, {})
    rows = [
        (
            words_of(name),
            percent(before.get(name)),
            percent(value),
            between(intervals.get(name)),
            percent(floor.get(name)),
            percent(high.get(name)),
        )
        for name, value in after.items()
    ]
    columns = ("error", "before", "after", "90 % interval", "chance, mean", "chance, 95 %")
    section.show(f"Errors on the {drives}", columns, rows, "result.json: moes, intervals")
    known = {name: value for name, value in after.items() if None not in (value, high.get(name))}
    above = [words_of(name) for name, value in known.items() if value > high[name]]
    if above:
        section.fail(f"Errors beyond chance on the {drives}: {', '.join(above)}.")
    blind = [words_of(name) for name in known if high[name] >= 1.0]
    if blind:
        section.lack(f"Too few events on the {drives} to tell an error of 100 % from chance: {', '.join(blind)}.")


def _safety(section: Section, mops: Any, role: str) -> None:
    """Tails of traffic, which nothing was fitted to."""
    drives = f"{role.replace('_', '-')} drives"
    field, simulated = (mops[source].get(role, {}) for source in ("field", "sumo"))
    rows = [(name, field.get(name), simulated.get(name)) for name in safety_measures() if name in field]
    section.show(f"Safety measures on the {drives}", ("measure", "field", "simulated"), rows, "result.json: mops")
    if not rows:
        section.lack(f"Safety measures on the {drives}: this result was made without them.")
