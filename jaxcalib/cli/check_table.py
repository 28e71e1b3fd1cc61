"""What `jaxcalib check` prints."""

from rich.console import Console
from rich.table import Table

from jaxcalib.problem.scenario_check import CaseCheck

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
        else:
            console.print(f"The surrogate follows every part of the scenario of {check.name}.")
        for name, flows in check.inputs.items():
            console.print(f"input {name}: {len(flows)} flows", highlight=False)
        for line in check.warnings:
            console.print(line, highlight=False, markup=False)
        where = "SUMO alone" if check.is_left_to_sumo else "the surrogate, and is confirmed in SUMO"
        console.print(f"A calibration searches in {where}.")
    return captured.get().rstrip()
