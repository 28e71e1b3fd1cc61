"""What `jaxcalib check` prints."""

import sys

from rich.console import Console
from rich.table import Table

from jaxcalib.cli.guarded import EXIT_CASE_WRONG
from jaxcalib.problem.scenario_check import CaseCheck
from sim_adapters.sumo.first_run import FirstRun

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
        elif not check.refusals:
            console.print(f"The surrogate follows every part of the scenario of {check.name}.")
        for name, flows in check.inputs.items():
            console.print(f"input {name}: {len(flows)} flows", highlight=False)
        for group in check.groups:
            told = f"vTypes {', '.join(group)}: driver parameters of their own"
            console.print(told, highlight=False, markup=False)
        for line in check.warnings:
            console.print(line, highlight=False, markup=False)
        if check.first_run is not None:
            console.print(_run_line(check.first_run), highlight=False)
        where = "SUMO alone" if check.is_left_to_sumo else "the surrogate, and is confirmed in SUMO"
        if not check.refusals:
            console.print(f"A calibration searches in {where}.")
    return captured.get().rstrip()


def print_check(check: CaseCheck) -> int:
    """Print the table, and what is wrong on standard error; return the exit code."""
    if table := check_table(check):
        print(table)
    for line in check.refusals:
        print(f"jaxcalib: {line}", file=sys.stderr)
    return EXIT_CASE_WRONG if check.refusals else 0


def _run_line(run: FirstRun) -> str:
    if run.entered_s is None:
        did = "has not entered"
    elif run.arrived_s is None:
        did = f"enters at {run.entered_s:g} s and is under way"
    else:
        return f"In a run of SUMO the subject vehicle enters at {run.entered_s:g} s and arrives at {run.arrived_s:g} s."
    short = "" if run.is_whole else ", where the time for it was over"
    return f"In a run of SUMO the subject vehicle {did} at {run.reached_s:g} s{short}."
