"""`python -m experiments.benchmarks.timeline`: what keeps the cores busy in each second of a whole command.

The totals of `--profile` say what a command spends its time on; this says when, and in which seconds a core has nothing
to do. Processor times of the command and of the processes that it starts, which are SUMO's, are read once a second.
"""

import contextlib
import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, Any, Literal

import matplotlib as mpl
import psutil
from cyclopts import App, Parameter
from matplotlib.figure import Figure
from rich.console import Console

from experiments.benchmarks.throughput import CASE
from experiments.results.record import FOLDER
from experiments.results.record import record as keep

Command = Literal["calibrate", "diagnose"]
STAGE = re.compile(r"^\s*\d+% (?P<stage>.+?)(?: accuracy \S+)?\s*$")
MOST_COLUMNS = 400  # of the picture; what takes half an hour would have a column for each second
BEGINNING = "start"  # before the command names its first stage
COLORS = {"command": "#1f6fb4", "SUMO": "#e08a1e"}
app = App(name="experiments.benchmarks.timeline", help="What keeps the cores busy, second by second.")


@dataclass(frozen=True)
class Second:
    """What was done between two looks."""

    end_s: float  # since the command began
    stage: str  # what the command last said that it does
    length_s: float  # about one second
    command_s: float  # processor time of the command itself
    sumo_s: float  # processor time of the processes that it has started


@app.default
def timeline(
    command: Command = "calibrate",
    /,
    *,
    case: Path = CASE,
    record: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Run a command, programs compiled anew, and print one line of JSON.

    Parameters
    ----------
    command
        The command.
    case
        Folder with case.toml, the SUMO scenario and the logs.
    record
        Also write the table and the picture to experiments/results.
    """
    seconds = watched(command, case)
    cores = len(os.sched_getaffinity(0))
    rows = by_stage(seconds, cores)
    Console().print_json(json.dumps({"command": command, "case": case.name, "stages": rows}), indent=None)
    if record:
        picture = FOLDER / f"timeline_{command}_{case.resolve().name}.svg"
        draw(coarser(seconds), cores, picture)
        title = f"`jaxcalib {command}` by second and core: {case.name}"
        keep("benchmarks", f"timeline-{command}-{case.name}", rows, title, [f"![{title}]({picture.name})"])
    return 0


def watched(command: Command, case: Path) -> list[Second]:
    """Run a command from an empty cache of programs and return what was done in each second.

    Raises:
        RuntimeError: it failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        line = [sys.executable, "-m", "jaxcalib", command, str(case), "--out", str(Path(folder) / "run")]
        environment = os.environ | {"JAXCALIB_CACHE": folder}
        began = time.perf_counter()
        with subprocess.Popen(
            line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        ) as process:
            assert process.stdout is not None
            said: list[str] = []
            listener = threading.Thread(target=_listen, args=(process.stdout, said), daemon=True)
            listener.start()
            seconds = list(_seconds(process, said, began))
            listener.join()
        if process.returncode:
            raise RuntimeError(f"{command}: {said[-1] if said else process.returncode}")
    return seconds


def _listen(stream: IO[str], said: list[str]) -> None:
    for line in stream:
        if line.strip():
            said.append(line.rstrip())


def _seconds(process: "subprocess.Popen[str]", said: Sequence[str], began: float) -> Iterable[Second]:
    root = psutil.Process(process.pid)
    before: dict[int, float] = {}
    last_s = 0.0
    while process.poll() is None:
        time.sleep(1.0)
        now = processor_times(root)
        end_s = time.perf_counter() - began
        # who has ended since is missing, and with him what he did in his last second
        spent = {pid: cpu_s - before.get(pid, 0.0) for pid, cpu_s in now.items()}
        command_s = spent.pop(process.pid, 0.0)
        yield Second(end_s, stage_of(said), end_s - last_s, command_s, sum(spent.values()))
        before, last_s = now, end_s


def processor_times(root: psutil.Process) -> dict[int, float]:
    """Return the processor time so far of a process and of all that it has started, by number of the process."""
    found: dict[int, float] = {}
    with contextlib.suppress(psutil.NoSuchProcess):  # the command has ended meanwhile
        for process in (root, *root.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):  # that one has
                times = process.cpu_times()
                found[process.pid] = times.user + times.system
    return found


def stage_of(said: Sequence[str]) -> str:
    """Return the stage that the last line of a command's progress names."""
    for line in reversed(said):
        if found := STAGE.match(line):
            return found["stage"]
    return BEGINNING


def by_stage(seconds: Sequence[Second], cores: int) -> list[dict[str, Any]]:
    """Return how long each stage took, and how many cores it kept busy on the average."""
    rows: list[dict[str, Any]] = []
    for stage in dict.fromkeys(second.stage for second in seconds):
        of_stage = [second for second in seconds if second.stage == stage]
        length_s = sum(second.length_s for second in of_stage)
        command, sumo = (sum(getattr(s, part) for s in of_stage) / length_s for part in ("command_s", "sumo_s"))
        rows.append(
            {
                "stage": stage,
                "time_s": round(length_s, 1),
                "cores_of_command": round(command, 2),
                "cores_of_sumo": round(sumo, 2),
                "idle_cores": round(max(0.0, cores - command - sumo), 2),
            }
        )
    return rows


def coarser(seconds: Sequence[Second], most: int = MOST_COLUMNS) -> list[Second]:
    """Return as many spans as a picture can show, none of them over two stages."""
    together = -(-len(seconds) // most)
    spans: list[Second] = []
    for _, group in itertools.groupby(seconds, key=lambda second: second.stage):
        of_stage = list(group)
        for begin in range(0, len(of_stage), together):
            part = of_stage[begin : begin + together]
            times = (sum(getattr(one, name) for one in part) for name in ("length_s", "command_s", "sumo_s"))
            spans.append(Second(part[-1].end_s, part[-1].stage, *times))
    return spans


def draw(seconds: Sequence[Second], cores: int, path: Path) -> None:
    """Draw the cores that are busy over time, a line where each stage begins."""
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "jaxcalib", "font.size": 8.0}):
        figure = Figure(figsize=(8.0, 3.2), layout="constrained")
        axes = figure.add_subplot()
        ends_s = [second.end_s for second in seconds]
        parts = [[getattr(s, part) / s.length_s for s in seconds] for part in ("command_s", "sumo_s")]
        axes.stackplot(ends_s, *parts, step="pre", colors=list(COLORS.values()), labels=list(COLORS))
        axes.axhline(cores, color="#222222", lw=0.8)
        for before, second in zip([None, *seconds], seconds, strict=False):
            if before is None or before.stage != second.stage:
                begins_s = second.end_s - second.length_s
                axes.axvline(begins_s, color="#999999", lw=0.6, ls=":")
                axes.text(begins_s, cores * 1.05, second.stage, rotation=30.0, fontsize=5.5)
        axes.set(xlabel="time in s", ylabel="busy cores", xlim=(0.0, ends_s[-1]), ylim=(0.0, cores * 1.8))
        axes.legend(frameon=False, loc="upper right")
        figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    raise SystemExit(app())
