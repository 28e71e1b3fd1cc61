"""What is told at a terminal."""

import io

from rich.console import Console

from jaxcalib.cli.terminal import SUMO_WEIGHT, TerminalProgress


def test_more_runs_than_planned_are_not_more_than_everything():
    told = io.StringIO()
    with TerminalProgress(Console(file=told)) as progress:
        progress.plan(60, 10)
        progress.surrogate_runs(60)
        progress.stage("confirmation")
        progress.sumo_runs(13)
        progress.stage("final_errors")
    shares = [line.split("%")[0].strip() for line in told.getvalue().splitlines() if "%" in line]
    assert shares == [str(round(100 * 60 / (60 + 10 * SUMO_WEIGHT))), "99"]
