"""One run of the calibrated traffic around the subject vehicle, written for another simulator."""

import gzip
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Literal

from jaxcalib.case.case import Drive
from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.errors import CaseError
from jaxcalib.exporters.recorded_run import RecordedRun
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.disk import check_out, check_outside, writing_to
from jaxcalib.validation.calibrated_run import read_calibrated_run
from sim_adapters.errors import ScenarioError
from sim_adapters.sumo.trajectories import record_trajectories
from surrogate.subject.registry import VTYPE

Format = Literal["osi", "openscenario", "fcd"]
Write = Callable[[RecordedRun], list[str]]
LONGEST_RUN_S = 3600.0


def export(
    case: Path | str,
    run: Path | str,
    out: Path | str,
    *,
    to: Format = "osi",
    drive: str | None = None,
    seed: int = 0,
    range_m: float | None = None,
    free_subject: bool = False,
) -> list[str]:
    """Run a calibrated scenario in SUMO while the subject vehicle drives, and write its traffic into a folder.

    Args:
        case: the case's folder.
        run: RUN, the folder that the calibration has left.
        out: folder for the files.
        to: `osi`, an ASAM OSI trace of ground truth (.mcap) whose host vehicle is the subject vehicle; `openscenario`,
            an ASAM OpenSCENARIO XML scenario (.xosc) of trajectories in which the subject vehicle is `Ego`, with the
            road as ASAM OpenDRIVE (.xodr) beside it; or `fcd`, SUMO's floating car data (.xml.gz).
        drive: the drive whose departure the subject vehicle has; the first held-out one, or the first, unless given.
        seed: of SUMO.
        range_m: of `openscenario`: other vehicles are there while they are so near to the subject vehicle; None for
            all of them.
        free_subject: of `openscenario`: the subject vehicle is given place and speed at the beginning and no
            trajectory, for the vehicle under test drives it.

    Returns:
        One line for each thing that was written or is missing.

    Raises:
        CaseError: case, RUN, drive or folder are wrong, the subject vehicle has a driver of its own, what a format
            needs is not installed, or SUMO ends the run.
        ResourceError: the disk is full.
    """
    folder = Path(out)
    check_outside(folder, Path(case))
    check_out(folder)
    write = _writer(to, range_m, free_subject)
    problem = read_problem(case)
    calibrated = read_calibrated_run(Path(run), problem)
    chosen = _drive(problem, drive)
    _check_subject(problem, free_subject=free_subject)
    name = f"{problem.case.name}_{chosen.id}_{seed}"
    with writing_to(folder), tempfile.TemporaryDirectory(prefix="jaxcalib-") as scratch, ExitStack() as stack:
        folder.mkdir(parents=True, exist_ok=True)
        draft = stack.enter_context(tempfile.TemporaryDirectory(prefix=".export-", dir=folder))
        fcd = Path(draft if to == "fcd" else scratch) / f"{name}.fcd.xml.gz"
        subject = problem.parts.subject.vehicle
        try:
            vehicles = record_trajectories(
                problem.scenario, problem.layout, calibrated.values, chosen.depart_s, subject,
                problem.parts.scenario.duration_s, seed, fcd, LONGEST_RUN_S,
            )  # fmt: skip
            if subject not in vehicles:
                why = f"expected '{subject}' to find room on its first edge; the run ends before."
                raise CaseError(problem.scenario.configuration.file, "", why)
            said = write(RecordedRun(problem, fcd, vehicles, Path(draft), name))
            for file in sorted(Path(draft).iterdir()):  # whole, or not at all
                file.replace(folder / file.name)
            said = [line.replace(draft, str(folder)) for line in said]
        except ScenarioError as error:
            raise CaseError(error.file, "", error.message) from None
    if problem.parts.behaviour.distant_vtypes:
        said = [*said, "warning: behaviour.distant_vtypes: in plain SUMO nobody changes over, so not here."]
    return [*said, *(f"warning: {line}" for line in calibrated.warnings)]


def _check_subject(problem: CalibrationProblem, *, free_subject: bool) -> None:
    """Refuse to write a drive of the subject vehicle that plain SUMO makes instead of the case's own driver.

    Raises:
        CaseError: another model than its vType drives it, and its drive would be written.
    """
    model = problem.parts.subject.model.name
    if model != VTYPE and not free_subject:
        expected = (
            f'expected model = "{VTYPE}", got "{model}": an export is made by plain SUMO. Leave the subject vehicle to '
            "the vehicle under test: --to openscenario --free-subject."
        )
        raise CaseError(FILE_NAME, "subject.model", expected)


def _writer(to: Format, range_m: float | None, free_subject: bool) -> Write:
    """What writes a format; its packages are asked for before SUMO runs."""
    if to != "openscenario" and (range_m is not None or free_subject):
        option = "--free-subject" if free_subject else "--range-m"
        raise CaseError("command line", option, f"expected with --to openscenario alone, got --to {to}.")
    try:
        if to == "osi":
            from jaxcalib.exporters.osi_ground_truth import export_ground_truth

            return export_ground_truth
        if to == "openscenario":
            from jaxcalib.exporters.open_scenario import export_open_scenario

            return partial(export_open_scenario, range_m=range_m, has_free_subject=free_subject)
    except ModuleNotFoundError as error:
        todo = f"expected the package {error.name}, which is not installed: pip install 'jaxcalib[{to}]'"
        raise CaseError("command line", f"--to {to}", todo) from None
    return _leave_fcd


def _leave_fcd(recorded: RecordedRun) -> list[str]:
    with gzip.open(recorded.fcd, "rb") as stream:  # a kind is known of those that left before it begins, too
        number = len({one.get("id") for _, one in ET.iterparse(stream) if one.tag == "vehicle"})
    return [f"{recorded.fcd}: {number} vehicles, SUMO's floating car data; the network is the scenario's."]


def _drive(problem: CalibrationProblem, name: str | None) -> Drive:
    drives = problem.case.drives
    if name is None:
        return next((drive for drive in drives if drive.role == "held_out"), drives[0])
    chosen = next((drive for drive in drives if drive.id == name), None)
    if chosen is None:
        there = ", ".join(drive.id for drive in drives)
        raise CaseError("command line", "--drive", f"expected one of {there}, got '{name}'.")
    return chosen
