"""Commands that hand a result over: to who approves a test, and to the simulator where it runs."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from jaxcalib.cli.options import CalibratedRun, CaseFolder, Quiet, WholeNumber


def dossier(
    case: CaseFolder,
    run: CalibratedRun,
    /,
    *,
    out: Path | None = None,
    validation: Path | None = None,
    diagnosis: Path | None = None,
    statement: Path | None = None,
    quiet: Quiet = False,
) -> int:
    """Write what an assessor asks of simulated traffic into one document: evidence by heading, and what is missing.

    Leaves dossier.html and dossier.json.

    Parameters
    ----------
    out
        Folder for the document; RUN/dossier unless given.
    validation
        Folder that `jaxcalib validate` has left; RUN/validation, if there is one, unless given.
    diagnosis
        Folder that `jaxcalib diagnose` has left; RUN/diagnosis, if there is one, unless given.
    statement
        TOML file in which people say what the simulation is for (docs/dossier.md).
    """
    from jaxcalib.cli.dossier_command import run_dossier

    return run_dossier(case, run, out, validation, diagnosis, statement, quiet=quiet)


def export(
    case: CaseFolder,
    run: CalibratedRun,
    /,
    *,
    out: Path,
    to: Literal["osi", "openscenario", "fcd"] = "osi",
    drive: str | None = None,
    seed: Annotated[WholeNumber, Parameter(validator=Number(gte=0, lte=2_000_000_000))] = 0,
    range_m: Annotated[float | None, Parameter(validator=Number(gt=0))] = None,
    free_subject: Annotated[bool, Parameter(negative="")] = False,
    quiet: Quiet = False,
) -> int:
    """Run the calibrated traffic in SUMO while the subject vehicle drives, and write it for another simulator.

    Parameters
    ----------
    out
        Folder for the files.
    to
        osi: ASAM OSI ground truth (.mcap) whose host vehicle is the subject vehicle; openscenario: ASAM OpenSCENARIO
        XML (.xosc) in which every vehicle follows its trajectory, with the road (.xodr); fcd: SUMO's floating car data.
    drive
        Drive whose departure the subject vehicle has; the first held-out one unless given.
    seed
        Seed of SUMO.
    range_m
        Of openscenario: other vehicles are there while they are so near to the subject vehicle; all unless given.
    free_subject
        Of openscenario: the subject vehicle, Ego, has no trajectory, for the vehicle under test drives it.
    """
    from jaxcalib.cli.export_command import run_export

    return run_export(case, run, out, to, drive, seed, range_m, free_subject=free_subject, quiet=quiet)
