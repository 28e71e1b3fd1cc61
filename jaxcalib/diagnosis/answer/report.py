"""Fills the template of the diagnosis' report."""

from markupsafe import Markup

from jaxcalib.diagnosis.answer import figures
from jaxcalib.diagnosis.answer.answer import Diagnosis
from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.html.page import render_page
from surrogate.effects.registry import EFFECTS, effect_named

TEMPLATE = "diagnosis.html.j2"
TITLES = {
    "no_gap": "No gap beyond noise",
    "miscalibrated": "The scenario was miscalibrated; nothing else is missing that these drives could show",
    "effect": "One effect is missing in the simulation",
    "pair": "Something is missing: two effects",
    "class": "Something is missing; these drives cannot tell which of these it is",
    "unknown": "Something is missing that is none of the known effects",
    "not_testable": "These drives do not allow an answer",
}
SHOWN_ENTRIES = 15


def report_html(findings: Findings, diagnosis: Diagnosis) -> str:
    """Return the report: one file without scripts or anything from outside."""
    ledger = findings.ledger()
    return render_page(
        TEMPLATE,
        case=findings.problem.case,
        seed=findings.seed,
        num_fit=len(findings.fitted.tallies),
        num_held_out=len(findings.held_out.tallies) if findings.held_out else 0,
        diagnosis=diagnosis,
        title=TITLES[diagnosis.verdict],
        titles={effect.name: effect.title for effect in EFFECTS},
        sentences=sentences(diagnosis),
        map=Markup(figures.map_figure(ledger)),
        places=Markup(figures.place_figure(ledger)),
        lanes=Markup(figures.lanes_figure(ledger)),
        ranking=Markup(figures.ranking_figure(diagnosis)),
        waterfall=Markup(figures.waterfall_figure(diagnosis)),
        entries=[(entry.cell.words, entry) for entry in ledger[:SHOWN_ENTRIES]],
        power=power_lines(diagnosis),
        number=lambda value: "-" if value is None else f"{value:.3g}",
    )


def sentences(diagnosis: Diagnosis) -> list[str]:
    """The findings in whole sentences."""
    lines = [diagnosis.reason]
    by_name = {entry.effect: entry for entry in diagnosis.ranking}
    for name in diagnosis.effects:
        entry, effect = by_name[name], effect_named(name)
        if entry.strength is None or entry.strength_ci90 is None:
            continue
        low, high = entry.strength_ci90
        text = f"{name.replace('_', ' ')} ({effect.title}): strength {entry.strength:.3g}, "
        text += f"between {low:.3g} and {high:.3g}, in {effect.unit}."
        setting = entry.place_and_time
        if "route_from_m" in setting:
            text += f" At {setting['route_from_m']:.0f} to {setting['route_to_m']:.0f} m of the route"
            text += (
                f", {setting['time_from_s']:.0f} to {setting['time_to_s']:.0f} s." if "time_from_s" in setting else "."
            )
        if entry.absorption is not None and entry.absorption > 0.5:
            text += f" A calibration without it would hide {entry.absorption:.0%} of it in other parameters."
        lines.append(text)
    far = diagnosis.how_far
    if far.get("fraction_closed") is not None:
        share = f"{far['fraction_closed']:.0%}"
        what = "both" if diagnosis.verdict == "pair" else "it"
        text = f"On drives that nothing was fitted to, adding {what} closes {share} of the gap above noise"
        if far.get("fraction_closed_ci90"):
            low, high = far["fraction_closed_ci90"]
            text += f" (90 % interval {low:.0%} to {high:.0%})"
        lines.append(text + ".")
    return lines


def power_lines(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return for each effect what these drives could have shown."""
    lines = []
    for name, least in diagnosis.undetectable_below.items():
        effect = effect_named(name)
        more = diagnosis.visible_with_three_more_drives.get(name)
        if least is None:
            text = "could not be seen on these drives at any strength in its range"
            text += f"; three more drives would show {more:.3g}" if more is not None else ""
        else:
            text = f"below {least:.3g} it could not be seen on these drives"
            text += f"; three more would show {more:.3g}" if more is not None and more < 0.98 * least else ""
        lines.append((name, f"{text} ({effect.unit})"))
    return lines
