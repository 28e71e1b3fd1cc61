"""Numerical error, and what everything rests on: versions and hashes."""

from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section
from jaxcalib.html.page import percent
from jaxcalib.runs.provenance import commit, versions


def numerical_error(evidence: Evidence) -> Section:
    """What step, seeds and numbers of runs make of the results."""
    result, step_s = evidence.result, evidence.problem.parts.scenario.step_s
    section = Section("Numerical error", "Verification: code, calculation, sensitivity")
    health = result["health"]["calibrated"]
    section.say(
        f"{health['runs']} runs of the result in SUMO: {health['failed']} failed, {health['collisions']} vehicle steps "
        f"in collision, {health['teleports']} teleports, {percent(health['backlog_share'])} not inserted.",
        "result.json: health",
    )
    runs = result["runs"]
    section.say(
        f"The calibration made {runs['surrogate']} runs of the surrogate and {runs['sumo']} of SUMO.",
        "result.json: runs",
    )
    rows = []
    for role, one in result["per_seed"]["calibrated"].items():
        pooled = result["moes"]["calibrated"].get(role, {})
        rows += [
            (f"{name.replace('_', ' ')}, {role.replace('_', '-')}", pooled.get(name), value)
            for name, value in one.items()
            if isinstance(value, float)
        ]
    columns = ("error", "of all runs pooled", "mean of single rounds")
    section.show("What chance of single runs adds", columns, rows, "result.json: moes, per_seed")
    transfer = [
        (entry["measure"], entry["bias"], entry["bias_in_noise"])
        for entry in result["transfer"]
        if entry["bias_in_noise"] is not None and abs(entry["bias_in_noise"]) > 1.0
    ]
    columns = ("measure", "surrogate / SUMO - 1", "in units of noise")
    section.show("Where surrogate and SUMO differ by more than noise", columns, transfer, "result.json: transfer")
    rows = [
        (stage, entry["name"], entry["range"], entry["range_of_noise"], entry["p_value"])
        for stage, screening in result["screening"].items()
        for entry in screening["parameters"]
    ]
    columns = ("stage", "parameter", "range of its effect", "range of noise", "p value")
    section.show("Sensitivity, by orthogonal arrays", columns, rows, "result.json: screening")
    section.lack(f"Error of the step: no run was made with a step other than {step_s:g} s.")
    section.lack("Verification of SUMO's code: rests on its own tests and releases.")
    return section


def provenance(evidence: Evidence) -> Section:
    """Versions and hashes."""
    section = Section("Versions and hashes", "M&S management: configuration, pedigree of outputs")
    section.show(
        "Versions at calibration", ("program", "version"), list(evidence.result["versions"].items()), "result.json"
    )
    now = versions()
    if now != evidence.result["versions"]:
        section.say("This dossier was written by other versions than the calibration.", "result.json: versions")
    head = commit()
    section.say(f"Written by jaxcalib {now['jaxcalib']}, commit {head or 'unknown'}.", "the program")
    section.show("Files", ("file", "SHA-256"), sorted(evidence.files.items()), "the files themselves")
    if head is None or head.endswith("-changed"):
        section.lack("The commit of the program: it has none, or its files differ from it.")
    return section
