"""What a user should know of a diagnosis beside its answer: what could not be judged, and what to be careful of."""

from collections.abc import Mapping
from typing import Any

from jaxcalib.diagnosis.answer.findings import Findings
from jaxcalib.diagnosis.inference.atlas import told_by_parameters
from jaxcalib.diagnosis.inference.baseline import FAR_STEPS
from jaxcalib.diagnosis.inference.ledger import parameter_shift
from jaxcalib.diagnosis.inference.verdict import Verdict
from jaxcalib.problem.problem import CalibrationProblem
from surrogate.effects.base import SearchedAt
from surrogate.effects.registry import EFFECTS

FEW_DRIVES = 3
MANY_FLOORS = 4.0  # gaps of null cases on four held-out drives are 1 to 2 floors


def not_testable(findings: Findings) -> dict[str, str]:
    """Return the effects that could not be judged, each with the reason."""
    reasons = {}
    tested = {explanation.name for explanation in findings.explained}
    for effect in EFFECTS:
        if effect.name in tested:
            continue
        if told := told_by_parameters(effect, findings.problem.layout):
            reasons[effect.name] = f"{' and '.join(told)}, calibrated, is all that it is: what differs is a value"
        elif effect.is_calibrated:
            reasons[effect.name] = "the scenario has no ramp whose inflow is an input"
        elif effect.searched_at is not SearchedAt.EVERYWHERE:
            reasons[effect.name] = "at no place and time do the drives depart from the simulation in its direction"
        else:
            reasons[effect.name] = "its runs failed: drivers with it collide on this road, or fill it"
    return reasons


def unexplained(verdict: Verdict, how_far: Mapping[str, Any]) -> list[str]:
    """Return a warning where held-out drives show a gap that the drives to fit do not."""
    gap, floor = how_far.get("gap_recalibrated"), how_far.get("noise_floor")
    if verdict.effects or verdict.kind == "unknown" or gap is None or floor is None or gap < MANY_FLOORS * floor:
        return []
    return [
        f"the held-out drives depart from the calibrated simulation by {gap / floor:.0f} times what chance does, the "
        "drives to fit do not: jams that come on some days only, or an effect that shows on those days only; more "
        "drives would tell."
    ]


def aliased_effects(problem: CalibrationProblem) -> tuple[str, ...]:
    """Return the effects that cannot be told apart because place and time go together.

    So it is where all drives to fit depart at once, for they alone are judged.
    """
    if len({drive.depart_s for drive in problem.case.drives if drive.role == "fit"}) > 1:
        return ()
    return tuple(effect.name for effect in EFFECTS if effect.has_place or effect.has_time)


def warnings_of(findings: Findings) -> list[str]:
    """Warnings about drives and calibration."""
    warnings = list(findings.problem.warnings())
    num_drives = len(findings.fitted.tallies)
    if num_drives < FEW_DRIVES:
        warnings.append(
            f"case.toml: {num_drives} drives to fit; effects at one place, at one time and in memory look alike on so "
            "few, so the answer is a set."
        )
    shift = parameter_shift(findings.fitted.difference, findings.fitted.null)
    far = [name for name, steps in zip(findings.problem.layout.names, shift, strict=True) if abs(steps) > FAR_STEPS]
    if far:
        warnings.append(
            f"{', '.join(far)}: the features would move them farther than logs allow; an effect may bend them, and "
            "slopes may be too coarse there."
        )
    if findings.moved:
        otherwise = findings.instead_of.replace("_", " ")
        warnings.append(
            f"{', '.join(findings.moved)}: no log shows them by itself; they were moved to where the whole road "
            "behaves like the drives. Others may do as well: they explain the gap, and are no measurement."
            + (f" Where they were, the best explanation was: {otherwise}." if otherwise else "")
        )
    if findings.held_out is None:
        has_any = any(drive.role == "held_out" for drive in findings.problem.case.drives)
        why = "too little is seen of the drives that are held out" if has_any else "no drive is held out"
        warnings.append(f"case.toml: {why}; how far the gap shrinks is not told.")
    aliased = aliased_effects(findings.problem)
    if aliased:
        words = ", ".join(name.replace("_", " ") for name in aliased)
        warnings.append(
            "case.toml: all drives to fit depart at the same time, so place and time go together: none of these is "
            f"named alone: {words}."
        )
    return warnings
