"""Numerical error, and what everything rests on: versions and hashes."""

import math
from collections.abc import Mapping
from typing import Any

from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section, between, searched_in, words_of
from jaxcalib.html.page import percent
from jaxcalib.runs.provenance import commit, versions
from jaxcalib.runs.run_folder import identify_program
from jaxcalib.validation.calibrated_run import SAME


def numerical_error(evidence: Evidence) -> Section:
    """What step, seeds and numbers of runs make of the results."""
    result, step_s = evidence.result, evidence.problem.parts.scenario.step_s
    section = Section("Numerical error", "Verification: code, calculation, sensitivity")
    health = result["health"]["calibrated"]
    section.say(
        f"{health['runs']} runs of the result in SUMO: {health['failed']} failed, {health['unfinished']} drives "
        f"unfinished, {health['collisions']} vehicle steps in collision, {health['teleports']} teleports, "
        f"{health['subject_overlaps']} steps of a replayed subject vehicle in another one, "
        f"{100.0 * health['backlog_share']:.2f} % of the demand not inserted.",
        "result.json: health",
    )
    if health["failed"] or health["unfinished"] or health["collisions"] or health["teleports"]:
        section.fail("Not all of SUMO's runs with the result end as they should: see its health.")
    runs, seeds = result["runs"], result["seeds"]
    section.say(
        f"The calibration made {runs['surrogate']} runs of the surrogate and {runs['sumo']} of SUMO; seeds from "
        f"{', '.join(f'{first} ({words_of(kind)})' for kind, first in seeds.items())} on.",
        "result.json: runs, seeds",
    )
    _chance_of_rounds(section, evidence)
    transfer = [
        (entry["measure"], entry["bias"], entry["bias_in_noise"])
        for entry in result["transfer"]
        if entry["bias_in_noise"] is not None and abs(entry["bias_in_noise"]) > 1.0
    ]
    columns = ("measure", "surrogate / SUMO - 1", "in units of noise")
    section.show("Where surrogate and SUMO differ by more than noise", columns, transfer, "result.json: transfer")
    for stage, screening in result["screening"].items():
        rows = [
            (entry["name"], entry["range"], entry["range_of_noise"], entry["p_value"])
            for entry in screening["parameters"]
        ]
        columns = ("parameter", "range of its effect, in accuracy", "range of noise", "p value")
        failed = f", of which {screening['cases_failed']} cases failed" if screening["cases_failed"] else ""
        where = searched_in(result["confirmation"])
        title = f"Sensitivity in {words_of(stage)}, by {screening['array']}{failed}, in {where}"
        section.show(title, columns, rows, f"result.json: screening.{stage}")
    _step(section, evidence.validation, step_s)
    section.lack("Verification of SUMO's code and of this program's: rests on their own tests and releases.")
    return section


def _chance_of_rounds(section: Section, evidence: Evidence) -> None:
    """What single rounds of drives are off by beside all together; one round says nothing of that."""
    result, num_runs = evidence.result, evidence.result["health"]["calibrated"]["runs"]
    rows = []
    for role, one in result["per_seed"]["calibrated"].items():
        pooled = result["moes"]["calibrated"].get(role, {})
        told = [
            (f"{words_of(name)}, {role.replace('_', '-')}", pooled.get(name), value)
            for name, value in one.items()
            if isinstance(value, float)
        ]
        if told and all(value is not None and math.isclose(value, alone, rel_tol=SAME) for _, value, alone in told):
            section.lack(f"Scatter of single rounds on the {role.replace('_', '-')} drives: only one round was run.")
        else:
            rows += told
    columns = ("error", "of all runs pooled", "mean of single rounds")
    section.show(f"What chance of single runs adds; {num_runs} runs", columns, rows, "result.json: moes, per_seed")


def _step(section: Section, validation: Mapping[str, Any] | None, step_s: float) -> None:
    """What the length of a step makes of the quantities."""
    found = None if validation is None else validation.get("step_error")
    if not found:
        section.lack(
            f"Error of the step of {step_s:g} s: none was made with another (`jaxcalib validate CASE RUN --half-step`)."
        )
        return
    rows = []
    for name, one in found["quantities"].items():
        told = (percent(one["difference"]), between(one["interval_90"]), percent(one["margin"]), one["verdict"])
        rows.append((name, one["half_step"], one["step"], *told))
        if one["verdict"] == "different":
            section.fail(f"{name} differs by {percent(one['difference'])} from that with half the step.")
        elif one["verdict"] != "equivalent":
            section.lack(f"Whether half the step leaves {name} the same within {percent(one['margin'])}: few rounds.")
    columns = ("quantity", f"steps of {found['half_step_s']:g} s", f"of {step_s:g} s", "difference", "90 % interval",
               "margin", "verdict")  # fmt: skip
    section.show("Half the step", columns, rows, "validation.json: step_error")


def provenance(evidence: Evidence) -> Section:
    """Versions and hashes."""
    section = Section("Versions and hashes", "M&S management: configuration, pedigree of outputs")
    result, validation = evidence.result, evidence.validation
    section.show("Versions at calibration", ("program", "version"), list(result["versions"].items()), "result.json")
    now = versions()
    for name, made in (("calibration", result), ("validation", validation)):
        if made is not None and made["versions"] != now:
            section.say(f"This dossier was written by other versions than the {name}.", f"{name}: versions")
    head = commit()
    section.say(f"This dossier was written by jaxcalib {now['jaxcalib']}, commit {head or 'unknown'}.", "the program")
    for name, made in (("calibration", result), ("validation", validation)):
        if made is None:
            continue
        made_by = made.get("commit")
        if made_by is None or made_by.endswith("-changed"):
            section.lack(
                f"The program's commit at the {name}: {made_by or 'unknown'}, so its files are not pinned by it."
            )
        else:
            section.say(f"The {name} was made by commit {made_by}.", f"{name}: commit")
    for part in ("case", "options", "program"):
        if part in evidence.identity:
            section.say(f"The calibration was begun with {part}: {evidence.identity[part]}", "RUN/run.json")
    if evidence.identity.get("program") not in (None, identify_program()):
        section.say("Program, libraries or kind of processor are not those that calibrated.", "RUN/run.json: program")
    for line in evidence.unknown:
        section.lack(line)
    section.show("Files", ("file", "SHA-256"), sorted(evidence.files.items()), "the files themselves")
    return section
