"""`python -m experiments.safety CASE`: safety measures of calibrated against true parameters, both in SUMO.

A calibration matches none of these measures. Whether they come right all the same can be told where the truth is known:
fields simulated on the case's road (`experiments.paper`), whose parameters are to be found back. Beside the differences
stand those of the truth from itself on other seeds, for rare events scatter.
"""

import os
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter
from cyclopts.validators import Number
from rich.console import Console

from experiments.results.record import record as keep
from experiments.results.terminal import as_table
from experiments.safety.differences import differences_on, summary_of
from jaxcalib.cli.guarded import guarded
from jaxcalib.problem.engines import prepare_devices
from jaxcalib.problem.problem import read_problem

app = App(name="experiments.safety", help="Safety measures of calibrated against true parameters.")


@app.default
def safety(
    case: Path,
    /,
    *,
    out: Path,
    patterns: Annotated[tuple[int, ...], Parameter(consume_multiple=True, negative="")] = (2, 4),
    rounds: Annotated[int, Parameter(validator=Number(gte=2, lte=1000))] = 20,
    budget: Annotated[float, Parameter(validator=Number(gte=0.05, lte=100.0))] = 1.0,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Make fields of known parameters, calibrate them, and compare both in SUMO; the same command goes on.

    Parameters
    ----------
    case
        Folder with case.toml, the SUMO scenario and the logs.
    out
        Folder for fields and results; that of a study of `experiments.paper` has both already.
    patterns
        Numbers of traffic patterns of `experiments.paper`, from 2.
    rounds
        How often each departure of the case is run, with the truth, with the truth again, and with what was found.
    budget
        Factor on the calibration's numbers of runs.
    record
        Keep the table in experiments/results.
    """

    def work() -> str:
        prepare_devices(len(os.sched_getaffinity(0)))
        problem = read_problem(case)
        rows = [row for number in patterns for row in differences_on(problem, number, out, rounds, budget)]
        notes = summary_of(rows)
        Console().print(as_table(rows, f"safety measures on {problem.case.name}"), "\n".join(notes))
        if record:
            title = f"Safety measures of calibrated against true parameters on {problem.case.name}, both in SUMO"
            keep("calibration", f"safety_{problem.case.name}", rows, title, [f"- {note}" for note in notes])
        return ""

    return guarded(work, "nothing was recorded; the same command goes on.")


if __name__ == "__main__":
    sys.exit(app())
