"""What is wrong with keys of case.toml that are right one by one: names, times, and the files that they mean."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from jaxcalib.case.case_file import FILE_NAME
from jaxcalib.case.case_sections import CaseTable
from jaxcalib.errors import CaseError, quote


def name_faults(table: CaseTable) -> Iterator[CaseError]:
    """Yield names that stand twice, times that do not rise, and drives that are missing."""
    for index, drive in enumerate(table.drive):
        if drive.id in {other.id for other in table.drive[:index]}:
            yield CaseError(FILE_NAME, f"drive[{index + 1}].id", f"expected a new id, got {quote(drive.id)} again.")
    flow_of: dict[str, str] = {}
    for index, entrance in enumerate(table.input):
        if entrance.id in {other.id for other in table.input[:index]}:
            yield CaseError(FILE_NAME, f"input[{index + 1}].id", f"expected a new id, got {quote(entrance.id)} again.")
        for flow in entrance.flows:
            if flow in flow_of:
                yield CaseError(
                    FILE_NAME,
                    f"input[{entrance.id}].flows",
                    f"expected each flow once, got {quote(flow)}, which input {quote(flow_of[flow])} has too.",
                )
            flow_of[flow] = entrance.id
        if any(later <= earlier for earlier, later in pairwise(entrance.windows_s)):
            yield CaseError(
                FILE_NAME,
                f"input[{entrance.id}].windows_s",
                f"expected rising times, got {', '.join(f'{begin_s:g}' for begin_s in entrance.windows_s)}.",
            )
    if table.behaviour:
        for key, names in [("vtypes", table.behaviour.vtypes), ("parameters", table.behaviour.parameters or ())]:
            for index, name in enumerate(names):
                if name in names[:index]:
                    yield CaseError(FILE_NAME, f"behaviour.{key}", f"expected each name once, got {quote(name)} again.")
    if not table.drive:
        yield CaseError(FILE_NAME, "drive", "expected at least one [[drive]], got none.")
    elif all(drive.role == "held_out" for drive in table.drive):
        yield CaseError(FILE_NAME, "drive", 'expected at least one drive with role "fit"; all are "held_out".')


def time_faults(table: CaseTable) -> Iterator[CaseError]:
    """Yield times that lie outside of the simulation."""
    scenario = table.scenario
    if scenario is None:
        return
    if scenario.warmup_s >= scenario.duration_s:
        yield CaseError(
            FILE_NAME,
            "scenario.warmup_s",
            f"expected less than duration_s ({scenario.duration_s:g}), got {scenario.warmup_s:g}.",
        )
    for drive in table.drive:
        if drive.depart_s > scenario.duration_s:
            yield CaseError(
                FILE_NAME,
                f"drive[{drive.id}].depart_s",
                f"expected 0 to scenario.duration_s ({scenario.duration_s:g}), got {drive.depart_s:g}.",
            )


def file_faults(table: CaseTable, root: Path) -> Iterator[CaseError]:
    """Yield files that are not there.

    Args:
        table: what stands in the file.
        root: the case's folder, without links.
    """
    files = [("scenario.config", table.scenario.config)] if table.scenario else []
    for drive in table.drive:
        files += [(f"drive[{drive.id}].subject", drive.subject), (f"drive[{drive.id}].objects", drive.objects)]
    for place, path in files:
        try:
            is_file = (root / path).resolve().is_file()
        except (ValueError, OSError, RuntimeError):  # a NUL, a name too long, links in a circle
            is_file = False
        if not is_file:
            yield CaseError(FILE_NAME, place, f"expected an existing file, got {quote(path)}.")
