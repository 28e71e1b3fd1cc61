"""Commands that make cases and look at them."""

import sys
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from jaxcalib.case.case_file import CHECK_PAGE
from jaxcalib.cli.options import WholeNumber
from jaxcalib.importers.registry import IMPORTERS


def check(case: Path, /, *, out: Path | None = None) -> int:
    """Say how well the surrogate can follow a case's scenario, part by part, before any long work.

    Parts that it cannot follow are left to SUMO alone: calibrate then searches in SUMO. Leaves a page that shows what
    was understood of the logs.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        The page to write; CASE/check.html unless given.
    """
    from jaxcalib.check.scenario_check import CaseCheck, check_case
    from jaxcalib.cli.check_table import leave_page, print_check
    from jaxcalib.cli.guarded import guarded

    found: list[CaseCheck] = []

    def work() -> str:
        found.append(check_case(case))
        return ""

    if code := guarded(work, "nothing was changed.", names_all=True):
        return code
    code, page = print_check(found[0]), out or case / CHECK_PAGE
    is_asked_for = out is not None
    return guarded(lambda: leave_page(found[0], page, is_asked_for=is_asked_for), "no figure was written.") or code


def import_(
    form: Literal[tuple(IMPORTERS)],  # pyright: ignore[reportInvalidTypeForm]
    source: Path,
    /,
    *,
    out: Path,
    scenario: Path | None = None,
    subject: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (),
    probes: Annotated[WholeNumber, Parameter(validator=Number(gte=1, lte=1000))] = 8,
    range_m: Annotated[float | None, Parameter(validator=Number(gt=0, lte=1000))] = None,
    occlusion: Annotated[bool, Parameter(negative="")] = False,
    begin_s: Annotated[float | None, Parameter(validator=Number(gte=0, lte=1e7))] = None,
    mapping: Path | None = None,
    crs: str | None = None,
) -> int:
    """Make a case of a recording in another format, and check it.

    Traffic seen from above becomes logs as chosen vehicles would have recorded them. Where the recording shows a
    straight road and no scenario is given, one is made of it.

    Parameters
    ----------
    form
        Format of the recording (docs/import.md).
    source
        File or folder of the recording.
    out
        Folder for the case; it must be empty or not there yet.
    scenario
        SUMO configuration (.sumocfg) of the road.
    subject
        Ids of the vehicles that are taken for subject vehicles; chosen by the program unless given.
    probes
        How many are chosen in each recording.
    range_m
        Range of their sensors, ahead and behind; 150 m, or less on a short stretch.
    occlusion
        Vehicles that are hidden behind others are not seen.
    begin_s
        When the recording begins, on the scenario's clock; 600 s, or the recording's own clock if it is the scenario's.
    mapping
        TOML file with the names that the format leaves open: columns, topics (docs/import.md).
    crs
        Coordinate reference system of places, for example EPSG:2229, where the format leaves it open.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.importers.import_case import import_case
    from jaxcalib.importers.importer import ImportOptions

    options = ImportOptions(subject, probes, range_m, occlusion, begin_s, mapping, crs, scenario)

    def work() -> str:
        return "\n".join([*import_case(form, source, out, options), f"{out / 'case.toml'} is written."])

    if code := guarded(work, "nothing was written."):
        return code
    if code := check(out):
        print(
            f"jaxcalib: {out} is kept, with {out / CHECK_PAGE}: mend it, or remove it and import again.",
            file=sys.stderr,
        )
    return code


def new(
    case: Path,
    /,
    *,
    scenario: Path,
    drive: Annotated[tuple[tuple[Path, Path], ...], Parameter(consume_multiple=True, negative="")],
    subject: str | None = None,
    log: Path | None = None,
) -> int:
    """Make a case of a SUMO scenario and logs, which stay where they are, and check it.

    Writes case.toml, with a comment at each line that is a guess. Where the scenario has no subject vehicle, one is
    added along the logged route, in a route file and a configuration of the case's own.

    Parameters
    ----------
    case
        Folder for the case; it must be empty or not there yet.
    scenario
        SUMO configuration (.sumocfg).
    drive
        Tables of a drive: the subject vehicle's, then the detected vehicles'. Any number of such pairs.
    subject
        Id of the subject vehicle; found, or added, unless given.
    log
        TOML file with section [log]: names, units and clock of the tables' columns (docs/case.md); Table 1 otherwise.
    """
    from jaxcalib.cli.guarded import guarded
    from jaxcalib.new_case.new_case import make_case

    def work() -> str:
        return "\n".join([*make_case(case, scenario, drive, subject, log), f"{case / 'case.toml'} is written."])

    return guarded(work, "nothing was written.") or check(case)
