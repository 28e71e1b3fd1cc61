"""Fills the report's template."""

from markupsafe import Markup

from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.result import figures
from jaxcalib.calibration.result.result import CalibrationResult
from jaxcalib.html.page import percent, render_page

TEMPLATE = "calibration.html.j2"


def report_html(record: CalibrationRecord, result: CalibrationResult) -> str:
    """Return the report: one file without scripts or anything from outside."""
    roles = [role for role in ("held_out", "fit") if result.moes["calibrated"].get(role)]
    problem = record.problem
    return render_page(
        TEMPLATE,
        case=problem.case,
        result=result,
        seed=record.seed,
        roles=roles,
        num_fit=len(problem.drive_starts("fit")),
        num_held_out=len(problem.drive_starts("held_out")),
        verdict=verdict(result, roles[0]),
        drift=_drift(result),
        drives=problem.drives,
        errors={role: Markup(figures.errors_figure(result, role)) for role in roles},
        parameters=Markup(figures.parameters_figure(record, result)),
        measures=Markup(figures.measures_figure(record)),
        screening=Markup(figures.screening_figure(result.screening["stage2"])),
        course=Markup(figures.course_figure(record)),
        timing=Markup(figures.timing_figure(result)),
        interval=lambda bounds: "" if bounds is None else f"{percent(bounds[0])} to {percent(bounds[1])}",
        number=lambda value: f"{value:.5g}",
    )


def verdict(result: CalibrationResult, role: str) -> str:
    """Return the result in one sentence or two."""
    before = result.vehicle_level_error["no_calibration"][role]["value"]
    after = result.vehicle_level_error["calibrated"][role]["value"]
    floor = result.vehicle_level_error["noise_floor"][role]["value"]
    drives = "drives that the calibration never saw" if role == "held_out" else "fitted drives (none was held out)"
    sentence = f"On {drives} the vehicle-level error in SUMO goes from {percent(before)} to {percent(after)}"
    if before and after is not None:
        sentence += f" ({after / before - 1.0:+.0%})"
    if floor is None or after is None:
        return sentence + "."
    above = [
        name.replace("_", " ")
        for name, error in result.moes["calibrated"][role].items()
        if error is not None and error > (result.noise_floor_high[role].get(name) or 0.0)
    ]
    sentence += f"; two sets of drives that differ in nothing but chance are {percent(floor)} apart."
    worse = [
        name.replace("_", " ")
        for name, change in result.change[role].items()
        if change["interval_90"] and change["interval_90"][0] > 0.0
    ]
    if worse:
        sentence += f" Worse than before calibration, beyond noise: {', '.join(worse)}."
    return sentence + (
        f" Beyond what chance explains lie: {', '.join(above)}."
        if above
        else " No single error lies beyond what chance explains."
    )


def _drift(result: CalibrationResult) -> str:
    stage_1, stage_2, polished = result.confirmation["flow_accuracy_stage1_stage2_polish"]
    undid = result.confirmation["stage2_undid_stage1"]
    return (
        f"Accuracy of the traffic flow after Stage 1: {stage_1:.3f}, after Stage 2: {stage_2:.3f}, after the joint "
        f"polish: {polished:.3f}. Stage 2 {'has' if undid else 'has not'} undone Stage 1 beyond noise."
    )
