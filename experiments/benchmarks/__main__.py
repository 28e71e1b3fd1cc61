"""`python -m experiments.benchmarks`: what a user waits for, one line of JSON for each benchmark."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, Parameter
from rich.console import Console

from experiments.benchmarks.commands import measure_calibrate, measure_diagnose, measure_sweep
from experiments.benchmarks.on_a_cluster import measure_on_a_cluster
from experiments.benchmarks.throughput import CASE, measure_throughput
from experiments.results.record import append

SETS, ROUNDS = 64, 5  # of the throughput
BENCHMARKS: Mapping[str, tuple[Callable[[Path], dict[str, Any]], str]] = {
    "calibrate": (measure_calibrate, "`jaxcalib calibrate`, the whole command, programs compiled anew"),
    "diagnose": (measure_diagnose, "`jaxcalib diagnose`, the whole command, programs compiled anew"),
    "sweep": (measure_sweep, "`jaxcalib sweep` with 2,048 runs of the surrogate, programs compiled anew"),
    "cluster": (
        measure_on_a_cluster,
        "SUMO's part of `jaxcalib validate`, half of the cores and a cluster of them all",
    ),
    "throughput": (lambda case: measure_throughput(case, SETS, ROUNDS), "Vehicle-steps per second of both simulators"),
}
app = App(name="experiments.benchmarks", help="What a user waits for.")


@app.default
def run(
    *names: str,
    case: Path = CASE,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Run benchmarks, and print one line of JSON for each.

    Parameters
    ----------
    names
        Which of them: calibrate, diagnose, sweep, cluster, throughput; all unless given.
    case
        Folder with case.toml, the SUMO scenario and the logs.
    record
        Also add a row for this commit to experiments/results.
    """
    for name in names:
        if name not in BENCHMARKS:
            raise SystemExit(f"expected some of {', '.join(BENCHMARKS)}, got {name}.")
    for name in names or BENCHMARKS:
        measure, title = BENCHMARKS[name]
        result = {"benchmark": name, "case": case.name} | measure(case)
        Console().print_json(json.dumps(result), indent=None)
        if record:
            row = {key: value for key, value in result.items() if key != "benchmark"}
            append("benchmarks", f"{name}-{case.name}", row, f"{title}: {case.name}")
    return 0


if __name__ == "__main__":
    raise SystemExit(app())
