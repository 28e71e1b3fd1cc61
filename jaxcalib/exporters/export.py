"""One run of the calibrated traffic around the subject vehicle, written for another simulator."""

import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Literal

from jaxcalib.case.case import Drive
from jaxcalib.errors import CaseError
from jaxcalib.exporters.plane import Plane
from jaxcalib.field.route_geometry import build_route_geometry
from jaxcalib.importers.sumo_fcd import slices_in
from jaxcalib.importers.trajectories import Slice
from jaxcalib.problem.problem import CalibrationProblem, read_problem
from jaxcalib.runs.disk import check_out, check_outside, writing_to
from jaxcalib.validation.calibrated_run import read_calibrated_run
from sim_adapters.errors import ScenarioError
from sim_adapters.sumo.trajectories import VehicleKind, record_trajectories

Format = Literal["osi", "fcd"]
WriteGroundTruth = Callable[[Path, Iterable[Slice], Mapping[str, VehicleKind], str, Plane], int]
LONGEST_RUN_S = 3600.0


def export(
    case: Path | str, run: Path | str, out: Path | str, *, to: Format = "osi", drive: str | None = None, seed: int = 0
) -> list[str]:
    """Run a calibrated scenario in SUMO while the subject vehicle drives, and write its traffic into a folder.

    Args:
        case: the case's folder.
        run: RUN, the folder that the calibration has left.
        out: folder for the file.
        to: `osi`, an ASAM OSI trace of ground truth (.mcap) whose host vehicle is the subject vehicle; or `fcd`, SUMO's
            floating car data (.xml.gz).
        drive: the drive whose departure the subject vehicle has; the first held-out one, or the first, unless given.
        seed: of SUMO.

    Returns:
        One line for each thing that was written.

    Raises:
        CaseError: case, RUN, drive or folder are wrong, what a format needs is not installed, or SUMO ends the run.
        ResourceError: the disk is full.
    """
    folder = Path(out)
    check_outside(folder, Path(case))
    check_out(folder)
    write_osi = _osi_writer() if to == "osi" else None
    problem = read_problem(case)
    calibrated = read_calibrated_run(Path(run), problem)
    chosen = _drive(problem, drive)
    name = f"{problem.case.name}_{chosen.id}_{seed}"
    with writing_to(folder), tempfile.TemporaryDirectory(prefix="jaxcalib-") as scratch:
        folder.mkdir(parents=True, exist_ok=True)
        fcd = (folder if write_osi is None else Path(scratch)) / f"{name}.fcd.xml.gz"
        subject = problem.parts.subject.vehicle
        try:
            vehicles = record_trajectories(
                problem.scenario, problem.layout, calibrated.values, chosen.depart_s, subject,
                problem.parts.scenario.duration_s, seed, fcd, LONGEST_RUN_S,
            )  # fmt: skip
        except ScenarioError as error:
            raise CaseError(error.file, "", error.message) from None
        if write_osi is None:
            return [f"{fcd}: {len(vehicles)} vehicles, SUMO's floating car data; the network is the scenario's."]
        geometry = build_route_geometry(problem.scenario.row_map)
        projection = geometry.projection.srs if geometry.has_projection else None
        file = folder / f"{name}.mcap"
        number = write_osi(file, slices_in(fcd)(), vehicles, subject, Plane(projection, geometry.net_offset_m))
        return [f"{file}: {number} messages of ASAM OSI ground truth; the host vehicle is '{subject}'."]


def _osi_writer() -> WriteGroundTruth:
    try:
        from jaxcalib.exporters.osi_ground_truth import write_ground_truth
    except ModuleNotFoundError as error:
        todo = f"expected the package {error.name}, which is not installed: pip install 'jaxcalib[osi]'"
        raise CaseError("command line", "--to osi", todo) from None
    return write_ground_truth


def _drive(problem: CalibrationProblem, name: str | None) -> Drive:
    drives = problem.case.drives
    if name is None:
        return next((drive for drive in drives if drive.role == "held_out"), drives[0])
    chosen = next((drive for drive in drives if drive.id == name), None)
    if chosen is None:
        there = ", ".join(drive.id for drive in drives)
        raise CaseError("command line", "--drive", f"expected one of {there}, got '{name}'.")
    return chosen
