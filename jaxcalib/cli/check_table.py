"""What `jaxcalib check` prints."""

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from jaxcalib.check.check_page import write_check_page
from jaxcalib.check.scenario_check import CaseCheck
from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from jaxcalib.errors import CaseError, ResourceError

WIDTH = 120


def check_table(check: CaseCheck) -> str:
    """A table of the findings, the warnings, and in which simulator a search would run."""
    table = Table("level", "where", "what", title=f"Scenario of {check.name}", show_lines=False)
    for finding in check.findings:
        times = f" ({finding.count} of them)" if finding.count > 1 else ""
        table.add_row(finding.level.value, f"{finding.file}: {finding.element}{times}", finding.words)
    console = Console(width=WIDTH, no_color=True)
    with console.capture() as captured:
        if check.findings:
            console.print(table)
        for line in (*check.lines_before, *check.warnings, *check.lines_after):
            console.print(line, highlight=False, markup=False)
    return captured.get().rstrip()


def print_check(check: CaseCheck) -> int:
    """Print the table, and what is wrong on standard error; return the exit code."""
    if table := check_table(check):
        print(table)
    for line in check.refusals:
        print(f"jaxcalib: {line}", file=sys.stderr)
    return EXIT_CASE_WRONG if check.refusals else 0


def leave_page(check: CaseCheck, file: Path, *, is_asked_for: bool) -> str:
    """Write the page, and return the line that says where.

    One that nobody asked for, and that cannot be written, is said on standard error.

    Raises:
        CaseError: the place that was asked for cannot be written to.
        ResourceError: its disk is full.
    """
    try:
        write_check_page(check, file)
    except (CaseError, ResourceError) as error:
        if is_asked_for:
            raise
        print(f"jaxcalib: no figure: {error}", file=sys.stderr)
        return ""
    return f"figure: {file}"
