"""The few lines that a person wants to read first."""

from pathlib import Path

from jaxcalib.diagnosis.answer.answer import Diagnosis

SHOWN = 6
REPORT = "diagnosis.html"


def summary(diagnosis: Diagnosis, out: Path) -> str:
    """Return them."""
    effects = f": {', '.join(diagnosis.effects)}" if diagnosis.effects else ""
    lines = ["", f"{diagnosis.verdict.replace('_', ' ')}{effects}", diagnosis.reason, ""]
    lines.append(f"{'explanation':26s}{'probability':>12s}{'strength':>12s}")
    for one in diagnosis.ranking[:SHOWN]:
        strength = "" if one.strength is None else f"{one.strength:12.3g}"
        lines.append(f"{one.effect:26s}{one.probability:12.2f}{strength}")
    far = diagnosis.how_far
    if far.get("gap_recalibrated") is not None:
        before = "its runs failed" if far["gap_default"] is None else f"{far['gap_default']:.2f}"
        lines += ["", "gap on held-out drives, in noise: "
                  f"scenario as it is {before}, recalibrated {far['gap_recalibrated']:.2f}, "
                  f"with the effect {far['gap_with_effect']:.2f}, chance alone {far['noise_floor']:.2f}"]  # fmt: skip
    lines += [f"warning: {line}" for line in diagnosis.warnings]
    if (out / REPORT).is_file():
        lines += ["", f"report: {out / REPORT}"]
    return "\n".join(lines)
