"""Writes what a calibration leaves in RUN."""

import shutil

from jaxcalib.calibration.record import CalibrationRecord
from jaxcalib.calibration.result.report import report_html
from jaxcalib.calibration.result.result import CalibrationResult, to_json
from jaxcalib.runs.disk import writing_to
from jaxcalib.runs.run_folder import RunFolder
from sim_adapters.activity import Activity, doing
from sim_adapters.scenario.scenario_writer import write_scenario


@doing(Activity.REPORT)
def write_outputs(record: CalibrationRecord, result: CalibrationResult, run_folder: RunFolder) -> None:
    """Write result.json, report.html and scenario/."""
    with writing_to(run_folder.path):
        write_calibrated_scenario(record, result, run_folder)
    run_folder.write_text("report.html", report_html(record, result))
    run_folder.write_text("result.json", to_json(result))


def write_calibrated_scenario(record: CalibrationRecord, result: CalibrationResult, run_folder: RunFolder) -> None:
    """Write the calibrated scenario as SUMO files; the folder is there as a whole or not at all."""
    problem = record.problem
    draft, folder = run_folder.path / ".scenario.draft", run_folder.path / "scenario"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    space = record.initial.space
    values = space.values_of(record.confirmation.best[None])[0]
    seeds = ", ".join(f"{name} from {seed}" for name, seed in record.search_seeds.items())
    write_scenario(
        problem.scenario,
        problem.layout,
        tuple(float(value) for value in values),
        problem.drive_starts("fit")[0].depart_s,
        problem.parts.subject.vehicle,
        draft,
        is_handed_over=True,
        comments={name: _comment(result, name) for name in problem.layout.names[problem.layout.num_inputs :]},
        head=f"calibrated by jaxcalib {result.versions['jaxcalib']}; seeds: {seeds}",
    )
    shutil.rmtree(folder, ignore_errors=True)
    draft.replace(folder)


def _comment(result: CalibrationResult, name: str) -> str:
    one = result.parameter_table[name]
    interval = f"90 % interval {one.lower:g} to {one.upper:g}" if one.lower is not None else "not identified"
    return f"was {one.scenario:g}, now {one.value:g} {one.unit}, {interval}"
