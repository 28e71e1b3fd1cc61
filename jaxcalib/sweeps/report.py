"""sweep.json and the page beside a sweep's table."""

from pathlib import Path

from jaxcalib.problem import CalibrationProblem


def write_report(table: Path, problem: CalibrationProblem | None) -> None:
    """Write them."""
