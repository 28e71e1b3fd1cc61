"""What is missing in the simulation, how sure that is, and what could not have been seen."""

from jaxcalib.diagnosis.answer.report import TITLES
from jaxcalib.dossier.evidence import Evidence
from jaxcalib.dossier.section import Section, between, number_range, words_of

SHOWN_CAUSES = 5
FOUND = ("effect", "pair", "class", "unknown")  # verdicts by which the calibrated simulation is not the road


def gap(evidence: Evidence) -> Section:
    """What a diagnosis found; without one, that there is none."""
    found = evidence.diagnosis
    section = Section("The gap, its causes, and what was done", "Validation: uncertainty of the model's form")
    if found is None:
        section.lack("No diagnosis was run: `jaxcalib diagnose CASE --out RUN/diagnosis`.")
        return section
    names = ", ".join(words_of(name) for name in found["effects"])
    verdict = TITLES[found["verdict"]] + (f": {names}." if names else ".")
    section.say(verdict, "diagnosis.json: verdict, effects")
    if found["verdict"] in FOUND:
        section.fail(verdict)
    rows = [
        (words_of(one["effect"]), f"{one['probability']:.2g}", one["strength"], number_range(one["strength_ci90"]))
        for one in found["ranking"][:SHOWN_CAUSES]
    ]
    columns = ("explanation", "probability", "strength, in the effect's unit", "90 % interval")
    section.show("Explanations", columns, rows, "diagnosis.json")
    far = found["how_far"]
    if far.get("fraction_closed") is not None:
        section.say(
            f"With it the gap on held-out drives shrinks by {far['fraction_closed']:.0%} "
            f"(90 % interval {between(far.get('fraction_closed_ci90'))}).",
            "diagnosis.json: how_far",
        )
    invisible = [name for name, least in found["undetectable_below"].items() if least is None]
    section.show(
        "What these drives would have shown, from which strength on",
        ("effect", "visible from, in its unit"),
        [(words_of(name), least) for name, least in found["undetectable_below"].items() if least is not None],
        "diagnosis.json: undetectable_below",
    )
    if invisible:
        words = ", ".join(words_of(name) for name in invisible)
        section.lack(f"Not visible on these drives at any strength, so neither shown nor excluded: {words}.")
    for line in found["next_steps"]:
        section.lack(f"Open: {line}")
    return section
