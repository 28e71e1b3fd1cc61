"""The page of a check: what was understood of a case and its logs, for people who see what no rule finds."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from jaxcalib.case.case import Case, Drive
from jaxcalib.check.check_figures import (
    ALIKE,
    FASTER,
    FULL_COLOUR_MPS,
    KIND_COLOURS,
    SLOWER,
    drive_colours,
    drive_figures,
    map_figure,
)
from jaxcalib.check.check_records import KINDS, DriveRecord, LogRecords, log_records
from jaxcalib.check.scenario_check import CaseCheck
from jaxcalib.errors import shorten
from jaxcalib.html.page import render_page
from jaxcalib.runs.disk import writing_to
from sim_adapters.atomic_file import write_atomically
from sim_adapters.units import kmh_from_mps

MOST_DRIVES = 12  # that are drawn; those that are refused first
# Headings of the table of rows, and the fields of DriveCounts.
COLUMNS = {
    "rows of the subject": "subject_rows",
    "no place or speed": "subject_rows_without_place",
    "rows of objects": "object_rows",
    "no row of the subject then": "rows_without_subject",
    "no distance, speed or lane": "rows_without_place",
    "no vehicle of the traffic": "rows_impossible",
    "before or behind the route": "rows_off_route",
    "beside the road": "rows_off_road",
    "too short": "rows_of_fragments",
    "tracks": "tracks",
    "lane contradicts place": "lanes_contradicting",
}


def write_check_page(check: CaseCheck, file: Path) -> None:
    """Write the page of a check.

    Raises:
        CaseError: the folder must not be written to.
        ResourceError: the disk is full.
    """
    page = check_html(check)
    with writing_to(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(file, lambda stream: stream.write(page.encode()))


def check_html(check: CaseCheck) -> str:
    """Return the page of a check."""
    case = check.case
    drives = () if case is None else case.drives
    refused = _refused(check, drives)
    records = None if case is None else log_records(case, check.logs, MOST_DRIVES, frozenset(refused))
    shown = () if records is None else records.drives
    return render_page(
        "check.html.j2",
        check=check,
        has_road=records is not None and bool(records.lanes_xy_m),
        map=Markup("" if records is None else map_figure(records)),
        colours={} if records is None else drive_colours(records),
        drives=[_section(drive, refused.get(drive.id, [])) for drive in shown],
        figures={} if records is None else {name: Markup(one) for name, one in drive_figures(records).items()},
        not_drawn=_not_drawn(drives, records),
        columns=list(COLUMNS),
        rows=[] if case is None else _rows(case, check, shown),
        kinds=KINDS,
        kind_colours=KIND_COLOURS,
        speed_colours=(SLOWER, ALIKE, FASTER),
        full_colour_kmh=f"{kmh_from_mps(FULL_COLOUR_MPS):.0f}",
    )


def _refused(check: CaseCheck, drives: tuple[Drive, ...]) -> dict[str, list[str]]:
    """The drives whose files a refusal names first, and these lines."""
    files = {drive.id: (drive.subject_file.name, drive.objects_file.name) for drive in drives}
    starts = {name: tuple(f"{shorten(file)}:" for file in both) for name, both in files.items()}
    faults = {name: [line for line in check.refusals if line.startswith(start)] for name, start in starts.items()}
    return {name: lines for name, lines in faults.items() if lines}


def _section(drive: DriveRecord, refusals: list[str]) -> dict[str, Any]:
    return {
        "id": drive.id,
        "role": drive.role.replace("_", "-"),
        "is_placed": drive.is_placed,
        "refusals": refusals,
        "counts": drive.counts,
        "num_rows": len(drive.kind),
    }


def _not_drawn(drives: tuple[Drive, ...], records: LogRecords | None) -> dict[str, list[str]]:
    """Ids of the drives without panels, by the reason."""
    shown = set() if records is None else {drive.id for drive in records.drives}
    rest = [drive.id for drive in drives if drive.id not in shown]
    others = [name for name in rest if records is not None and name in records.ways_xy_m]
    unread = [name for name in rest if name not in others]
    return {"others": others, "unread": unread}


def _rows(case: Case, check: CaseCheck, shown: tuple[DriveRecord, ...]) -> list[tuple[str, str, list[str]]]:
    """Id, role and counts of each drive; where it was not laid onto the road, what is known without it."""
    counted = {} if check.logs is None else {drive.id: vars(drive.counts) for drive in check.logs.drives}
    for drive in shown:
        partly = {"subject_rows": drive.num_subject_rows, "object_rows": len(drive.kind)}
        counted.setdefault(drive.id, partly)
    rows = []
    for drive in case.drives:
        counts = counted.get(drive.id, {})
        rows.append((drive.id, drive.role.replace("_", "-"), [str(counts.get(name, "-")) for name in COLUMNS.values()]))
    return rows
